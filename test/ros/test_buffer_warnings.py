"""Which warnings of the buffers reach the log, and how often; without ROS."""

from __future__ import annotations

import pytest

from stcalib_ros.ros.buffer_warnings import BufferWarnings
from stcalib_ros.ros.throttle import Throttle


class Log:
    """Lines of a log, and the warnings that get there, by a clock of our own."""

    def __init__(self) -> None:
        self.now_s, self.lines = 0.0, []
        throttle = Throttle(self.lines.append, clock=lambda: self.now_s)
        self.take = BufferWarnings(throttle, clock=lambda: self.now_s)

    def wait(self, seconds: int) -> None:
        for _ in range(seconds):
            self.now_s += 1.0
            self.take.settle()

    def loop(self, cameras: tuple[str, ...]) -> None:
        """A bag of ten seconds begins again."""
        for camera in cameras:
            self.take(f"{camera}: aside", f"{camera} set aside")
        self.wait(1)
        for camera in cameras:
            self.take(f"{camera}: restart", f"{camera} begins again")
        self.wait(9)


@pytest.fixture
def log() -> Log:
    return Log()


def test_a_bag_in_a_loop_is_one_line_every_five_minutes(log):
    for _ in range(30):
        log.loop(("cam0", "cam1"))
    assert len(log.lines) == 1
    assert log.lines[0].startswith("time begins again for cam0, cam1, as when a bag is played")
    log.loop(("cam0", "cam1"))
    assert len(log.lines) == 2


def test_a_bag_that_is_shorter_than_the_wait_is_reported_too(log):
    for _ in range(10):
        for camera in ("cam0", "cam1"):
            log.take(f"{camera}: restart", "again")
        log.wait(1)
    assert len(log.lines) == 1


def test_one_camera_whose_clock_was_set_back_is_named_as_before(log):
    log.loop(("cam0",))
    assert log.lines == ["cam0 begins again"]


def test_images_of_somebody_else_are_reported_after_a_while(log):
    log.take("cam0: aside", "two cameras publish on cam0")
    log.wait(1)
    assert log.lines == []
    log.take("cam0: aside", "two cameras publish on cam0, again")
    log.wait(3)
    assert log.lines == ["two cameras publish on cam0"]


def test_images_that_have_proved_to_be_a_strangers_are_reported_with_what_to_look_for(log):
    log.take("cam0: aside", "two cameras publish on cam0")
    log.take("cam0: dropped", "20 images are dropped")
    log.wait(5)
    assert log.lines == ["20 images are dropped", "two cameras publish on cam0"]


def test_a_camera_that_has_changed_is_reported_as_that(log):
    log.take("cam0: aside", "two cameras publish on cam0")
    log.take("cam0: flush", "the layout of cam0 has changed")
    log.wait(5)
    assert log.lines == ["the layout of cam0 has changed"]


def test_all_else_is_passed_on_at_once(log):
    log.take("cam0: lens", "the lens changes")
    assert log.lines == ["the lens changes"]
