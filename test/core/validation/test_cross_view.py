"""How cameras and monocular poses agree, and what shows that they do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stcalib_ros.core.geometry.so3 import exp_so3
from stcalib_ros.core.lifting.views import lift_views
from stcalib_ros.core.model.recording import keypoints_only
from stcalib_ros.core.options import Options
from stcalib_ros.core.validation.cross_view import (
    bone_rotations,
    depth_ratios,
    depth_scale,
    matches_of,
    pair_residuals,
)


@pytest.fixture(scope="module")
def last(small_stages):
    return small_stages.iterations[-1]


@pytest.fixture(scope="module")
def without_poses(small_scene):
    """The same tracks as they are lifted where there are keypoints only."""
    return lift_views(keypoints_only(small_scene.recording), Options()).lifted


def test_a_turned_camera_contradicts_its_bones(small_stages, last):
    R = last.rig.R_ref_cam.copy()
    R[2] = R[2] @ exp_so3(np.array([0.0, 0.8, 0.0]))
    turned = replace(last, rig=replace(last.rig, R_ref_cam=R))
    angle = bone_rotations(small_stages.lifted, small_stages.skeleton, turned)
    np.testing.assert_allclose(angle[2, :2], 0.8, atol=0.1)
    assert angle[0, 1] < 0.1
    np.testing.assert_array_equal(angle, angle.T)


def test_a_camera_further_away_contradicts_the_size_of_people(small_stages, last):
    t = last.state.t_cam_ref.copy()
    t[1, 2] += 8.0
    far = replace(last, state=replace(last.state, t_cam_ref=t))
    before, after = (depth_ratios(small_stages.lifted, one) for one in (last, far))
    assert after[1] > 2 * before[1]
    np.testing.assert_allclose(after[[0, 2]], before[[0, 2]])


@pytest.mark.parametrize("fraction", [-0.4, -0.01, 0.01, 0.4])
def test_distances_are_compared_with_the_nearest_frame(small_stages, last, fraction):
    """Also where a correction moves the time of an image away from its timestamp."""
    corrected = replace(last.state, shift_s=last.state.shift_s + fraction / 30.0)
    before, after = (
        depth_ratios(small_stages.lifted, one) for one in (last, replace(last, state=corrected))
    )
    np.testing.assert_array_equal(after, before)


def test_the_scale_is_that_of_the_people(small_stages, small_scene, last):
    factor = depth_scale(small_stages.lifted, last)
    found = np.linalg.norm(last.rig.t_ref_cam[1]) * factor
    true = np.linalg.norm(small_scene.truth.cameras[1].t_ref_cam)
    assert found == pytest.approx(true, rel=0.1)


def test_matches_are_the_true_ones(small_scene, small_stages, last):
    names = [c.name for c in small_stages.lifted]
    for a, b in ((0, 1), (0, 2), (1, 2)):
        for p, q in matches_of(last, a, b):
            person = [
                small_scene.track_persons[names[c]][small_stages.lifted[c].tracks[k].track_id][0]
                for c, k in ((a, p), (b, q))
            ]
            assert person[0] == person[1]


def test_pairs_report_angles_and_distances(small_stages, last):
    pairs = pair_residuals(small_stages.lifted, small_stages.skeleton, last)
    assert [(p.camera_a, p.camera_b) for p in pairs] == [
        ("cam0", "cam1"),
        ("cam0", "cam2"),
        ("cam1", "cam2"),
    ]
    for pair in pairs:
        assert pair.n_matches == 2
        assert 0.02 < pair.median_angle_rad < 0.3
        # Of 3 px per axis two views show what is across the epipolar lines.
        assert pair.epipolar_rms_px == pytest.approx(3.0, rel=0.25)


def test_exchanged_ids_are_followed_slot_by_slot(small_stages, last):
    """Two tracks exchange their persons at the beginning of a slot; the pairs stay as they were."""
    cameras, exchanged = ids_exchanged(small_stages.lifted, last, camera=1)
    before = pair_residuals(small_stages.lifted, small_stages.skeleton, last)
    after = pair_residuals(cameras, small_stages.skeleton, exchanged)
    assert [pair.n_matches for pair in after] == [pair.n_matches for pair in before]
    for one, other in zip(before, after, strict=True):
        assert other.epipolar_rms_px == pytest.approx(one.epipolar_rms_px, rel=0.15)
        assert other.median_angle_rad == pytest.approx(one.median_angle_rad, rel=0.15)


def ids_exchanged(lifted, last, camera):
    """Lifted cameras and iteration, the ids of two people of one camera exchanged halfway."""
    person_of = list(last.association.person_of)
    known = person_of[camera].copy()
    slot = known.shape[1] // 2
    first, second = np.flatnonzero((known[:, slot - 1 : slot + 1] >= 0).all(-1))[:2]
    known[[first, second], slot:] = known[[second, first], slot:]
    person_of[camera] = known
    start_s = last.association.start_s + slot * last.association.slot_s
    cam = lifted[last.rig.cameras[camera]]
    one, other = cam.tracks[first], cam.tracks[second]
    tracks = list(cam.tracks)
    tracks[first], tracks[second] = (
        spliced(before, after, cam.stamps + last.rig.offset_s[camera] < start_s)
        for before, after in ((one, other), (other, one))
    )
    cameras = list(lifted)
    cameras[last.rig.cameras[camera]] = replace(cam, tracks=tuple(tracks))
    return cameras, replace(last, association=replace(last.association, person_of=tuple(person_of)))


def spliced(before, after, early):
    """A track that is one until some time and another one from then on."""
    parts = ((before, early[before.frames]), (after, ~early[after.frames]))
    fields = ("frames", "x", "focal", "joints_cam", "root_cam")
    return replace(
        before,
        **{f: np.concatenate([getattr(track, f)[rows] for track, rows in parts]) for f in fields},
    )


def test_without_poses_bones_are_unknown(small_stages, last, without_poses):
    assert np.isnan(bone_rotations(without_poses, small_stages.skeleton, last)).all()
    before = pair_residuals(small_stages.lifted, small_stages.skeleton, last)
    after = pair_residuals(without_poses, small_stages.skeleton, last)
    assert np.isnan([pair.median_angle_rad for pair in after]).all()
    assert [replace(pair, median_angle_rad=0.0) for pair in after] == [
        replace(pair, median_angle_rad=0.0) for pair in before
    ]


def test_without_poses_distances_are_compared_with_the_size_of_limbs(
    small_stages, last, without_poses
):
    found = depth_ratios(without_poses, last)
    np.testing.assert_allclose(found, depth_ratios(small_stages.lifted, last), rtol=0.2)
    t = last.state.t_cam_ref.copy()
    t[1, 2] += 8.0
    far = depth_ratios(without_poses, replace(last, state=replace(last.state, t_cam_ref=t)))
    assert far[1] > 2 * found[1]
