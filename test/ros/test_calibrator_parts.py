"""Buffers, readiness and the worker of the live node; without ROS."""

from __future__ import annotations

import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plain import CAMERA, Ear, fill, info, poses

from stcalib_ros.core.errors import Cancelled, InputError
from stcalib_ros.core.model.calibration import Status
from stcalib_ros.core.model.rejection import RejectionReason
from stcalib_ros.core.options import Options
from stcalib_ros.io.assemble import assemble_recording
from stcalib_ros.io.stamps import ClockCorrection
from stcalib_ros.ros import worker as worker_module
from stcalib_ros.ros.buffers import Buffers
from stcalib_ros.ros.readiness import Trigger, ready_cameras
from stcalib_ros.ros.streams import Limits
from stcalib_ros.ros.worker import Job, Worker, failure

ROOT = Path(__file__).parents[2]


@pytest.fixture
def ear() -> Ear:
    return Ear()


@pytest.fixture
def buffers(ear: Ear) -> Buffers:
    made = Buffers([CAMERA], Limits(window_s=10.0, max_persons=3, max_joints=20), ear)
    made.add_info("cam0", info())
    return made


def stamps_s(buffers: Buffers, **bounds: object) -> list[float]:
    cameras = buffers.snapshot(**bounds)
    return [image.stamp_ns * 1e-9 for camera in cameras for image in camera.images]


def test_the_window_is_a_span_of_stamps(buffers):
    fill(buffers, 100.0, 30.0)
    kept = stamps_s(buffers)
    assert kept[-1] == pytest.approx(129.9)
    assert kept[0] == pytest.approx(119.9)
    assert len(kept) == 101
    buffers.set_limits(Limits(window_s=2.0))
    assert len(stamps_s(buffers)) == 21


def test_images_are_bounded_whatever_the_window(buffers, ear):
    buffers.set_limits(Limits(window_s=600.0, max_images=100))
    fill(buffers, 100.0, 20.0)
    assert len(stamps_s(buffers)) == 100
    assert "max_images" in ear.lines[-1]


def test_a_snapshot_stays_as_it_is(buffers):
    fill(buffers, 100.0, 1.0)
    (camera,) = buffers.snapshot()
    fill(buffers, 101.0, 1.0)
    assert len(camera.images) == 10
    assert (camera.name, camera.pose_topic) == ("cam0", "/cam0/person_poses")


def test_a_snapshot_can_be_bounded_by_the_reference_clock(buffers):
    fill(buffers, 100.0, 5.0)
    found = stamps_s(buffers, start_s=102.05, end_s=103.05, clocks={"cam0": ClockCorrection(1.0)})
    assert (found[0], found[-1]) == (pytest.approx(101.1), pytest.approx(102.0))
    assert buffers.snapshot(["cam1"]) == []


def test_the_bounds_of_a_snapshot_follow_the_skew_of_a_clock(buffers):
    fill(buffers, 86_400.0, 5.0)
    day = {"cam0": ClockCorrection(0.0, skew=20e-6)}
    found = stamps_s(buffers, start_s=86_403.75, end_s=86_404.75, clocks=day)
    assert (found[0], found[-1]) == (pytest.approx(86_402.1), pytest.approx(86_403.0))


def test_without_a_lens_there_is_no_snapshot(ear):
    buffers = Buffers([CAMERA], Limits(), ear)
    fill(buffers, 100.0, 1.0)
    assert buffers.snapshot() == []
    assert not buffers.counts()["cam0"].has_info
    assert buffers.moving() == {}


UNUSABLE = [
    (poses(0.0), "stamp is zero"),
    (poses(-5.5), "negative"),
    (poses(101.0, persons=4), "4 persons in one image; 3 are accepted (max_persons)"),
    (poses(101.0, layout="no_such"), "no_such"),
    (poses(101.0, layout="x" * 10_000), "at most 256 characters"),
    (poses(101.0, layout="a\x1b[31mb"), "that can be printed"),
    (poses(101.0, joint_names=["a"] * 21), "joint names"),
    (poses(101.0, joint_names=["x" * 1000]), "joint names"),
    (poses(101.0, layout="body_25"), "takes 50"),
    (poses(101.0, persons=1, layout="mine", joint_names=["a", "a"]), "twice"),
]


@pytest.mark.parametrize(("message", "why"), UNUSABLE, ids=[why for _, why in UNUSABLE])
def test_unusable_poses_are_counted_said_and_dropped(buffers, ear, message, why):
    fill(buffers, 100.0, 1.0)
    buffers.add_poses("cam0", message)
    counts = buffers.counts()["cam0"]
    assert (counts.images, counts.dropped, counts.received, counts.flushes) == (10, 1, 11, 0)
    assert why in ear.lines[-1]
    assert why in counts.last_problem


def test_an_oversize_person_is_dropped(buffers, ear):
    message = poses(101.0)
    message.persons[0].joints = np.ones(3 * 21)  # type: ignore[attr-defined]
    buffers.add_poses("cam0", message)
    assert "21 joints; 20 are accepted (max_joints)" in ear.lines[-1]


