"""What the normal equations of a solved rig say of lenses that were given: another one, or not.

One linearisation at the solution tells, for the lens of any camera or for one ratio of all focal
lengths, what its correction would be if poses, clocks and people followed, and how much better
everything would fit.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from stcalib_ros.core.bundle.covariance import information
from stcalib_ros.core.bundle.iteration import Iteration, absorbed
from stcalib_ros.core.bundle.lens_unknowns import LENS_UNKNOWNS
from stcalib_ros.core.bundle.lenses import (
    CENTRE_X,
    CENTRE_Y,
    FOCAL,
    N_CORRECTIONS,
    RADIAL,
    Lenses,
)
from stcalib_ros.core.bundle.levenberg_marquardt import adjust
from stcalib_ros.core.bundle.limits import TOLERANCE
from stcalib_ros.core.bundle.outliers import drop_outliers
from stcalib_ros.core.bundle.parameters import CameraUnknown, ParameterLayout, PointView
from stcalib_ros.core.geometry.radial import radial_profile
from stcalib_ros.core.model.arrays import BoolArray, Float64Array
from stcalib_ros.core.model.recording import Intrinsics
from stcalib_ros.core.options import BundleOptions

_KEYPOINTS = 12_000
"""Count. About so many keypoints are looked at, whole images at regular intervals: they determine a
focal length to 0.3 % on scenes of benchmarks.accuracy.level. Cost alone: 3 % of a calibration."""
_FREE = (FOCAL, CENTRE_X, CENTRE_Y, RADIAL)
"""Corrections of a lens that are looked at, rows of `Lenses`. By definition."""
_STDDEV = 0.5
"""Standard deviation of corrections before anything is known: of ratios, on the plane z = 1, and of
k1. Numerical: 50 times what people in a part of the image determine, so that it changes nothing."""
_STEPS = 6
"""Steps of an adjustment between two choices of inliers. Numerical: usually three."""
_ROUNDS = 10
"""Such adjustments at most. Numerical: usually three; ten of an image that is turned."""
_SETTLED = 0.002
"""Ratio, or units of the plane z = 1. Corrections that still move by less have settled. Numerical:
the standard deviation of most of them."""


def _by_aspect(view: PointView) -> Float64Array:
    """Displacements of points by the logarithm of the square root of fx / fy."""
    at = view.on_plane
    d = at.u * at.lens.gain[..., None, :]
    by_x, by_y = (LENS_UNKNOWNS[row].derivative(view) for row in (CENTRE_X, CENTRE_Y))
    x, y = (d[..., axis, None, None, :] for axis in range(2))
    return np.asarray(by_x * x - by_y * y)


ASPECT = CameraUnknown("aspect", "ratio", relative=False, displacements=_by_aspect)
"""Logarithm of the square root of fx / fy: of an image whose width and height are scaled apart."""

_TESTED = (*(LENS_UNKNOWNS[row] for row in _FREE), ASPECT)


class Hypothesis(NamedTuple):
    """Lenses that may be others than those given.

    Attributes
    ----------
    cameras : (C,) ndarray of bool
    common : bool
        All focal lengths are off by one ratio, and nothing else is.
    significance : float
        How many standard deviations the corrections are away from zero (Mahalanobis length).
    """

    cameras: BoolArray
    common: bool = False
    significance: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class LensTrial:
    """A part of the images of a rig, and cameras whose lenses are put to the test.

    Attributes
    ----------
    part : Iteration
    given : tuple of Intrinsics
        Lenses of all cameras as they were given.
    cameras : (C,) ndarray of bool
        Cameras that are tested.
    """

    part: Iteration
    given: tuple[Intrinsics, ...]
    cameras: BoolArray

    @property
    def lenses(self) -> Lenses:
        """As they were found so far."""
        lenses = self.part.state.lenses
        if lenses is None:
            raise AssertionError("lenses that are tested have corrections")
        return lenses

    def layout(self, one: Hypothesis) -> ParameterLayout:
        """Unknowns of a hypothesis."""
        freed, lenses = one.cameras, self.lenses
        layout = self.part.state.layout.with_unknown(ASPECT, self.cameras)
        for row, unknown in zip((*_FREE, None), _TESTED, strict=True):
            own = freed & (row == FOCAL or not one.common)
            estimated = own if row is None else np.where(self.cameras, own, lenses.free[row])
            layout = layout.estimating(unknown, estimated)
        group = np.where(freed, int(freed.argmax()), lenses.group) if one.common else lenses.group
        return replace(layout, group=group)

    def fitted(self, one: Hypothesis) -> LensTrial:
        """The same after an adjustment of a hypothesis, inliers chosen anew."""
        found = self
        for _ in range(_ROUNDS):
            last, before = found.part, found.corrections()
            obs, layout = last.observations, found.layout(one)
            state = adjust(obs, last.state, iterations=_STEPS, tolerance=TOLERANCE, layout=layout)
            last = absorbed(replace(last, state=state))
            obs, state = last.observations, last.state
            state = drop_outliers(obs, state.with_inliers(obs.observed), BundleOptions())
            found = replace(found, part=replace(last, state=state))
            if np.abs(found.corrections() - before).max() < _SETTLED:
                break
        return found

    def corrections(self) -> Float64Array:
        """How far lenses (C, 5) are from those given, in the order of `LENS`."""
        found = self.lenses.intrinsics
        aspect = self.part.state.cameras.value(ASPECT)
        return np.array(
            [_difference(a, b, k) for a, b, k in zip(self.given, found, aspect, strict=True)]
        )


LENS = ("focal", "x", "y", "radial", "aspect")
"""Corrections of a lens: of the logarithm of the focal length, of the principal point on the plane
z = 1, of k1, and of the logarithm of the square root of fx / fy."""


def _difference(given: Intrinsics, found: Intrinsics, aspect: float) -> Float64Array:
    f, g = (np.sqrt(lens.K[0, 0] * lens.K[1, 1]) for lens in (given, found))
    centre = (found.K[:2, 2] - given.K[:2, 2]) / f
    k = radial_profile([given, found]).k[:, 0]
    return np.array([np.log(g / f), *centre, k[1] - k[0], aspect])


def lens_trial(last: Iteration, given: Sequence[Intrinsics], cameras: BoolArray) -> LensTrial:
    """Put the lenses of some cameras of a round to the test.

    Parameters
    ----------
    last : Iteration
    given : sequence of Intrinsics
        Of all cameras of the rig.
    cameras : (C,) ndarray of bool
        Cameras that are tested; the others have a lens that is right, or is estimated anyway.
    """
    obs, state = last.observations, last.state
    rows = np.arange(0, len(obs.person), max(1, round(int(state.inlier.sum()) / _KEYPOINTS)))
    obs, state = obs.only(rows), state.only(rows)
    C = len(cameras)
    own = state.lenses or Lenses(
        tuple(given),
        radial_profile(given),
        np.zeros((N_CORRECTIONS, C), dtype=bool),
        np.zeros((N_CORRECTIONS, C)),
        np.full((N_CORRECTIONS, C), np.inf),
        np.arange(C),
    )
    free, stddev = own.free.copy(), own.stddev.copy()
    for row in _FREE:
        free[row, cameras] = True
        stddev[row, cameras] = _STDDEV
    lenses = replace(
        own, free=free, stddev=stddev, group=np.where(cameras, np.arange(C), own.group)
    )
    state = replace(state, lenses=lenses).with_inliers(state.inlier)
    part = replace(last, observations=replace(obs, lenses=lenses), state=state)
    return LensTrial(part, tuple(given), cameras)


class LensSystem:
    """The normal equations of a round by everything, its tested lenses included.

    Parameters
    ----------
    trial : LensTrial
    """

    def __init__(self, trial: LensTrial) -> None:
        self.trial = trial
        layout = trial.layout(Hypothesis(trial.cameras))
        last = trial.part
        known = information(last.observations, last.state, layout, of_poses=False)
        variance = known.variance(layout)
        before, deviation = layout.prior(known.cameras)
        self.cameras = known.cameras
        self.H = known.system.H / variance + np.diag(before)
        self.g = known.system.g / variance + before * deviation

    def best(self, beside: Hypothesis) -> Hypothesis:
        """Return what is most significant, beside what is free anyway.

        Parameters
        ----------
        beside : Hypothesis
        """
        return max(
            (self._judged(one, beside) for one in self._further(beside)),
            key=lambda one: one.significance,
            default=beside._replace(significance=0.0),
        )

    def _further(self, beside: Hypothesis) -> Iterator[Hypothesis]:
        """One more camera each; one ratio of all, or all on their own."""
        every, free = self.trial.cameras, beside.cameras
        if beside.common:
            yield Hypothesis(every)
            return
        for one in np.eye(len(every), dtype=bool):
            if (one & every & ~free).any():
                yield Hypothesis(free | one)
        if not free.any() and every.sum() > 1:
            yield Hypothesis(every, common=True)

    def _judged(self, one: Hypothesis, beside: Hypothesis) -> Hypothesis:
        gained = self._gain(one) - self._gain(beside)
        return one._replace(significance=float(np.sqrt(max(gained, 0.0))))

    def _gain(self, one: Hypothesis) -> float:
        """Squared Mahalanobis length of the step of all that is free."""
        step = self.trial.layout(one).solve(self.H, self.g, self.cameras)
        return float(step.ravel() @ self.g)

    def stddev(self, one: Hypothesis) -> Float64Array:
        """Standard deviations (C, 5) of the corrections of a hypothesis, in the order of `LENS`."""
        layout = self.trial.layout(one)
        variance = np.diag(layout.inverse(self.H, self.cameras))
        found = [np.sqrt(np.maximum(variance[layout.scalars(each)], 0.0)) for each in _TESTED]
        return np.stack(found, -1)
