"""Bundle adjustment with one velocity per window, and outlier removal."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import lifted, true_rig

from stcalib_ros.core.bundle.observations import Observations
from stcalib_ros.core.geometry.so3 import rotation_angle
from stcalib_ros.core.integration.association import Association
from stcalib_ros.core.integration.exclusions import Disconnected
from stcalib_ros.core.model.relative_pose import RelativePose
from stcalib_ros.core.options import BundleOptions, Options
from stcalib_ros.core.paper.registration import PairRegistration
from stcalib_ros.core.paper.stages import adjust_pairs
from stcalib_ros.core.paper.stba import adjust_rounds, discard, window_velocities
from stcalib_ros.core.registration.resampling import Grid
from stcalib_ros.core.synthetic import SceneOptions, paper_scene

STEP_S = 1 / 30


def rows(person, time_bin, joints=2):
    """Observations of which only the persons and time bins matter."""
    N = len(person)
    nothing = np.zeros((N, 2, joints))
    return Observations(
        np.array(person),
        np.array(time_bin),
        np.zeros((N, 2), dtype=np.int64),
        np.zeros((N, 2)),
        np.zeros((N, 2, joints, 2)),
        nothing,
        nothing.astype(bool),
        0.0,
        STEP_S,
    )


def test_velocities_are_the_slopes_of_numpy_window_by_window(rng):
    o = rows([0] * 9 + [1] * 4, [*range(3, 12), 0, 1, 5, 6])
    X = rng.normal(size=(13, 2, 3))
    present = rng.uniform(size=(13, 2)) < 0.8
    V = window_velocities(o, X, present, 5)
    group = o.person * 100 + o.time_bin // 5
    for g in np.unique(group):
        for j in range(2):
            use = (group == g) & present[:, j]
            times = STEP_S * o.time_bin[use]
            expected = np.polyfit(times, X[use, j], 1)[0] if len(times) > 1 else np.zeros(3)
            assert V[group == g, j] == pytest.approx(np.tile(expected, ((group == g).sum(), 1)))


@pytest.fixture(scope="module")
def scene():
    options = SceneOptions(n_cameras=4, n_people=3, n_frames=60, sigma_px=1.0, seed=3)
    return paper_scene(options, offset_frames=1.0)


def association_of(scene, exchanged=()):
    """The true persons; of `exchanged` cameras the first two are taken for one another."""
    n = len(scene.people)
    person_of = [np.arange(n)[:, None] for _ in scene.recording.cameras]
    for c in exchanged:
        person_of[c] = np.array([1, 0, *range(2, n)])[:, None]
    return Association(tuple(person_of), -0.1, 10.0, n, np.nan, {})


def adjusted(scene, association, rig, **more):
    return adjust_rounds(
        lifted(scene.recording)[1],
        rig,
        association,
        BundleOptions(**more),
        step_s=STEP_S,
        window=5,
        tick=lambda _: None,
    )


def angles(rig, scene):
    return rotation_angle(np.swapaxes(true_rig(scene).R_ref_cam, 1, 2) @ rig.R_ref_cam)


def test_clocks_that_start_a_frame_off_are_found(scene):
    start = replace(true_rig(scene), offset_s=np.zeros(4))
    done = adjusted(scene, association_of(scene), start)
    assert done[-1].rig.offset_s[1:] == pytest.approx(np.full(3, STEP_S), abs=0.1 * STEP_S)
    assert angles(done[-1].rig, scene).max() < 2e-3
    assert done[-1].observations.phi == pytest.approx(0.0, abs=1e-9)
    assert not done[-1].state.A.any()


def test_clocks_known_to_agree_stay(scene):
    start = replace(true_rig(scene), synchronised=True)
    done = adjusted(scene, association_of(scene), start)
    assert np.array_equal(done[-1].rig.offset_s, start.offset_s)
    assert not done[-1].state.shift_s.any()
    assert angles(done[-1].rig, scene).max() < 2e-3


def test_a_wrong_association_is_discarded(scene):
    done = adjusted(scene, association_of(scene, exchanged=[2]), true_rig(scene))
    assert len(done) > 1
    wrong, right = done[-1].association.person_of[2][:2, 0], done[-1].association.person_of[2][2, 0]
    assert wrong.tolist() == [-1, -1]
    assert right == 2
    for c in (0, 1, 3):
        assert done[-1].association.person_of[c][:, 0].tolist() == [0, 1, 2]
    assert angles(done[-1].rig, scene).max() < 2e-3


def test_an_association_that_fits_is_kept(scene):
    done = adjusted(scene, association_of(scene), true_rig(scene), rounds=2)
    association, o = discard(done[-1], 3.0)
    for before, after in zip(association_of(scene).person_of, association.person_of, strict=True):
        assert np.array_equal(before, after)
    assert np.array_equal(o.observed, done[-1].observations.observed)
    assert association.typical_px == done[-1].median_px


def test_cameras_that_share_nobody_fall_apart(scene):
    association = association_of(scene)
    nobody = tuple(np.where(c < 2, p, -1) for c, p in enumerate(association.person_of))
    found = adjusted(scene, replace(association, person_of=nobody), true_rig(scene))
    assert isinstance(found, Disconnected)
    assert found.groups[0] == (0, 1)


def test_cameras_without_a_registered_pair_between_them_fall_apart(scene):
    h = RelativePose(0, 1, np.eye(3), np.array([1.0, 0, 0]), 0.0, ((0, 0),), 1.0)
    pair = PairRegistration(h, np.array([0]), np.array([[0, 0, 0]]), 0.1)
    grid = Grid(0.0, STEP_S, 60)
    cameras, rig = lifted(scene.recording)[1], true_rig(scene)
    found = adjust_pairs(cameras, rig, [pair], Options(), grid, lambda *_: None)
    assert isinstance(found, Disconnected)
    assert found.groups == ((0, 1), (2,), (3,))
