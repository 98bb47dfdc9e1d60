"""People of a calibration against the simulated truth."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from stcalib_ros.core.model.calibration import Status
from stcalib_ros.core.model.keypoint_layouts import LAYOUTS
from stcalib_ros.core.pipeline import run_stages
from stcalib_ros.core.reconstruction.trajectories import bones, person_rows
from stcalib_ros.core.stages import Stages
from stcalib_ros.core.synthetic import Scene, SceneOptions, simulate
from stcalib_ros.io.mocap import shipped_clips

OPTIONS = SceneOptions(
    n_cameras=3,
    n_people=2,
    n_frames=150,
    max_offset_frames=5,
    sigma_px=0.2,
    flip_rate=0.0,
    id_switches_per_10s=0.0,
    seed=2,
)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return simulate(OPTIONS, clips=shipped_clips())


@pytest.fixture(scope="module")
def stages(scene: Scene) -> Stages:
    found = run_stages(scene.recording)
    assert found.calibration.status is Status.OK
    return found


def true_person(scene: Scene, tracks: dict[str, tuple[int, ...]]) -> int:
    (person,) = (p.person_id for p in scene.truth.persons if dict(p.tracks) == tracks)
    return person


def test_joints_are_where_they_were(scene: Scene, stages: Stages) -> None:
    calibration, truth = stages.calibration, scene.truth
    scale = np.linalg.norm(truth.cameras[1].t_ref_cam) / np.linalg.norm(
        calibration.cameras[1].t_ref_cam
    )
    people = stages.trajectories()
    assert [p.person_id for p in people] == [p.person_id for p in calibration.persons] == [0, 1]
    for trajectory, person in zip(people, calibration.persons, strict=True):
        true = scene.joints_ref(trajectory.times_s)[true_person(scene, dict(person.tracks))]
        error = np.linalg.norm(scale * trajectory.joints_ref - true, axis=-1)
        known = np.isfinite(error)
        assert known.mean() > 0.8
        assert np.median(error[known]) < 0.002
        assert np.percentile(error[known], 99) < 0.02
        assert trajectory.layout.joint_names == LAYOUTS["h36m_17"].joint_names


def test_times_are_uniform_and_cover_the_recording(scene: Scene, stages: Stages) -> None:
    for trajectory in stages.trajectories():
        assert np.diff(trajectory.times_s) == pytest.approx(1 / 30.0, abs=1e-6)
        assert len(trajectory.times_s) == len(trajectory.joints_ref)
        assert np.ptp(trajectory.times_s) > 4.0


def test_the_unit_is_that_of_the_calibration(scene: Scene) -> None:
    """Not metric: the first baseline is 1, and the people shrink with it."""
    cameras = tuple(dataclasses.replace(c, metric=False) for c in scene.recording.cameras)
    stages = run_stages(dataclasses.replace(scene.recording, cameras=cameras))
    assert np.linalg.norm(stages.calibration.cameras[1].t_ref_cam) == pytest.approx(1.0)
    baseline = np.linalg.norm(scene.truth.cameras[1].t_ref_cam)
    (first, _) = stages.trajectories()
    height = np.nanmedian(np.ptp(first.joints_ref, axis=1).max(-1))
    assert height * baseline == pytest.approx(1.6, abs=0.4)


def test_each_person_has_rows_of_their_own(stages: Stages) -> None:
    rows = person_rows(stages.lifted, stages.iterations[-1])
    assert not set(rows[0]) & set(rows[1])
    persons = stages.iterations[-1].observations.person
    assert all(len(set(persons[r])) == 1 for r in rows)


def test_nobody_without_a_calibration() -> None:
    stages = run_stages(simulate(dataclasses.replace(OPTIONS, n_cameras=1)).recording)
    assert stages.calibration.cameras == ()
    assert stages.trajectories() == ()
    assert stages.placement is None


@pytest.mark.parametrize("name", LAYOUTS)
def test_bones_connect_hips_and_wrists(name: str) -> None:
    layout = LAYOUTS[name]
    joined = {layout.joint_names.index("left_wrist")}
    for _ in layout.joint_names:
        joined |= {j for pair in bones(layout) if joined & set(pair) for j in pair}
    limbs = ("right_wrist", "left_ankle", "right_ankle", "left_hip", "right_shoulder")
    assert {layout.joint_names.index(limb) for limb in limbs} <= joined
