"""Lenses of simulated cameras, from the agreements of their pairs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import SMALL, every, lifted
from numpy.testing import assert_allclose

from stcalib_ros.core.geometry.lens import bearings, project
from stcalib_ros.core.lifting.assumed_lenses import with_assumed_lenses
from stcalib_ros.core.model.lens_knowledge import LensKnowledge
from stcalib_ros.core.model.recording import CameraRecording, Intrinsics, LensModel, Recording
from stcalib_ros.core.options import LensOptions, Options
from stcalib_ros.core.registration.pairs import PairTask, agreements, pair_tasks, with_agreements
from stcalib_ros.core.registration.resampling import common_grid
from stcalib_ros.core.registration.unknown_lenses import find_lenses
from stcalib_ros.core.synthetic import simulate

OPTIONS = Options(offset_range_s=0.5)
ROOM = replace(
    SMALL,
    n_cameras=4,
    n_people=3,
    focal_px=500.0,
    ring_radius_m=(2.2, 3.0),
    area_radius_m=1.8,
)
"""Views of 125 degrees."""


def with_lens(lens: Intrinsics):
    """The same scene by another lens."""

    def change(camera: CameraRecording) -> CameraRecording:
        tracks = []
        for track in camera.tracks:
            x = bearings(track.keypoints, camera.intrinsics)[0]
            rays = np.concatenate([x, np.ones((*x.shape[:-1], 1))], -1)
            tracks.append(replace(track, keypoints=project(rays, lens)))
        return replace(camera, tracks=tuple(tracks), intrinsics=lens)

    return change


def pairs(recording: Recording) -> tuple:
    """Skeleton, lifted cameras and tasks by the lenses of a recording."""
    skeleton, cameras = lifted(recording)
    grid = common_grid(cameras)
    order = range(len(cameras))
    return skeleton, cameras, pair_tasks(cameras, order, skeleton, OPTIONS, grid=grid)


def found_lenses(recording: Recording, options: LensOptions | None = None, **knowledge: str):
    """Lenses by camera, where all are unknown but some."""
    told = tuple(
        replace(c, lens_knowledge=LensKnowledge(knowledge.get(c.name, "unknown")))
        for c in recording.cameras
    )
    started = with_assumed_lenses(replace(recording, cameras=told), OPTIONS)
    skeleton, cameras, tasks = pairs(started.recording)
    found = [agreements(task) for task in tasks]
    return find_lenses(cameras, skeleton, tasks, found, options or LensOptions())


@pytest.fixture(scope="module")
def scene():
    return simulate(replace(SMALL, n_cameras=4, seed=1))


def test_focal_lengths_of_a_usual_scene_are_within_four_percent(scene):
    lenses = found_lenses(scene.recording)
    assert sorted(lenses) == [0, 1, 2, 3]
    for lens in lenses.values():
        assert lens.model is LensModel.PLUMB_BOB
        assert lens.K[0, 0] == pytest.approx(1400.0, rel=0.04)
        assert_allclose(lens.K[:2, 2], [959.5, 539.5])
        assert abs(lens.D[0]) < 0.1


def test_without_radial_terms_there_is_no_distortion(scene):
    lenses = found_lenses(scene.recording, LensOptions(radial_terms=0))
    assert all(not lens.D.any() for lens in lenses.values())


def test_cameras_of_one_model_have_one_lens(scene):
    some = {"cam1", "cam2"}
    grouped = every(
        scene.recording, lambda c: replace(c, lens_group="model" if c.name in some else "")
    )
    focal = [lens.K[0, 0] for lens in found_lenses(grouped).values()]
    assert np.ptp(focal[1:3]) < 0.02 * focal[1]
    assert len({round(f) for f in focal}) > 1


def test_given_lenses_stay_and_refined_ones_keep_their_distortion(scene):
    off = replace(scene.recording.cameras[1].intrinsics, D=np.array([0.01, 0, 0, 0, 0]))
    off.K[[0, 1], [0, 1]] *= 1.08
    cameras = tuple(
        replace(c, intrinsics=off) if c.name == "cam1" else c for c in scene.recording.cameras
    )
    lenses = found_lenses(
        replace(scene.recording, cameras=cameras), cam0="given", cam1="refine", cam2="given"
    )
    assert sorted(lenses) == [1, 3]
    assert lenses[1].K[0, 0] == pytest.approx(1400.0, rel=0.03)
    assert_allclose(lenses[1].D, off.D)
    assert lenses[3].K[0, 0] == pytest.approx(1400.0, rel=0.03)


def test_fisheyes_are_found_to_be_some():
    K = np.array([[880.0, 0, 959.5], [0, 880.0, 539.5], [0, 0, 1]])
    fisheye = Intrinsics(1920, 1080, LensModel.EQUIDISTANT, K, np.zeros(4))
    recording = every(simulate(ROOM).recording, with_lens(fisheye))
    for lens in found_lenses(recording).values():
        assert lens.model is LensModel.EQUIDISTANT
        assert lens.K[0, 0] == pytest.approx(880.0, rel=0.04)


def test_wide_pinholes_are_no_fisheyes():
    for lens in found_lenses(simulate(ROOM).recording).values():
        assert lens.model is LensModel.PLUMB_BOB
        assert lens.K[0, 0] == pytest.approx(500.0, rel=0.05)


def test_pairs_without_common_people_say_nothing(scene):
    apart = tuple(
        replace(c, stamps=c.stamps + 100.0 * k) for k, c in enumerate(scene.recording.cameras)
    )
    assert found_lenses(replace(scene.recording, cameras=apart)) == {}


def by_pinholes(recording: Recording, ratio: float) -> Recording:
    def change(camera: CameraRecording) -> CameraRecording:
        K = camera.intrinsics.K * [[ratio, 1, 1], [1, ratio, 1], [1, 1, 1]]
        return replace(camera, intrinsics=replace(camera.intrinsics, K=K))

    return every(recording, change)


def test_what_agrees_is_the_same_by_other_pinholes(scene):
    """And so is what is made of agreements that were found by them."""
    before, task = (pairs(by_pinholes(scene.recording, f))[2][0] for f in (0.7, 1.0))
    found, again = agreements(before), agreements(task)
    carried = with_agreements(task, before, found)
    assert carried.found is not None
    for one, other in zip(carried.found[:2], again[:2], strict=True):
        assert one.matches == other.matches
        assert one.lag == pytest.approx(other.lag, abs=0.01)
        assert one.error_px == pytest.approx(other.error_px, rel=1e-6)
        assert_allclose(
            np.abs(one.E / np.linalg.norm(one.E)),
            np.abs(other.E / np.linalg.norm(other.E)),
            atol=0.02,
        )


def test_pieces_of_other_frames_are_searched_again(scene):
    task = pairs(scene.recording)[2][0]
    shorter = every(scene.recording, lambda c: replace(c, tracks=tuple(t[2:] for t in c.tracks)))
    other: PairTask = pairs(shorter)[2][0]
    assert with_agreements(task, other, agreements(other)).found is None
