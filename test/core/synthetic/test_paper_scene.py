"""The paper's synthetic observations."""

from __future__ import annotations

import numpy as np
import pytest

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.geometry.lens import project
from stcalib_ros.core.synthetic import SceneOptions, paper_scene

OPTIONS = SceneOptions(n_cameras=3, n_people=2, n_frames=80, sigma_px=2.0, seed=1)


@pytest.fixture(scope="module")
def scene():
    return paper_scene(OPTIONS)


def true_joints(scene, c):
    """(P, F, 17, 3) in the frame of camera c at its exposures."""
    world = scene.joints_world(scene.exposures_s[c])
    return world @ scene.rig.R_cam_world[c].T + scene.rig.t_cam_world[c]


@pytest.mark.parametrize("c", [0, 2])
def test_images_of_the_noisy_points_are_off_by_sigma(scene, c):
    camera = scene.recording.cameras[c]
    off = []
    for person, track in enumerate(camera.tracks):
        exact = project(true_joints(scene, c)[person][track.frames], camera.intrinsics)
        off.append(track.keypoints - exact)
        seen = np.isfinite(track.keypoints[..., 0])
        image = project(track.joints, camera.intrinsics)
        assert image[seen] == pytest.approx(track.keypoints[seen], abs=1e-6)
    assert np.nanstd(np.concatenate(off), axis=(0, 1)) == pytest.approx([2.0, 2.0], rel=0.05)


def test_noise_in_depth_is_as_large_as_across(scene):
    off = scene.recording.cameras[1].tracks[0].joints - true_joints(scene, 1)[0]
    depth = true_joints(scene, 1)[0, ..., 2]
    focal = scene.recording.cameras[1].intrinsics.K[0, 0]
    assert (off / depth[..., None]).std((0, 1)) * focal == pytest.approx([2.0] * 3, rel=0.08)


def test_tracks_are_the_people_and_clocks_are_five_frames_off(scene):
    assert scene.offsets_s == pytest.approx([0, 5 / 30, 5 / 30])
    for camera in scene.recording.cameras:
        assert [track.track_id for track in camera.tracks] == [0, 1]
    assert [dict(p.tracks) for p in scene.truth.persons] == [
        {f"cam{c}": (person,) for c in range(3)} for person in range(2)
    ]


def test_hidden_people_are_never_seen():
    scene = paper_scene(OPTIONS, hidden={1: [0]})
    assert [len(t.frames) for t in scene.recording.cameras[1].tracks] == [0, 80]
    assert set(scene.truth.persons[0].tracks) == {"cam0", "cam2"}


def test_every_camera_may_have_its_own_offset():
    assert paper_scene(OPTIONS, offset_frames=[-2, 3.5]).offsets_s == pytest.approx(
        [0, -2 / 30, 3.5 / 30]
    )
    with pytest.raises(InputError, match="offset_frames: 3 offsets for 2 cameras"):
        paper_scene(OPTIONS, offset_frames=[1, 2, 3])


def test_the_seed_decides(scene):
    again = paper_scene(OPTIONS)
    one, same = (s.recording.cameras[2].tracks[1].joints for s in (scene, again))
    assert np.array_equal(one, same)