@pytest.mark.parametrize(
    "fields",
    [{"k": [0.0] * 9}, {"d": [np.nan] * 5}, {"d": [0.0] * 1000}, {"distortion_model": "other"}],
)
def test_unusable_lenses_are_dropped(buffers, fields):
    fill(buffers, 100.0, 1.0)
    buffers.add_info("cam0", info(**fields))
    counts = buffers.counts()["cam0"]
    assert (counts.images, counts.dropped, counts.has_info) == (10, 1, True)


def test_random_messages_do_no_harm(buffers):
    rng = np.random.default_rng(0)
    fill(buffers, 100.0, 1.0)
    for _ in range(1000):
        message = poses(101.0, persons=int(rng.integers(1, 6)))
        for person in message.persons:  # type: ignore[attr-defined]
            person.keypoints = rng.choice([np.nan, np.inf, 1e30], size=rng.integers(1, 33))
        buffers.add_poses("cam0", message)
    counts = buffers.counts()["cam0"]
    assert (counts.images, counts.dropped) == (10, 1000)


def test_counts(buffers):
    fill(buffers, 100.0, 5.0)
    counts = buffers.counts()["cam0"]
    assert (counts.images, counts.persons, counts.received) == (50, 50, 50)
    assert counts.rate_hz == pytest.approx(10.0)
    assert 0.0 <= counts.age_s < 60.0
    assert buffers.newest_s() == pytest.approx(104.9)


def test_nothing_has_no_made_up_numbers(ear):
    buffers = Buffers([CAMERA], Limits(), ear)
    counts = buffers.counts()["cam0"]
    assert np.isnan(counts.rate_hz)
    assert np.isinf(counts.age_s)
    assert np.isnan(buffers.newest_s())


@pytest.mark.parametrize(("speed_px_s", "moving"), [(0.0, 0), (5.0, 0), (100.0, 5)])
def test_motion_is_more_than_noise(buffers, speed_px_s, moving):
    fill(buffers, 100.0, 5.0, speed_px_s=speed_px_s)
    assert len(buffers.moving()["cam0"]) == moving


def test_keypoints_alone_are_kept_counted_and_move(buffers, ear):
    fill(buffers, 100.0, 2.0, speed_px_s=100.0)
    fill(buffers, 102.0, 3.0, speed_px_s=100.0, joints=())
    counts = buffers.counts()["cam0"]
    assert (counts.images, counts.images_3d, counts.persons) == (50, 20, 50)
    assert (counts.dropped, counts.flushes, counts.fault) == (0, 0, None)
    assert len(buffers.moving()["cam0"]) == 5
    (camera,) = assemble_recording(buffers.snapshot(), warn=ear).cameras
    (track,) = camera.tracks
    np.testing.assert_array_equal(np.isfinite(track.joints).all((1, 2)), np.arange(50) < 20)
    assert np.isfinite(track.keypoints).all()


def test_keypoints_alone_take_less_memory(ear):
    limits = Limits(window_s=600.0, max_mb=0.1)
    kept = {}
    for joints in ((1.0,) * 51, ()):
        buffers = Buffers([CAMERA], limits, ear)
        fill(buffers, 100.0, 60.0, joints=joints)
        kept[len(joints)] = buffers.counts()["cam0"].images
    assert 0 < kept[51] < kept[0] < 600


@pytest.mark.parametrize(
    ("keypoints", "reason"),
    [
        (np.linspace(0.1, 0.9, 34), RejectionReason.KEYPOINTS_NORMALISED),
        (np.linspace(-0.9, 0.9, 34), RejectionReason.KEYPOINTS_NORMALISED),
        (np.ones(34), RejectionReason.KEYPOINTS_COINCIDE),
        (np.full(34, 200.0), RejectionReason.KEYPOINTS_COINCIDE),
        (np.full(34, np.nan), None),
        (np.zeros(34), None),
    ],
    ids=["0..1", "-1..1", "corner", "one place", "nan", "zeros"],
)
def test_keypoints_that_cannot_be_those_of_people(buffers, keypoints, reason):
    fill(buffers, 100.0, 5.0, keypoints=keypoints, joints=())
    counts = buffers.counts()["cam0"]
    assert (None if counts.fault is None else counts.fault.reason) is reason
    assert counts.no_keypoints == (reason is None)
    assert buffers.moving()["cam0"] == frozenset()


def test_a_few_poses_at_one_place_are_no_fault_of_the_camera(buffers):
    fill(buffers, 100.0, 5.0)
    fill(buffers, 105.0, 4.0, keypoints=np.ones(34))
    assert buffers.counts()["cam0"].fault is None


def test_motion_is_forgotten_with_its_images(buffers):
    fill(buffers, 100.0, 5.0, speed_px_s=100.0)
    fill(buffers, 105.0, 12.0)
    assert buffers.moving() == {"cam0": frozenset()}


SECONDS = frozenset(range(100, 112))


