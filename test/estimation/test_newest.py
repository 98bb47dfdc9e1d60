"""Images that wait: the newest of a camera, each camera in turn, as many as are needed."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from stcalib_ros.estimation.newest import NewestImages


@pytest.mark.parametrize("camera_hz", [12.0, 25.0, 30.0, 60.0])
def test_the_rate_holds_on_average(camera_hz):
    images, rng = NewestImages[float](["cam"], rate_hz=10.0), np.random.default_rng(2)
    stamps = np.arange(0, 20, 1 / camera_hz)
    for stamp_s in stamps + rng.uniform(-0.2, 0.2, len(stamps)) / camera_hz:
        images.put("cam", stamp_s, stamp_s)
        images.take(0.0)
        images.done("cam")
    assert images.counted("cam").taken == pytest.approx(200, abs=6)


def test_a_camera_at_the_rate_loses_nothing_by_jitter():
    images, rng = NewestImages[int](["cam"], rate_hz=10.0), np.random.default_rng(2)
    for k in range(100):
        images.put("cam", 0.1 * k + rng.uniform(-0.004, 0.004), k)
        assert images.take(0.0) == ("cam", k)
        images.done("cam")


def test_time_that_goes_back_is_picked_at_once():
    images = NewestImages[str](["cam"], rate_hz=10.0)
    for stamp_s, name in ((100.0, "a"), (5.0, "b")):
        images.put("cam", stamp_s, name)
        assert images.take(0.0) == ("cam", name)
        images.done("cam")


def test_cameras_take_turns_whatever_their_rates():
    images = NewestImages[int](["fast", "slow"], rate_hz=0.0)
    order = []
    for k in range(12):
        images.put("fast", 0.01 * k, k)
        images.put("fast", 0.01 * k + 0.005, k)
        if k % 3 == 0:
            images.put("slow", 0.01 * k, k)
        taken = images.take(0.0)
        images.done(taken[0])
        order.append(taken[0])
    assert order.count("slow") == 4
    fast = images.counted("fast")
    assert (fast.received, fast.not_needed, fast.taken) == (24, 0, 8)
    assert fast.dropped in (15, 16)


def test_one_who_waits_is_woken():
    images = NewestImages[str](["cam"], rate_hz=0.0)
    threading.Timer(0.05, images.put, ("cam", 1.0, "a")).start()
    assert images.take(30.0) == ("cam", "a")


def test_images_of_a_camera_are_used_one_after_the_other():
    images = NewestImages[str](["cam"], rate_hz=0.0)
    images.put("cam", 1.0, "a")
    assert images.take(0.0) == ("cam", "a")
    images.put("cam", 2.0, "b")
    assert images.take(0.0) is None
    images.done("cam")
    assert images.take(0.0) == ("cam", "b")
