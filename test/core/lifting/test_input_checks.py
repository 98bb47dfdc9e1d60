"""What must hold before anything is computed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import EXACT, FRAME_S, changed, lifted

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.lifting.input_checks import (
    movement_of,
    require_reference,
    require_usable,
    select_cameras,
)
from stcalib_ros.core.model.calibration import Insufficient, Status
from stcalib_ros.core.model.lifted import LiftedCamera, LiftedTrack
from stcalib_ros.core.model.recording import Recording, keypoints_only
from stcalib_ros.core.model.rejection import RejectionReason
from stcalib_ros.core.options import Options, RegistrationOptions
from stcalib_ros.core.synthetic import simulate

OPTIONS = Options(offset_range_s=0.5)


def walker(n=60, *, width=0.5, noise=0.0, seed=0):
    """A person 0.4 high on the plane z = 1 who goes `width` to the right."""
    rng = np.random.default_rng(seed)
    body = np.stack([np.linspace(-0.05, 0.05, 17), np.linspace(-0.2, 0.2, 17)], -1)
    x = body + np.linspace(0, width, n)[:, None, None] * [1.0, 0.0]
    x = x + noise * rng.normal(size=x.shape)
    joints = np.concatenate([4 * x, np.full((n, 17, 1), 4.0)], -1)
    return LiftedTrack(0, np.arange(n), x, np.full((n, 17), 1400.0), joints, joints.mean(1))


def camera(name, *, start=0.0, n=60, fps=30.0, **more):
    return LiftedCamera(name, start + np.arange(n) / fps, (walker(n, **more),))


# The reference


def test_the_first_camera_is_the_reference_unless_another_is_named(exact_scene):
    recording = exact_scene.recording
    assert require_reference(recording, Options()) == 0
    assert require_reference(recording, Options(reference="cam2")) == 2


def test_an_unknown_reference_is_said_with_the_cameras_there_are(exact_scene):
    with pytest.raises(InputError, match="'left' is not in the recording: there are cam0, cam1"):
        require_reference(exact_scene.recording, Options(reference="left"))


def test_two_cameras_of_one_name_are_refused(exact_scene):
    cameras = exact_scene.recording.cameras
    with pytest.raises(InputError, match="two cameras are called 'cam1'"):
        require_reference(Recording((cameras[1], cameras[0], cameras[1])), Options())


# 3D poses


def test_the_method_of_the_paper_needs_3d_poses(exact_scene):
    paper = Options(registration=RegistrationOptions(method="vmf"))
    recording = keypoints_only(exact_scene.recording, ["cam1", "cam2"])
    require_usable(exact_scene.recording, paper)
    require_usable(recording, Options())
    with pytest.raises(InputError, match="vmf needs 3D poses, and there are none of cam1, cam2:"):
        require_usable(recording, paper)


def test_nobody_needs_no_3d_pose(exact_scene):
    paper = Options(registration=RegistrationOptions(method="vmf"))
    recording = changed(exact_scene.recording, "cam1", lambda c: replace(c, tracks=()))
    require_usable(recording, paper)


# Cameras to compare


def test_all_that_can_be_compared_are_kept_with_the_reference_first():
    cameras = [camera(f"cam{k}", start=0.1 * k) for k in range(4)]
    selection = select_cameras(cameras, 2, OPTIONS)
    assert selection.cameras == (2, 0, 1, 3)
    assert selection.rejected == ()


def test_one_camera_is_not_enough():
    with pytest.raises(Insufficient) as caught:
        select_cameras([camera("cam0")], 0, OPTIONS)
    few = caught.value.rejection
    assert (few.reason, few.measured, few.limit) == (RejectionReason.TOO_FEW_CAMERAS, 1, 2)
    assert caught.value.status is Status.INSUFFICIENT_DATA


def test_a_camera_that_saw_nobody_is_left_out_with_the_reason():
    blind = LiftedCamera("blind", np.arange(60) / 30, ())
    selection = select_cameras([camera("cam0"), blind, camera("cam2")], 0, OPTIONS)
    assert selection.cameras == (0, 2)
    assert [c.name for c in selection.rejected] == ["blind"]
    assert selection.rejected[0].rejection.reason is RejectionReason.NO_PERSONS


def test_a_clock_far_away_is_left_out_with_both_spans():
    cameras = [camera("cam0"), camera("cam1"), camera("late", start=3600.0)]
    selection = select_cameras(cameras, 0, OPTIONS)
    assert selection.cameras == (0, 1)
    found = selection.rejected[0].rejection
    assert found.reason is RejectionReason.CLOCK_EPOCH_DIFFERS
    assert (found.measured, found.limit) == (pytest.approx(3598.0, abs=0.1), 1.0)
    assert "(3600.0..3602.0 s, the others 0.0..2.0 s)" in selection.rejected[0].reason


@pytest.mark.parametrize(("gap_s", "kept"), [(0.5, True), (1.5, False)])
def test_clocks_may_differ_by_twice_the_range_of_one(gap_s, kept):
    # The pair's range is +-1 s; twelve frames of it have to overlap.
    cameras = [camera("cam0"), camera("cam1"), camera("cam2", start=59 / 30 + gap_s)]
    assert (2 in select_cameras(cameras, 0, OPTIONS).cameras) == kept


def test_the_larger_group_is_kept_even_without_the_reference():
    cameras = [camera("early", start=-100.0), camera("cam1"), camera("cam2"), camera("cam3")]
    selection = select_cameras(cameras, 0, OPTIONS)
    assert selection.cameras == (1, 2, 3)
    assert [c.name for c in selection.rejected] == ["early"]


def test_a_chain_of_overlaps_is_one_group():
    cameras = [camera(f"cam{k}", start=1.5 * k) for k in range(4)]
    assert select_cameras(cameras, 0, OPTIONS).cameras == (0, 1, 2, 3)


@pytest.mark.parametrize(("n", "kept"), [(11, False), (12, True)])
def test_twelve_images_are_needed(n, kept):
    cameras = [camera("cam0"), camera("cam1"), camera("short", n=n)]
    selection = select_cameras(cameras, 0, OPTIONS)
    assert (2 in selection.cameras) == kept
    if not kept:
        found = selection.rejected[0].rejection
        assert found.reason is RejectionReason.NO_TEMPORAL_OVERLAP
        assert (found.measured, found.limit) == (pytest.approx(11), 12)


def test_nothing_to_compare_gives_all_reasons():
    cameras = [camera(f"cam{k}", start=100.0 * k) for k in range(3)]
    with pytest.raises(Insufficient) as caught:
        select_cameras(cameras, 0, OPTIONS)
    assert caught.value.rejection.reason is RejectionReason.TOO_FEW_CAMERAS
    assert caught.value.status is Status.INSUFFICIENT_DATA
    assert {c.name for c in caught.value.uncalibrated} == {"cam1", "cam2"}


# Movement


def test_movement_is_in_heights_of_the_body():
    track = walker(width=0.2)
    # Between the first and the last tenth, after means over 8 of 60 images: 53 places.
    assert movement_of(track, np.arange(60) / 30) == pytest.approx(0.8 * 0.5 * 52 / 59)


def test_noise_is_no_movement():
    track = walker(n=300, width=0.0, noise=3 / 1400)
    assert movement_of(track, np.arange(300) / 30) < 0.02


def test_movement_is_seen_through_holes(rng):
    track = walker(width=0.2)
    x = track.x.copy()
    x[rng.uniform(size=(60, 17)) < 0.3] = np.nan
    whole = movement_of(track, np.arange(60) / 30)
    assert movement_of(replace(track, x=x), np.arange(60) / 30) == pytest.approx(whole, rel=0.25)


def test_one_who_moves_is_enough():
    still = walker(width=0.0)
    cameras = [
        LiftedCamera(f"cam{k}", np.arange(60) / 30, (still, walker() if k else still))
        for k in range(2)
    ]
    assert select_cameras(cameras, 0, OPTIONS).cameras == (0, 1)


@pytest.mark.parametrize("seed", range(3))
def test_people_who_stand_do_not_move(seed):
    scene = simulate(replace(EXACT, people="standing", sigma_px=3.0, n_frames=90, seed=seed))
    with pytest.raises(Insufficient) as caught:
        select_cameras(lifted(scene.recording)[1], 0, OPTIONS)
    still = caught.value.rejection
    assert still.reason is RejectionReason.NO_MOTION
    assert still.measured < still.limit
    assert caught.value.status is Status.DEGENERATE


def test_people_who_walk_do(exact_lifted):
    _, cameras = exact_lifted
    movement = [movement_of(t, c.stamps) for c in cameras for t in c.tracks]
    assert max(movement) > 0.2
    assert cameras[0].stamps[1] == pytest.approx(FRAME_S)
