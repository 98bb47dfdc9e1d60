"""What others send on a camera's topics does not empty its buffer; what the camera changes does."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plain import CAMERA, STEP_S, Ear, info, poses

from stcalib_ros.ros.buffers import Buffers
from stcalib_ros.ros.limits import CONFIRMING_IMAGES, QUIET_S
from stcalib_ros.ros.streams import Limits

WINDOW_S = 10.0
MAX_IMAGES = 300


class Scene:
    """A buffer with a clock of its own, and a camera that sends ten images a second."""

    def __init__(self, limits: Limits | None = None) -> None:
        self.now_s = 50.0
        self.ear = Ear()
        bounds = limits or Limits(window_s=WINDOW_S, max_images=MAX_IMAGES)
        self.buffers = Buffers([CAMERA], bounds, self.ear, clock=lambda: self.now_s)

    def send(self, stamp_s: float, **fields: object) -> None:
        self.buffers.add_poses("cam0", poses(stamp_s, **fields))  # type: ignore[arg-type]

    def info(self, **fields: object) -> None:
        self.buffers.add_info("cam0", info(**fields))

    def play(self, start_s: float, n: int, *, speed: float = 1.0, **fields: object) -> None:
        for k in range(n):
            self.now_s += STEP_S / speed
            self.send(start_s + k * STEP_S, **fields)

    def wait(self, seconds: float) -> None:
        self.now_s += seconds

    @property
    def counts(self):
        return self.buffers.counts()["cam0"]

    @property
    def stamps_s(self) -> list[float]:
        self.info()
        (camera,) = self.buffers.snapshot()
        return [round(image.stamp_ns * 1e-9, 3) for image in camera.images]


@pytest.fixture
def scene() -> Scene:
    made = Scene()
    made.info()
    made.play(100.0, 50)
    return made


STRANGE = [
    {"layout": "coco_17"},
    {"metric": False},
    {"rectified": True},
    {"header_frame": "other"},
    {"stamp_s": 103.0},
    {"stamp_s": 400_000_000.0},
]


def strange(scene: Scene, changes: dict[str, object]) -> None:
    changes = dict(changes)
    message = poses(float(changes.pop("stamp_s", 104.95)))
    if frame := changes.pop("header_frame", None):
        message.header.frame_id = frame  # type: ignore[attr-defined]
    for field, value in changes.items():
        setattr(message, field, value)
    scene.buffers.add_poses("cam0", message)


@pytest.mark.parametrize("changes", STRANGE, ids=lambda c: next(iter(c)))
def test_single_strange_messages_are_counted_said_and_dropped(scene, changes):
    for _ in range(20):
        strange(scene, changes)
    assert scene.counts.set_aside == 20
    scene.play(105.0, 10)
    assert scene.stamps_s == pytest.approx(np.arange(1000, 1060) / 10)
    assert (scene.counts.dropped, scene.counts.flushes, scene.counts.set_aside) == (20, 0, 0)
    assert "do two cameras publish on this topic?" in scene.counts.last_problem
    assert any("20 images that were set aside are discarded" in line for line in scene.ear.lines)


def test_a_camera_that_is_configured_anew_loses_nothing_of_the_new(scene):
    scene.play(105.0, 40, metric=False)
    assert scene.stamps_s == pytest.approx(np.arange(1050, 1090) / 10)
    assert (scene.counts.dropped, scene.counts.flushes) == (0, 1)
    assert any(
        "metric changes from True to False; images received" in line for line in scene.ear.lines
    )


def test_time_that_jumps_back_empties_the_buffer(scene):
    scene.send(104.0)
    assert len(scene.stamps_s) == 51, "up to a second is disorder, not a jump"
    scene.play(100.0, 25)
    assert scene.stamps_s == pytest.approx(np.arange(1000, 1025) / 10)
    assert any("time jumps back from 104.9" in line for line in scene.ear.lines)


def test_a_bag_that_ends_after_the_jump_is_settled_when_asked(scene):
    for _ in range(3):
        scene.play(100.0, 50, speed=20.0)
        assert scene.counts.images == 50
    assert scene.counts.flushes == 0, "three quarters of a second after the jump nothing is known"
    scene.wait(QUIET_S)
    assert scene.counts.flushes == 1
    assert scene.stamps_s == pytest.approx(np.arange(1000, 1050) / 10)


def test_after_a_gap_nothing_is_lost_or_forgotten(scene):
    scene.wait(3.0)
    scene.play(108.0, CONFIRMING_IMAGES)
    assert scene.stamps_s == pytest.approx(
        [*np.arange(1000, 1050) / 10, *np.arange(1080, 1090) / 10]
    )
    assert (scene.counts.dropped, scene.counts.flushes) == (0, 0)


def test_a_gap_longer_than_the_window_leaves_the_new(scene):
    scene.wait(60.0)
    scene.play(165.0, 20)
    assert scene.stamps_s == pytest.approx(np.arange(1650, 1670) / 10)
    assert scene.counts.flushes == 1
    assert any("time jumps ahead" in line for line in scene.ear.lines)


def test_few_strange_messages_do_not_replace_a_camera_that_stopped(scene):
    scene.wait(60.0)
    scene.play(105.0, CONFIRMING_IMAGES - 1, layout="coco_17")
    scene.wait(60.0)
    assert len(scene.stamps_s) == 50


def test_of_two_that_come_instead_the_one_with_more_wins(scene):
    for k in range(30):
        scene.now_s += STEP_S
        scene.send(105.0 + k * STEP_S, metric=False)
        if k % 2:
            scene.send(105.0 + k * STEP_S, layout="coco_17")
    (camera,) = scene.buffers.snapshot()
    assert {image.metric for image in camera.images} == {False}


def test_how_long_ago_a_message_was_dropped(scene):
    assert scene.counts.dropped_age_s == np.inf
    scene.send(101.0, layout="x" * 10_000)
    scene.wait(7.0)
    assert (scene.counts.dropped, scene.counts.dropped_age_s) == (1, pytest.approx(7.0))


def test_a_lens_that_somebody_else_sends_is_dropped(scene):
    for _ in range(40):
        scene.wait(0.5)
        scene.info(width=1280)
        scene.info(width=1281)
        scene.info(width=1282, distortion_model="plumb_bob")
        scene.info(width=1283)
        scene.info()
    assert scene.buffers.snapshot()[0].info.width == 640
    assert (scene.counts.flushes, scene.counts.dropped) == (0, 160)
    assert "CameraInfo changes: width was 640 and is 128" in scene.counts.last_problem


def test_a_lens_that_lasts_is_the_new_one_and_keeps_its_images(scene):
    scene.info(width=1280)
    scene.play(105.0, 20)
    assert scene.counts.images == 70
    scene.wait(3.0)
    (camera,) = scene.buffers.snapshot()
    assert camera.info.width == 1280
    assert [i.stamp_ns for i in camera.images] == pytest.approx(1e8 * np.arange(1050, 1070))
    assert any(
        "CameraInfo changes: width was 640 and is 1280; images" in line for line in scene.ear.lines
    )


def test_memory_is_bounded_in_megabytes():
    scene = Scene(Limits(window_s=600.0, max_mb=0.1))
    scene.play(100.0, 200, persons=10)
    kept = scene.counts.images
    assert 5 < kept < 100_000 / (10 * 17 * 6 * 4)
    assert any("more than 0.1 MB (max_mb)" in line for line in scene.ear.lines)
    scene.wait(1.0)
    scene.play(100.0, 50, persons=10, metric=False)
    assert scene.counts.images + scene.counts.set_aside <= 2 * kept


def test_what_is_said_is_one_short_printable_line(scene):
    strange(scene, {"header_frame": "a\n[FATAL] \x1b[31m" + "x" * 200})
    scene.send(105.0, layout="\n\x1b" + "y" * 5000)
    scene.info(distortion_model="z\n" * 100)
    assert len(scene.ear.lines) == 3
    assert all(line.isprintable() and len(line) < 600 for line in scene.ear.lines)
    assert scene.counts.last_problem.isprintable()


FIELDS = st.sampled_from(
    [{}, {"layout": "coco_17"}, {"metric": False}, {"layout": "nonsense"}, {"persons": 70}]
)
FAR = st.one_of(st.floats(-90.0, -1.01), st.floats(1.21, 1e9))
INTRUDERS = st.lists(st.tuples(FAR, FIELDS, st.integers(0, 12)), max_size=25)


@settings(max_examples=60, deadline=None)
@given(intruders=INTRUDERS, lens=st.integers(641, 1000))
def test_the_honest_stream_survives_any_intruder(intruders, lens):
    scene = Scene()
    scene.info()
    for k in range(60):
        scene.now_s += STEP_S
        scene.send(100.0 + k * STEP_S)
        if k < len(intruders):
            away_s, fields, burst = intruders[k]
            for _ in range(burst):
                scene.send(100.0 + k * STEP_S + away_s, **fields)
            scene.info(width=lens + k)
            scene.info()
        counts = scene.counts
        assert (counts.images, counts.flushes) == (k + 1, 0)
        assert counts.set_aside <= MAX_IMAGES
    assert scene.stamps_s == pytest.approx(100.0 + STEP_S * np.arange(60))


SOUP = st.lists(
    st.tuples(
        st.sampled_from([-1e3, 0.0, 5.0, 1e3, 1e9]),
        FIELDS,
        st.integers(1, 40),
        st.sampled_from([0.0, 0.01, 0.3, 2.0]),
        st.sampled_from([640, 641, 642, 643, 644]),
    ),
    max_size=30,
)


@settings(max_examples=30, deadline=None)
@given(soup=SOUP)
def test_memory_is_bounded_whatever_comes_and_a_camera_gets_through_after_it(soup):
    scene = Scene()
    for from_s, fields, n, pause_s, width in soup:
        scene.info(width=width)
        for k in range(n):
            scene.now_s += pause_s
            scene.send(2000.0 + from_s + k * 0.3, **fields)
        counts = scene.counts
        assert counts.images <= MAX_IMAGES
        assert counts.set_aside <= MAX_IMAGES
        assert counts.moving_s <= 2 * MAX_IMAGES
        assert len(counts.last_problem) < 500
    for k in range(400):
        scene.now_s += STEP_S
        scene.send(5000.0 + k * STEP_S)
        scene.info()
    assert scene.stamps_s == pytest.approx(5000.0 + STEP_S * np.arange(299, 400))
    assert scene.buffers.snapshot()[0].info.width == 640


@pytest.mark.parametrize("step_px", [0.0, 15.0])
def test_people_move_though_their_ids_are_no_tracks(step_px):
    scene = Scene()
    scene.info()
    for k in range(40):
        message = poses(100.0 + k * STEP_S, x=100.0 + step_px * k, persons=2)
        for person, number in zip(message.persons, (2 * k, 2 * k + 1), strict=True):
            person.track_id = number
        scene.now_s += STEP_S
        scene.buffers.add_poses("cam0", message)
    assert bool(scene.buffers.moving()["cam0"]) == (step_px > 0)
