"""Lenses that are estimated: those by which keypoints were undistorted, and what was known of them.

The unknowns are corrections of these lenses. What an adjustment finds is absorbed into them, and
the keypoints are undistorted again, so that the corrections are zero at the optimum.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.geometry.radial import RadialProfile, radial_columns, radial_profile
from stcalib_ros.core.model.arrays import BoolArray, Float64Array, IntArray
from stcalib_ros.core.model.lens_knowledge import LensPrior
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.recording import Intrinsics

FOCAL, CENTRE_X, CENTRE_Y, RADIAL = 0, 1, 2, 3
"""Rows of the corrections: of the focal length, of the principal point, and the first of the
coefficients of radial distortion. By definition."""

MOST_RADIAL = 2
"""Coefficients of radial distortion that can be estimated, count. Chosen: people are seen out to 60
degrees off the axis, where two describe a lens to a pixel."""

N_CORRECTIONS = RADIAL + MOST_RADIAL
"""Corrections of a lens, count: focal length, principal point, radial distortion. Derived."""

CORRELATED = 10.0
"""Ratio of the variance of what keypoints that are not independent tell to what they would. Chosen:
until it is measured; 5 to 30 in the recordings of benchmarks/data, 1 in simulated ones."""


@dataclass(frozen=True, slots=True, eq=False)
class Lenses:
    """Lenses of C cameras of which some are estimated.

    Attributes
    ----------
    intrinsics : tuple of Intrinsics
        Those that keypoints were undistorted by.
    profile : RadialProfile
    free : (5, C) ndarray of bool
        Which corrections of which lenses are estimated.
    mean, stddev : (5, C) ndarray
        What was known of the corrections; a standard deviation is infinite where nothing was.
    group : (C,) ndarray of int
        Cameras with one number have one lens.
    correlated : float
        Variance of what keypoints tell, over that of independent ones.
    """

    intrinsics: tuple[Intrinsics, ...]
    profile: RadialProfile
    free: BoolArray
    mean: Float64Array
    stddev: Float64Array
    group: IntArray
    correlated: float = CORRELATED

    def only(self, c: int) -> Lenses:
        """The lens of one camera."""
        own = slice(c, c + 1)
        return replace(
            self,
            intrinsics=self.intrinsics[own],
            profile=self.profile.only(own),
            free=self.free[:, own],
            mean=self.mean[:, own],
            stddev=self.stddev[:, own],
            group=self.group[own],
        )

    def information(self) -> Float64Array:
        """Inverse variances (5, C) of what was known, that of a shared lens counted once."""
        members = (self.group == self.group[:, None]).sum(1)
        shared = np.ones((N_CORRECTIONS, len(members)))
        shared[[FOCAL, *range(RADIAL, N_CORRECTIONS)]] = members
        return np.asarray(np.where(self.free, 1.0 / self.stddev**2, 0.0) / shared)

    def absorbing(self, values: Float64Array) -> Lenses:
        """Lenses with corrections (5, C) made."""
        corrected = tuple(
            corrected_lens(lens, values[:, c]) if self.free[:, c].any() else lens
            for c, lens in enumerate(self.intrinsics)
        )
        mean = self.mean.copy()
        mean[FOCAL] = (1.0 + mean[FOCAL]) / (1.0 + values[FOCAL]) - 1.0
        mean[CENTRE_X:] = (mean - values)[CENTRE_X:]
        mean[CENTRE_X:RADIAL] /= 1.0 + values[FOCAL]
        return replace(self, intrinsics=corrected, profile=radial_profile(corrected), mean=mean)


def estimated_lenses(cameras: Sequence[LiftedCamera]) -> Lenses | None:
    """Return the lenses of the cameras of a rig; None where all are given.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
    """
    known = [camera.intrinsics for camera in cameras]
    intrinsics = tuple(lens for lens in known if lens is not None)
    priors = [camera.lens_prior for camera in cameras]
    if all(prior is None for prior in priors) or len(intrinsics) < len(known):
        return None
    C = len(cameras)
    free: BoolArray = np.zeros((N_CORRECTIONS, C), dtype=bool)
    mean, stddev = np.zeros((N_CORRECTIONS, C)), np.full((N_CORRECTIONS, C), np.inf)
    for c, (lens, prior) in enumerate(zip(intrinsics, priors, strict=True)):
        if prior is not None:
            free[: RADIAL + len(prior.radial), c] = True
            mean[:, c], stddev[:, c] = _corrections(lens, prior)
    names = [camera.lens_group or str(c) for c, camera in enumerate(cameras)]
    group = np.array([names.index(name) for name in names], dtype=np.int64)
    return Lenses(intrinsics, radial_profile(intrinsics), free, mean, stddev, group)


def _corrections(lens: Intrinsics, prior: LensPrior) -> tuple[Float64Array, Float64Array]:
    """What was known of a lens, as corrections (5,) of another one, and standard deviations."""
    focal = focal_length(lens)
    mean, stddev = np.zeros(N_CORRECTIONS), np.full(N_CORRECTIONS, np.inf)
    n = len(prior.radial)
    mean[FOCAL], stddev[FOCAL] = prior.focal_px / focal - 1.0, prior.focal_stddev
    mean[CENTRE_X:RADIAL] = (np.array(prior.centre_px) - lens.K[:2, 2]) / focal
    stddev[CENTRE_X:RADIAL] = prior.centre_stddev_px / focal
    mean[RADIAL : RADIAL + n] = np.array(prior.radial) - radial_coefficients(lens)[:n]
    stddev[RADIAL : RADIAL + n] = prior.radial_stddev
    return mean, stddev


def focal_length(lens: Intrinsics) -> float:
    """Return the focal length of a lens, px: the geometric mean of both."""
    return float(np.sqrt(abs(lens.K[0, 0] * lens.K[1, 1])))


def radial_coefficients(lens: Intrinsics) -> Float64Array:
    """Return the coefficients k1, k2 of a lens; 0 where it has none."""
    return np.asarray(radial_profile([lens]).k[0, :MOST_RADIAL])


def corrected_lens(lens: Intrinsics, values: Float64Array) -> Intrinsics:
    """Return a lens with corrections (5,) made.

    Parameters
    ----------
    lens : Intrinsics
    values : (5,) ndarray
    """
    K = lens.K.copy()
    K[:2, 2] += values[CENTRE_X:RADIAL] * focal_length(lens)
    K[[0, 1], [0, 1]] *= 1.0 + values[FOCAL]
    columns = radial_columns(lens)
    D = lens.D
    if values[RADIAL:].any():
        D = np.pad(D, (0, max(0, int(columns.max()) + 1 - D.size)))
        D[columns[:MOST_RADIAL]] += values[RADIAL:]
    return replace(lens, K=K, D=D)
