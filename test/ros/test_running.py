"""The loop of the executables: an error in a callback is said and ends nothing."""

from __future__ import annotations

import threading

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2: make env")

import rclpy

from stcalib_ros.ros.running import events_executor, spin_until


@pytest.mark.parametrize("make", [events_executor, lambda context: None], ids=["events", "usual"])
def test_an_error_in_a_callback_is_said_and_ends_nothing(capfd, make):
    context = rclpy.Context()
    context.init()
    node = rclpy.create_node("stumbles", context=context)
    stop, calls = threading.Event(), 0

    def stumble() -> None:
        nonlocal calls
        calls += 1
        if calls == 3:
            stop.set()
        raise ValueError("never\nforeseen")

    try:
        node.create_timer(0.01, stumble)
        spin_until(stop, node, make(context))
    finally:
        node.destroy_node()
        context.shutdown()
    assert calls == 3
    said = [line for line in capfd.readouterr().err.splitlines() if "unforeseen error" in line]
    assert len(said) == 1, "each kind of error is said every few seconds"
    assert "ValueError: never?foreseen" in said[0]
    assert "test_running.py" in said[0]
