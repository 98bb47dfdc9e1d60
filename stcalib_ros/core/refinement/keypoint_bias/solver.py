"""Cameras, joint positions and keypoint biases that explain the keypoints best together."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.bundle.covariance import EliminatedUnknown
from stcalib_ros.core.bundle.normal_equations import ReducedSystem
from stcalib_ros.core.bundle.observations import Observations
from stcalib_ros.core.bundle.parameters import WORLD_STEP, Cameras, ParameterLayout
from stcalib_ros.core.bundle.residuals import noise_px
from stcalib_ros.core.bundle.state import BundleState, person_rows_of
from stcalib_ros.core.geometry.robust import CAUCHY, LEAST_SHARE, MIN_SCALE_PX, RAYLEIGH_MEDIAN
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.refinement.keypoint_bias.harmonics import (
    body_frames,
    harmonics,
)
from stcalib_ros.core.refinement.keypoint_bias.normal_equations import (
    Part,
    follow,
    person_sums,
    project,
)
from stcalib_ros.core.refinement.keypoint_bias.priors import prior_groups, renewed_variances

_CHUNK = 64
"""Rows of one part. Numerical: so that its arrays fit into the cache."""

_FIRST_SPREAD = 0.02
"""Fraction of the length of the trunk. Standard deviation of the biases to start from: those of
detectors are one to three centimetres. Numerical: the evidence decides."""

_LEAST_SPREAD = 1e-5
"""Fraction of the length of the gauge. Smallest standard deviation. Numerical."""

_ITERATIONS = 10
"""Count. Gauss-Newton steps at most. Numerical."""

_CONVERGED = 0.3
"""Standard deviations. Done when a step moves the cameras by less; the adjustment of all keypoints
goes on from there. Numerical."""

_HINT = 2.0
"""Standard deviations of the score under noise alone. Biases are estimated if it is larger:
2 mm of bias make it 8, 5 mm 50 in default scenes, none at most 0.1. Chosen, for speed: the evidence
decides whether there are any."""


@dataclass(frozen=True, slots=True, eq=False)
class BiasFit:
    """An optimum, or a step on the way to it.

    Attributes
    ----------
    cameras : Cameras
    X : tuple of (3, J, n) ndarray
        Joints of every part.
    bias : (P, J, q) ndarray
        Coefficients by person and joint: of the harmonics in body axes (3 B), then displacements
        in the images of all cameras (2) and of each (2 C).
    variance : (P, J, q) ndarray
        Of the priors of the coefficients.
    sigma_px : float
        Noise of the keypoints, per axis.
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
    known : (n, n) ndarray
        Normal equations of the cameras if the biases were known.
    inverse : (P, J, q, q) ndarray
        Covariance of the biases, cameras given.
    observed : (P, J, q) ndarray
        What the keypoints know of each of them: diagonal of their normal equations.
    gradient : (P, J, q) ndarray
    mixed : (P, J, q, n) ndarray
    """

    system: ReducedSystem
    known: Float64Array
    inverse: Float64Array
    observed: Float64Array
    gradient: Float64Array
    mixed: Float64Array

    def hints_at_biases(self) -> bool:
        """Whether some biases of a small variance would explain the keypoints better.

        At a fit without biases. The score test: the marginal likelihood rises with a variance
        from zero on if the squares of the gradient are larger than noise makes them.
        """
        member = prior_groups(self.observed.shape[-1])
        squares, observed, variance = (
            v.sum((0, 1)) @ member
            for v in (self.gradient**2, self.observed, 2.0 * self.observed**2)
        )
        return bool((squares - observed > _HINT * np.sqrt(variance)).any())

    def determined(self, variance: Float64Array) -> Float64Array:
        """Fraction (P, J, q) of each coefficient that the keypoints determine."""
        return np.asarray(1.0 - np.diagonal(self.inverse, axis1=-2, axis2=-1) / variance)

    def unknown(self, person: int, joint: int) -> EliminatedUnknown:
        """The coefficients (q,) of the bias of one joint, as the covariance has it."""
        conditional = self.inverse[person, joint]
        return EliminatedUnknown(conditional, -conditional @ self.mixed[person, joint])


def parts_of(obs: Observations, s: BundleState, trunk: tuple[int, ...]) -> Iterator[Part]:
    """All keypoints, a few rows of one person at a time."""
    centres = -np.einsum("cji,cj->ci", s.R_cam_ref, s.t_cam_ref)
    for person, rows in enumerate(person_rows_of(obs)):
        for begin in range(rows.start, rows.stop, _CHUNK):
            part = slice(begin, min(begin + _CHUNK, rows.stop))
            R, direction = body_frames(s.X[part], trunk, centres)
            yield Part(
                person,
                part,
                obs.x[part].transpose(1, 3, 2, 0).copy(),
                (obs.focal[part] * s.inlier[part]).transpose(1, 2, 0).copy(),
                obs.elapsed(part).transpose(1, 2, 0).copy(),
                obs.since_middle(part),
                None if obs.row is None else obs.row[part].transpose(1, 2, 0).copy(),
                s.V[part].transpose(2, 1, 0).copy(),
                s.A[part].transpose(2, 1, 0).copy(),
                R,
                harmonics(direction).swapaxes(0, 1).copy(),
                s.R_cam_ref[:, :2].swapaxes(1, 2),
            )


class Problem:
    """The keypoints of a round, and how the people stood.

    Parameters
    ----------
    obs : Observations
    state : BundleState
        Joints that body axes and motion are read from.
    trunk : tuple of int
        As `trunk_of` gives it.
    layout : ParameterLayout, optional
        Unknowns of the cameras; default: poses and time offsets.
    """

    def __init__(
        self,
        obs: Observations,
        state: BundleState,
        trunk: tuple[int, ...],
        layout: ParameterLayout | None = None,
    ) -> None:
        self.obs, self.state, self.trunk = obs, state, trunk
        self.layout = layout or state.layout
        self.parts = tuple(parts_of(obs, state, trunk))

    def start(self) -> BiasFit:
        """Without biases; those to be expected are a few percent of the trunk."""
        obs, s = self.obs, self.state
        low_left, low_right, high_left, high_right = (s.X[:, j] for j in self.trunk)
        upward = high_left + high_right - low_left - low_right
        trunk = np.linalg.norm(upward, axis=-1) / 2.0
        shape = (1 + self.parts[-1].person, obs.x.shape[2], self.parts[0].size)
        return BiasFit(
            s.cameras,
            tuple(s.X[part.rows].transpose(2, 1, 0).copy() for part in self.parts),
            np.zeros(shape),
            np.full(shape, float((_FIRST_SPREAD * np.median(trunk)) ** 2)),
            noise_px(obs, s),
        )

    def solve(self) -> tuple[BiasFit, EliminatedBiases] | None:
        """The optimum and the system there; None where nothing hints at biases.

        By Gauss-Newton steps, the variances of the priors estimated anew after each.
        """
        fit = self.start()
        e = self.eliminate(fit)
        if not e.hints_at_biases():
            return None
        for _ in range(_ITERATIONS):
            fit, length = self.step(fit, e)
            e = self.eliminate(fit)
            if length < _CONVERGED:
                break
        return fit, e

    def step(self, fit: BiasFit, e: EliminatedBiases) -> tuple[BiasFit, float]:
        """One step by the system there, and how many standard deviations the cameras moved."""
        d = -self.layout.solve(e.system.H, e.system.g, fit.cameras)
        flat = d.ravel()
        d_bias = -np.einsum("pjab,pjb->pja", e.inverse, e.gradient + e.mixed @ flat)
        cameras = self.layout.retract(fit.cameras, d)
        moved = replace(fit, cameras=cameras, bias=fit.bias + d_bias.reshape(fit.bias.shape))
        moved = self._rescaled(replace(moved, X=self.followed(moved)))
        length = max(float(flat @ e.system.H @ flat), 0.0) ** 0.5
        return self._renewed(moved, e.determined(fit.variance)), length

    def followed(self, fit: BiasFit) -> tuple[Float64Array, ...]:
        """Joints that suit the cameras and biases of a fit best."""
        scale = CAUCHY * fit.sigma_px
        return tuple(
            follow(part, fit.cameras, X, fit.bias[part.person], scale, 2)
            for part, X in zip(self.parts, fit.X, strict=True)
        )

    def _rescaled(self, fit: BiasFit) -> BiasFit:
        """The same with the length of the gauge that the start has."""
        grow = self.state.cameras.length() / fit.cameras.length()
        X = tuple(grow * one for one in fit.X)
        return replace(fit, cameras=fit.cameras.scaled(grow), X=X, bias=grow * fit.bias)

    def _renewed(self, fit: BiasFit, determined: Float64Array) -> BiasFit:
        """Noise, and variances of the biases by their evidence."""
        least = (_LEAST_SPREAD * fit.cameras.length()) ** 2
        variance = renewed_variances(fit.bias, determined, least)
        errors = np.sqrt(np.concatenate(list(self._squares(fit))))
        points = sum(int(part.triangulated().sum()) for part in self.parts)
        fraction = 1.0 - (1.5 * points + 0.5 * float(determined.sum())) / len(errors)
        sigma = float(np.median(errors)) / RAYLEIGH_MEDIAN / max(fraction, LEAST_SHARE) ** 0.5
        return replace(fit, variance=variance, sigma_px=max(sigma, MIN_SCALE_PX))

    def eliminate(self, fit: BiasFit) -> EliminatedBiases:
        """Eliminate joints and biases at a fit."""
        P, J, q = fit.bias.shape
        k = self.layout.size
        S = np.zeros((P, J, k + q + 1, k + q + 1))
        scale = CAUCHY * fit.sigma_px
        for part, X in zip(self.parts, fit.X, strict=True):
            bias = fit.bias[part.person]
            S[part.person] += person_sums(part, fit.cameras, X, bias, scale, self.layout)
        S /= fit.sigma_px**2
        precision = 1.0 / fit.variance
        own = slice(k, k + q)
        observed = np.diagonal(S[:, :, own, own], axis1=-2, axis2=-1)
        inverse = np.asarray(np.linalg.inv(S[:, :, own, own] + precision[..., None] * np.eye(q)))
        gradient = S[:, :, own, -1] + precision * fit.bias
        mixed = S[:, :, own, :k]
        gain = mixed.swapaxes(-1, -2) @ inverse
        known = S[:, :, :k, :k].sum((0, 1))
        H = known - (gain @ mixed).sum((0, 1))
        g = S[:, :, :k, -1].sum((0, 1)) - np.einsum("pjkb,pjb->k", gain, gradient)
        of_lenses, deviation = self.layout.prior(fit.cameras, world_stddev=WORLD_STEP)
        known, H = known + np.diag(of_lenses), H + np.diag(of_lenses)
        g += of_lenses * deviation
        return EliminatedBiases(ReducedSystem(H, g), known, inverse, observed, gradient, mixed)

    def log_evidence(self, fit: BiasFit, e: EliminatedBiases) -> float:
        """Logarithm of the ratio of the marginal likelihoods with and without biases (Laplace).

        Parameters
        ----------
        fit : BiasFit
            The optimum.
        e : EliminatedBiases
            There.
        """
        start = replace(self.start(), sigma_px=fit.sigma_px)
        plain = replace(start, X=self.followed(start))
        spread = np.sqrt(fit.variance)
        volume = np.linalg.slogdet(e.inverse / (spread[..., None] * spread[..., None, :]))[1].sum()
        prior = (fit.bias**2 / fit.variance).sum()
        return float(self._cost(plain) - self._cost(fit) - 0.5 * prior + 0.5 * volume)

    def _cost(self, fit: BiasFit) -> float:
        """Negative logarithm of the likelihood, up to a constant."""
        width = (CAUCHY * fit.sigma_px) ** 2
        return 0.5 * CAUCHY**2 * sum(float(np.log1p(s / width).sum()) for s in self._squares(fit))

    def _squares(self, fit: BiasFit) -> Iterator[Float64Array]:
        """Squared residuals of the keypoints that take part, by part and camera."""
        scale = CAUCHY * fit.sigma_px
        for part, X in zip(self.parts, fit.X, strict=True):
            for c in range(len(fit.cameras.t)):
                at = project(part, c, fit.cameras, X, fit.bias[part.person])
                yield at.squared_px(scale)[at.focal > 0.0]
