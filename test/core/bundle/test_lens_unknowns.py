"""Corrections of lenses: what they do to points, what is absorbed, shared and known before."""

from dataclasses import replace

import numpy as np
import pytest
from bundle_helpers import FOCAL_PX, problem

from stcalib_ros.core.bundle.lens_unknowns import LENS_UNKNOWNS, corrections, layout_of
from stcalib_ros.core.bundle.lenses import (
    CENTRE_X,
    FOCAL,
    N_CORRECTIONS,
    RADIAL,
    Lenses,
    corrected_lens,
    estimated_lenses,
)
from stcalib_ros.core.bundle.levenberg_marquardt import adjust
from stcalib_ros.core.bundle.parameters import Cameras
from stcalib_ros.core.bundle.point_views import PointTimes, PointView
from stcalib_ros.core.geometry.lens import bearings, project
from stcalib_ros.core.geometry.radial import radial_profile
from stcalib_ros.core.model.lens_knowledge import LensPrior
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.recording import Intrinsics, LensModel

K = np.array([[FOCAL_PX, 0, 960.0], [0, FOCAL_PX, 540.0], [0, 0, 1]])
PINHOLE = Intrinsics(1920, 1080, LensModel.PLUMB_BOB, K, np.zeros(5))
WIDE = replace(PINHOLE, D=np.array([-0.2, 0.05, 0, 0, 0]))
FISHEYE = replace(PINHOLE, model=LensModel.EQUIDISTANT, D=np.array([0.05, -0.01, 0, 0]))


def lenses_of(*intrinsics, stddev=np.inf, group=None, free=N_CORRECTIONS):
    C = len(intrinsics)
    mask = np.zeros((N_CORRECTIONS, C), dtype=bool)
    mask[:free] = True
    return Lenses(
        intrinsics,
        radial_profile(intrinsics),
        mask,
        np.zeros((N_CORRECTIONS, C)),
        np.full((N_CORRECTIONS, C), stddev),
        np.arange(C) if group is None else np.array(group),
        correlated=1.0,
    )


@pytest.mark.parametrize("row", range(N_CORRECTIONS))
@pytest.mark.parametrize("lens", [PINHOLE, WIDE, FISHEYE])
def test_a_correction_moves_points_as_undistortion_by_the_corrected_lens_would(rng, lens, row):
    """What the unknown adds to a point is what the lens takes from its keypoint, reversed."""
    X = rng.uniform([-2, -1, 3], [2, 1, 6], (40, 3))
    step = 1e-6 * np.eye(N_CORRECTIONS)[row]
    pixels = project(X, lens)
    moved = bearings(pixels, lens)[0] - bearings(pixels, corrected_lens(lens, step))[0]
    Z = X.T[None]
    view = PointView(Z, 0 * Z, Z, PointTimes(np.zeros(1), np.zeros((1, 1))), lenses_of(lens))
    displacement = LENS_UNKNOWNS[row].derivative(view)[0, 0]
    on_plane = (displacement[:2] - X.T[:2] / X.T[2] * displacement[2]) / X.T[2]
    np.testing.assert_allclose(on_plane.T, moved / 1e-6, rtol=2e-4, atol=2e-6)


def test_cameras_without_lenses_have_no_such_displacement():
    Z = np.ones((1, 3, 2))
    view = PointView(Z, 0 * Z, Z, PointTimes(np.zeros(1), np.zeros((1, 1))))
    with pytest.raises(TypeError, match="lenses of the cameras are needed"):
        LENS_UNKNOWNS[FOCAL].derivative(view)


def test_the_steps_of_a_shared_lens_are_one():
    own = layout_of(3, lenses_of(*[PINHOLE] * 3), synchronised=False)
    shared = layout_of(3, lenses_of(*[PINHOLE] * 3, group=[0, 1, 1]), synchronised=False)
    assert own.n_free() - shared.n_free() == 3  # focal length, k1 and k2, not the centre
    H = np.diag(np.arange(1.0, shared.size + 1))
    cameras = Cameras(np.stack([np.eye(3)] * 3), np.eye(3), np.zeros(3))
    step = shared.solve(H, np.ones(shared.size), cameras)
    focal, centre = (shared.within(LENS_UNKNOWNS[row]).start for row in (FOCAL, CENTRE_X))
    assert step[1, focal] == step[2, focal] != step[0, focal]
    assert step[1, centre] != step[2, centre]
    P = shared.inverse(H, cameras)
    a, b = shared.scalars(LENS_UNKNOWNS[FOCAL])[1:]
    assert P[a, a] == pytest.approx(P[a, b])


def test_what_was_known_of_a_shared_lens_counts_once():
    lenses = lenses_of(*[PINHOLE] * 3, stddev=0.1, group=[0, 1, 1])
    known = lenses.information()
    np.testing.assert_allclose(known[FOCAL], [100, 50, 50])
    np.testing.assert_allclose(known[CENTRE_X], 100)


def lens_problem(rng, error, **how):
    """A problem whose keypoints were undistorted by focal lengths that are off by some ratio."""
    p = problem(rng, cameras=3, people=4, time_bins=30, joints=5, sigma_px=0.3, **how)
    lens = replace(
        PINHOLE, K=np.diag([1, 1, 1 / (FOCAL_PX * (1 + error))]) * FOCAL_PX * (1 + error)
    )
    lenses = lenses_of(lens, lens, lens, stddev=0.01, free=1)
    lenses = replace(lenses, stddev=np.full((N_CORRECTIONS, 3), np.inf))
    o = replace(p.o, x=p.o.x / (1 + error), focal=p.o.focal * (1 + error), lenses=lenses)
    return o, replace(p.truth, lenses=lenses)


def test_an_adjustment_finds_focal_lengths(rng):
    o, start = lens_problem(rng, 0.03)
    state = adjust(o, start, iterations=30, tolerance=1e-3)
    found = corrections(state.cameras)[FOCAL]
    np.testing.assert_allclose(found, 1 / 1.03 - 1, atol=4e-3)


def test_what_is_known_for_sure_stays(rng):
    o, start = lens_problem(rng, 0.03)
    lenses = replace(start.lenses, stddev=np.full((N_CORRECTIONS, 3), 1e-6))
    state = adjust(o, replace(start, lenses=lenses), iterations=30, tolerance=1e-3)
    np.testing.assert_allclose(corrections(state.cameras)[FOCAL], 0, atol=1e-4)


def test_absorbed_corrections_leave_nothing_to_correct():
    lens = replace(WIDE, K=K.copy())
    prior = LensPrior(1500.0, 0.1, (950.0, 545.0), 20.0, (-0.1, 0.0), 0.2)
    camera = LiftedCamera("a", np.zeros(1), (), intrinsics=lens, lens_prior=prior)
    given = LiftedCamera("b", np.zeros(1), (), intrinsics=PINHOLE)
    lenses = estimated_lenses([camera, given])
    assert lenses is not None
    assert not lenses.free[:, 1].any()
    after = lenses.absorbing(lenses.mean * lenses.free)
    found = after.intrinsics[0]
    assert found.K[0, 0] == pytest.approx(1500.0)
    np.testing.assert_allclose(found.K[:2, 2], [950.0, 545.0])
    np.testing.assert_allclose(found.D[:2], [-0.1, 0.0])
    assert after.intrinsics[1] is PINHOLE
    np.testing.assert_allclose(after.mean[: RADIAL + 2, 0], 0, atol=1e-12)


def test_lenses_that_are_given_are_no_unknowns():
    camera = LiftedCamera("a", np.zeros(1), (), intrinsics=PINHOLE)
    assert estimated_lenses([camera, camera]) is None
