"""Start and loop of the executables: what they are given, and errors in callbacks."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2: make env")

import rclpy

from stcalib_ros.core.errors import InputError
from stcalib_ros.ros.parameters import declare
from stcalib_ros.ros.restamp_parameters import declare_relay
from stcalib_ros.ros.running import (
    StopRequest,
    events_executor,
    spin_until,
    start_node,
    stop_on_signals,
)


@pytest.fixture
def handlers() -> Iterator[None]:
    before = {n: signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


SIGNALS_WHILE_WAITING = """
import os, signal, threading
from stcalib_ros.ros.running import stop_on_signals
for k in range(300):
    stop = stop_on_signals()
    threading.Timer(2e-4 + k % 100 * 3e-6, os.kill, (os.getpid(), signal.SIGTERM)).start()
    while not stop.wait(0.0):
        pass
print("stopped", k + 1)
"""


def test_a_signal_at_any_moment_of_a_wait_ends_it():
    """Waits of no length, one after the other, as when a bag is played: with a `threading.Event`
    one of the first signals found its lock held and stood still for ever."""
    said = subprocess.run(
        [sys.executable, "-c", SIGNALS_WHILE_WAITING],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert (said.stdout, said.stderr) == ("stopped 300\n", "")


@pytest.mark.usefixtures("handlers")
def test_a_signal_ends_a_long_wait():
    stop = stop_on_signals()
    main_thread = threading.get_ident()
    threading.Timer(0.1, signal.pthread_kill, (main_thread, signal.SIGINT)).start()
    assert stop.wait(1e4)
    assert stop.wait(1e4), "it stays asked"


def test_a_wait_that_nobody_ends():
    assert not StopRequest().wait(0.01)


@pytest.mark.parametrize("make", [events_executor, lambda context: None], ids=["events", "usual"])
def test_an_error_in_a_callback_is_said_and_ends_nothing(capfd, make):
    context = rclpy.Context()
    context.init()
    node = rclpy.create_node("stumbles", context=context)
    stop, calls = StopRequest(), 0

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


def declared_with(
    declare_all: Callable[[Any], Any], monkeypatch: pytest.MonkeyPatch, *words: str
) -> None:
    """Declare the parameters of a node that is started by such words after ``--ros-args``."""
    arguments = ["--ros-args", *words]
    monkeypatch.setattr(sys, "argv", ["calibrator", *arguments])
    context = rclpy.Context()
    context.init(args=arguments)
    node = rclpy.create_node("calibrator", context=context)
    try:
        declare_all(node)
    finally:
        node.destroy_node()
        context.shutdown()


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("offset_rnge_s:=1.0", "unknown parameter offset_rnge_s: did you mean offset_range_s"),
        ("camera.cam9.frame:=x", "unknown parameter camera.cam9.frame: did you mean camera.cam"),
        ("bundel.rounds:=3", r"unknown parameter bundel\.rounds: did you mean bundle\.rounds\?"),
        ("qqq:=3", "unknown parameter qqq: see `ros2 param list`"),
    ],
)
def test_a_mistyped_parameter(monkeypatch: pytest.MonkeyPatch, given: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        declared_with(declare, monkeypatch, "-p", given)


def test_a_mistyped_parameter_of_the_relay(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match=r"result_fil: did you mean result_file"):
        declared_with(declare_relay, monkeypatch, "-p", "result_fil:=x")


def test_parameters_that_are_those_of_the_middleware(monkeypatch: pytest.MonkeyPatch) -> None:
    declared_with(declare, monkeypatch, "-p", "use_sim_time:=true", "-p", "window_s:=9.0")
    quality = "qos_overrides./parameter_events.publisher.depth:=10"
    declared_with(declare, monkeypatch, "-p", quality)


def test_a_file_of_parameters_of_another_node(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "p.yaml"
    file.write_text("calibratr:\n  ros__parameters:\n    window_s: 9.0\n")
    with pytest.raises(InputError, match=r"p\.yaml has no parameters of /calibrator: they stand"):
        declared_with(declare, monkeypatch, "--params-file", str(file))
    file.write_text("calibrator:\n  ros__parameters:\n    window_s: 9.0\n")
    declared_with(declare, monkeypatch, "--params-file", str(file))


def test_a_file_of_parameters_that_is_missing_or_damaged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "p.yaml"
    monkeypatch.setattr(sys, "argv", ["x", "--ros-args", "--params-file", str(file)])
    with pytest.raises(InputError, match=r"--params-file: no such file: .*p\.yaml"):
        start_node("x")
    file.write_text("/**:\n  ros__parameters: [1]\n")
    with pytest.raises(InputError, match=r"arguments of ROS: .*p\.yaml.* line \d+$") as caught:
        start_node("x")
    assert "\n" not in str(caught.value)