@pytest.mark.parametrize(
    ("moving", "ready"),
    [
        ({}, ()),
        ({"a": SECONDS}, ()),
        ({"a": SECONDS, "b": frozenset()}, ()),
        ({"a": SECONDS, "b": SECONDS}, ("a", "b")),
        ({"a": SECONDS, "b": frozenset(range(500, 520))}, ()),
        ({"a": SECONDS, "b": SECONDS, "c": frozenset({110, 111})}, ()),
        ({"a": SECONDS, "b": SECONDS, "c": frozenset({100})}, ("a", "b")),
    ],
    ids=["none", "one", "blind", "two", "apart", "one still on the way", "one that left"],
)
def test_cameras_are_ready_when_they_share_motion(moving, ready):
    assert ready_cameras(moving, min_motion_s=10.0, slack_s=1.0) == ready


def test_the_trigger_waits_for_something_new():
    trigger, few, more = Trigger(), frozenset("ab"), frozenset("abc")
    wants = {"period_s": 0.0, "window_s": 30.0}
    assert not trigger.due(frozenset(), 100.0, **wants)
    assert trigger.due(few, 100.0, **wants)
    trigger.tried(few, 100.0)
    assert not trigger.due(few, 129.0, **wants)
    assert trigger.due(few, 130.0, **wants), "nothing is in force: again with new data"
    trigger.settle(True)
    assert not trigger.due(few, 1000.0, **wants)
    assert trigger.due(more, 101.0, **wants)
    assert trigger.due(few, 160.0, period_s=60.0, window_s=30.0)
    assert not trigger.due(few, 50.0, period_s=60.0, window_s=30.0)
    assert trigger.due(few, 111.0, period_s=60.0, window_s=30.0), "from where time jumped back to"


class Solver:
    """In place of the pipeline: waits until it may go on or is cancelled."""

    def __init__(self) -> None:
        self.go_on = threading.Event()
        self.error: Exception | None = None

    def __call__(self, _cameras, _options, *, cancelled, warn, progress, adjusted):
        adjusted(2.5)
        progress("registration", 0.5)
        while not self.go_on.wait(0.01):
            if cancelled():
                raise Cancelled("cancelled during registration")
        if self.error is not None:
            raise self.error
        return replace(
            failure(Status.CANCELLED, "2 of 2 cameras calibrated"),
            status=Status.OK,
            reference="cam0",
            rejections=(),
        )


@pytest.fixture
def solver(monkeypatch: pytest.MonkeyPatch) -> Solver:
    made = Solver()
    monkeypatch.setattr(worker_module, "calibrate_in_subprocess", made)
    return made


class Bell:
    def __init__(self) -> None:
        self._rung = threading.Semaphore(0)

    def __call__(self) -> None:
        self._rung.release()

    def wait(self) -> None:
        assert self._rung.acquire(timeout=60.0)


@pytest.fixture
def job(buffers: Buffers) -> Job:
    fill(buffers, 100.0, 1.0)
    return Job("run", buffers.snapshot(), Options(), True)


def test_the_worker_does_one_job_at_a_time(solver, job):
    bell = Bell()
    worker = Worker(bell, print)
    assert worker.start(job)
    bell.wait()
    assert worker.step is not None
    step = worker.step
    assert (step.run_id, step.stage, step.rms_px) == ("run", "registration", 2.5)
    assert not worker.start(job)
    assert worker.collect() is None
    solver.go_on.set()
    bell.wait()
    assert not worker.start(job), "not before the outcome is collected"
    outcome = worker.collect()
    assert outcome is not None
    assert (outcome.job.run_id, outcome.calibration.status) == (job.run_id, Status.OK)
    assert outcome.job.cameras == ()
    assert worker.collect() is None
    assert worker.step is None


def test_a_job_is_cancelled(solver, job):
    worker = Worker(Bell(), print)
    worker.start(job)
    assert worker.stop(60.0)
    outcome = worker.collect()
    assert outcome is not None
    assert outcome.calibration.status is Status.CANCELLED
    solver.go_on.set()
    assert worker.start(job), "the next one is not cancelled"
    assert worker.stop(60.0)


@pytest.mark.parametrize(
    ("error", "status", "reason", "message"),
    [
        (
            InputError("no such layout"),
            Status.INSUFFICIENT_DATA,
            RejectionReason.INPUT_UNUSABLE,
            "no such layout",
        ),
        (
            np.linalg.LinAlgError("singular"),
            Status.NOT_CONVERGED,
            RejectionReason.SOLVER_FAILED,
            "LinAlgError: singular",
        ),
    ],
)
def test_whatever_the_solver_stumbles_over_the_worker_goes_on(
    solver, job, error, status, reason, message
):
    solver.error = error
    solver.go_on.set()
    worker = Worker(Bell(), print)
    for _ in range(2):
        assert worker.start(job)
        worker.stop(60.0)
        outcome = worker.collect()
        assert outcome is not None
        assert (outcome.calibration.status, outcome.calibration.message) == (status, message)
        (rejection,) = outcome.calibration.rejections
        assert (rejection.reason, rejection.detail) == (reason, message)
