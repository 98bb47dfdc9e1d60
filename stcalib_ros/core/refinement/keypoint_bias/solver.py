"""Cameras, joint positions and key point biases that explain the image points best together."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.bundle.levenberg_marquardt import solve_reduced
from stcalib_ros.core.bundle.normal_equations import CAMERA, Cameras, ReducedSystem
from stcalib_ros.core.bundle.observations import Observations
from stcalib_ros.core.bundle.residuals import errors_px, robust_scale
from stcalib_ros.core.bundle.state import BundleState, person_rows_of
from stcalib_ros.core.geometry.robust import CAUCHY, MIN_SCALE_PX, RAYLEIGH_MEDIAN
from stcalib_ros.core.geometry.so3 import exp_so3
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.refinement.keypoint_bias.harmonics import (
    DEGREE_OF,
    DEGREES,
    body_frames,
    harmonics,
)
from stcalib_ros.core.refinement.keypoint_bias.normal_equations import (
    Part,
    follow,
    look,
    person_sums,
)

_CHUNK = 64
_FIRST_SPREAD = 0.02
_LEAST_SPREAD = 1e-5
_ITERATIONS = 10
_SETTLED = 0.3
_LEAST_SHARE = 0.2


@dataclass(frozen=True, slots=True, eq=False)
class BiasFit:
    """An optimum, or a step on the way to it.

    Attributes
    ----------
    cameras : Cameras
    X : tuple of (3, J, n) ndarray
        Joints of every part.
    bias : (P, J, 3, B) ndarray
        Coefficients of the harmonics by person and joint, in body axes.
    variance : (B,) ndarray
        Of the prior of the coefficients.
    sigma_px : float
        Noise of the image points, per axis.
    """

    cameras: Cameras
    X: tuple[Float64Array, ...]
    bias: Float64Array
    variance: Float64Array
    sigma_px: float


@dataclass(frozen=True, slots=True, eq=False)
class EliminatedBiases:
    """The system of the cameras, joints and biases eliminated, and what the biases need to follow.

    Attributes
    ----------
    system : ReducedSystem
    known : (7 C, 7 C) ndarray
        Normal equations of the cameras if the biases were known.
    inverse : (P, J, 3 B, 3 B) ndarray
        Covariance of the biases, cameras given.
    told : (P, J, 3 B) ndarray
        What the image points say about each of them: diagonal of their normal equations.
    gradient : (P, J, 3 B) ndarray
    mixed : (P, J, 3 B, 7 C) ndarray
    """

    system: ReducedSystem
    known: Float64Array
    inverse: Float64Array
    told: Float64Array
    gradient: Float64Array
    mixed: Float64Array

    def hints_at_biases(self) -> bool:
        """Whether some harmonics of a small variance would explain the image points better.

        At a fit without biases. The score test: the marginal likelihood rises with a variance
        from zero on if the squares of the gradient are larger than noise makes them.
        """
        squares, told = (
            v.reshape(-1, len(DEGREE_OF)).sum(0) for v in (self.gradient**2, self.told)
        )
        return any(squares[d == DEGREE_OF].sum() > told[d == DEGREE_OF].sum() for d in DEGREES)

    def taken(self, variance: Float64Array) -> Float64Array:
        """Degrees of freedom (B,) that the biases take up, by harmonic."""
        diagonal = np.diagonal(self.inverse, axis1=-2, axis2=-1)
        share = 1.0 - diagonal / np.tile(variance, 3)
        return np.asarray(share.reshape(-1, 3, len(variance)).sum((0, 1)))


def parts_of(o: Observations, s: BundleState, trunk: tuple[int, ...]) -> Iterator[Part]:
    """All image points, a few rows of one person at a time."""
    centres = -np.einsum("cji,cj->ci", s.R_cam_ref, s.t_cam_ref)
    for person, rows in enumerate(person_rows_of(o)):
        for begin in range(rows.start, rows.stop, _CHUNK):
            part = slice(begin, min(begin + _CHUNK, rows.stop))
            R, direction = body_frames(s.X[part], trunk, centres)
            yield Part(
                person,
                part,
                o.x[part].transpose(1, 3, 2, 0).copy(),
                (o.focal[part] * s.used[part]).transpose(1, 2, 0).copy(),
                o.elapsed(part).transpose(1, 2, 0).copy(),
                s.V[part].transpose(2, 1, 0).copy(),
                s.A[part].transpose(2, 1, 0).copy(),
                R,
                harmonics(direction).swapaxes(0, 1).copy(),
            )


class Problem:
    """The image points of a round, and how the people stood.

    Parameters
    ----------
    o : Observations
    state : BundleState
        Joints that body axes and motion are read from.
    trunk : tuple of int
        As `trunk_of` gives it.
    """

    def __init__(self, o: Observations, state: BundleState, trunk: tuple[int, ...]) -> None:
        self.o, self.state, self.trunk = o, state, trunk
        self.parts = tuple(parts_of(o, state, trunk))

    def start(self) -> BiasFit:
        """Without biases; those to be expected are a few percent of the trunk."""
        o, s = self.o, self.state
        low_left, low_right, high_left, high_right = (s.X[:, j] for j in self.trunk)
        upward = high_left + high_right - low_left - low_right
        trunk = np.linalg.norm(upward, axis=-1) / 2.0
        n_persons = 1 + self.parts[-1].person
        return BiasFit(
            Cameras(s.R_cam_ref, s.t_cam_ref, s.shift_s),
            tuple(s.X[part.rows].transpose(2, 1, 0).copy() for part in self.parts),
            np.zeros((n_persons, o.x.shape[2], 3, len(DEGREE_OF))),
            np.full(len(DEGREE_OF), float((_FIRST_SPREAD * np.median(trunk)) ** 2)),
            max(robust_scale(errors_px(o, s), s.used), MIN_SCALE_PX),
        )

    def solve(self) -> tuple[BiasFit, EliminatedBiases] | None:
        """The optimum and the system there; None where nothing hints at biases.

        By Gauss-Newton steps, the strength of the priors estimated anew after each.
        """
        fit = self.start()
        e = self.eliminate(fit)
        if not e.hints_at_biases():
            return None
        for _ in range(_ITERATIONS):
            fit, length = self.step(fit, e)
            e = self.eliminate(fit)
            if length < _SETTLED:
                break
        return fit, e

    def step(self, fit: BiasFit, e: EliminatedBiases) -> tuple[BiasFit, float]:
        """One step by the system there, and how many standard deviations the cameras moved."""
        d = -solve_reduced(e.system, fit.cameras.t, synchronised=self.state.synchronised)
        flat = d.ravel()
        d_bias = -np.einsum("pjab,pjb->pja", e.inverse, e.gradient + e.mixed @ flat)
        cameras = Cameras(
            exp_so3(d[:, :3]) @ fit.cameras.R,
            fit.cameras.t + d[:, 3:6],
            fit.cameras.shift + d[:, 6],
        )
        moved = replace(fit, cameras=cameras, bias=fit.bias + d_bias.reshape(fit.bias.shape))
        moved = self._rescaled(replace(moved, X=self.followed(moved)))
        length = max(float(flat @ e.system.H @ flat), 0.0) ** 0.5
        return self._renewed(moved, e.taken(fit.variance)), length

    def followed(self, fit: BiasFit) -> tuple[Float64Array, ...]:
        """Joints that suit the cameras and biases of a fit best."""
        scale = CAUCHY * fit.sigma_px
        return tuple(
            follow(part, fit.cameras, X, fit.bias[part.person], scale, 2)
            for part, X in zip(self.parts, fit.X, strict=True)
        )

    def _rescaled(self, fit: BiasFit) -> BiasFit:
        """The same with the first baseline as long as at the start."""
        t = fit.cameras.t
        grow = float(np.linalg.norm(self.state.t_cam_ref[1]) / np.linalg.norm(t[1]))
        cameras = replace(fit.cameras, t=grow * t)
        return replace(fit, cameras=cameras, X=tuple(grow * X for X in fit.X), bias=grow * fit.bias)

    def _renewed(self, fit: BiasFit, taken: Float64Array) -> BiasFit:
        """Noise, and variances of the biases by MacKay's fixed point: one per degree."""
        squares = (fit.bias**2).sum((0, 1, 2))
        variance = fit.variance.copy()
        for degree in DEGREES:
            mine = degree == DEGREE_OF
            variance[mine] = squares[mine].sum() / max(taken[mine].sum(), 1e-9)
        least = (_LEAST_SPREAD * float(np.linalg.norm(fit.cameras.t[1]))) ** 2
        errors = np.sqrt(np.concatenate(list(self._squares(fit))))
        points = sum(int(((part.focal > 0.0).sum(0) >= 2).sum()) for part in self.parts)
        share = 1.0 - (1.5 * points + 0.5 * float(taken.sum())) / len(errors)
        sigma = float(np.median(errors)) / RAYLEIGH_MEDIAN / max(share, _LEAST_SHARE) ** 0.5
        return replace(fit, variance=np.maximum(variance, least), sigma_px=max(sigma, MIN_SCALE_PX))

    def eliminate(self, fit: BiasFit) -> EliminatedBiases:
        """Eliminate joints and biases at a fit."""
        P, J, _, B = fit.bias.shape
        k = CAMERA * len(fit.cameras.t)
        S = np.zeros((P, J, k + 3 * B + 1, k + 3 * B + 1))
        scale = CAUCHY * fit.sigma_px
        for part, X in zip(self.parts, fit.X, strict=True):
            S[part.person] += person_sums(part, fit.cameras, X, fit.bias[part.person], scale)
        S /= fit.sigma_px**2
        precision = np.tile(1.0 / fit.variance, 3)
        own = slice(k, k + 3 * B)
        told = np.diagonal(S[:, :, own, own], axis1=-2, axis2=-1)
        inverse = np.linalg.inv(S[:, :, own, own] + np.diag(precision))
        gradient = S[:, :, own, -1] + precision * fit.bias.reshape(P, J, 3 * B)
        mixed = S[:, :, own, :k]
        gain = mixed.swapaxes(-1, -2) @ inverse
        known = S[:, :, :k, :k].sum((0, 1))
        H = known - (gain @ mixed).sum((0, 1))
        g = S[:, :, :k, -1].sum((0, 1)) - np.einsum("pjkb,pjb->k", gain, gradient)
        return EliminatedBiases(ReducedSystem(H, g), known, inverse, told, gradient, mixed)

    def log_gain(self, fit: BiasFit, e: EliminatedBiases) -> float:
        """By how much biases explain the image points better than none (Laplace).

        Logarithm of the ratio of the marginal likelihoods.

        Parameters
        ----------
        fit : Fit
            The optimum.
        e : Eliminated
            There.
        """
        start = replace(self.start(), sigma_px=fit.sigma_px)
        plain = replace(start, X=self.followed(start))
        spread = np.tile(np.sqrt(fit.variance), 3)
        volume = np.linalg.slogdet(e.inverse / np.outer(spread, spread))[1].sum()
        prior = (fit.bias**2 / fit.variance).sum()
        return float(self._cost(plain) - self._cost(fit) - 0.5 * prior + 0.5 * volume)

    def _cost(self, fit: BiasFit) -> float:
        """Negative logarithm of the likelihood, up to a constant."""
        width = (CAUCHY * fit.sigma_px) ** 2
        return 0.5 * CAUCHY**2 * sum(float(np.log1p(s / width).sum()) for s in self._squares(fit))

    def _squares(self, fit: BiasFit) -> Iterator[Float64Array]:
        """Squared residuals of the image points that take part, by part and camera."""
        scale = CAUCHY * fit.sigma_px
        for part, X in zip(self.parts, fit.X, strict=True):
            for c in range(len(fit.cameras.t)):
                seen = look(part, c, fit.cameras, X, fit.bias[part.person], scale)
                yield np.minimum(seen.squared[part.focal[c] > 0.0], (1e3 * scale) ** 2)
