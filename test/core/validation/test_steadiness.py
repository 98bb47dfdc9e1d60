"""Poses and clocks that change within a recording."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import HALF_SECOND, changed

from stcalib_ros.core.model.calibration import Status
from stcalib_ros.core.model.rejection import RejectionReason
from stcalib_ros.core.pipeline import run_stages
from stcalib_ros.core.synthetic import SceneOptions, simulate
from stcalib_ros.core.synthetic.changes import CameraChange
from stcalib_ros.core.validation.steadiness import unsteady_cameras
from stcalib_ros.io.mocap import shipped_clips

OPTIONS = SceneOptions(n_cameras=3, n_people=2, n_frames=240, seed=11)
CLIPS = shipped_clips()
TURN = (0.0, float(np.radians(3.0)), 0.0)


def result(recording):
    return run_stages(recording, HALF_SECOND).calibration


def left_out(calibration):
    return {one.name: one.rejection for one in calibration.uncalibrated}


def test_steady_cameras_are_not_named(small_stages):
    last = small_stages.iterations[-1]
    assert unsteady_cameras(small_stages.lifted, last) == (None, None, None)


@pytest.mark.parametrize("camera", [0, 2])
def test_a_clock_that_is_set_is_named_with_time_and_size(camera):
    """The reference as well as another."""
    change = CameraChange(camera, 4.0, clock_s=0.08)
    found = result(simulate(OPTIONS, clips=CLIPS, changes=[change]).recording)
    name = f"cam{camera}"
    assert found.status is Status.OK
    assert name not in [one.name for one in found.cameras]
    why = left_out(found)[name]
    assert why.reason is RejectionReason.CLOCK_NOT_STEADY
    assert why.measured == pytest.approx(0.08, abs=0.01)
    assert why.values["begin_s"] == pytest.approx(4.0, abs=0.8)


def test_a_camera_that_is_bumped_is_named_with_time_and_size():
    camera, at_s = 0, 6.0
    change = CameraChange(camera, at_s, turn_rad=TURN)
    found = result(simulate(OPTIONS, clips=CLIPS, changes=[change]).recording)
    name = f"cam{camera}"
    assert found.status is Status.OK
    assert name not in [one.name for one in found.cameras]
    why = left_out(found)[name]
    assert why.reason is RejectionReason.POSE_CHANGED
    assert np.degrees(why.measured) == pytest.approx(3.0, abs=0.6)
    assert why.values["begin_s"] == pytest.approx(at_s, abs=0.8)


def test_of_two_cameras_both_are_named():
    two = replace(OPTIONS, n_cameras=2)
    found = result(
        simulate(two, clips=CLIPS, changes=[CameraChange(1, 4.0, turn_rad=TURN)]).recording
    )
    assert found.status is Status.DEGENERATE
    assert {(why.reason, why.cameras, why.others) for why in found.rejections[:2]} == {
        (RejectionReason.POSE_CHANGED, ("cam0",), ("cam1",)),
        (RejectionReason.POSE_CHANGED, ("cam1",), ("cam0",)),
    }


def test_a_clock_that_is_slewed_is_named():
    scene = simulate(OPTIONS, clips=CLIPS)

    def slewed(camera):
        since = camera.stamps - camera.stamps[0]
        return replace(camera, stamps=camera.stamps + 0.1 * np.clip((since - 3.0) / 2.0, 0.0, 1.0))

    found = result(changed(scene.recording, "cam1", slewed))
    assert left_out(found)["cam1"].reason is RejectionReason.CLOCK_NOT_STEADY


def test_log_times_say_which_of_two_clocks_was_set():
    two = replace(OPTIONS, n_cameras=2)
    scene = simulate(two, clips=CLIPS, changes=[CameraChange(1, 4.0, clock_s=0.08)])
    cameras = scene.recording.cameras
    late = [
        taken + 0.03 + 0.005 * np.random.default_rng(1).random(len(taken))
        for taken in scene.exposures_s
    ]
    recorded = tuple(replace(c, received=at) for c, at in zip(cameras, late, strict=True))
    found = result(replace(scene.recording, cameras=recorded))
    assert [why.cameras for why in found.rejections] == [("cam1",)]
    assert found.rejections[0].values["received_s"] == pytest.approx(0.08, abs=0.01)
