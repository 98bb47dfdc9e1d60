"""Rotation and soft association by expectation-maximisation (Section III-B).

The persons of the source view are a mixture of von Mises-Fisher distributions, one per joint and
window of T frames; the oriented points of the target view are its samples, up to one rotation.
The data enter only through, for every target person p and source person p',

    B_pp' = sum_s kappa_p's (sum_tau v_p,tau,s) mu_p's^T    and    sum_s T log C(kappa_p's),

since ``sum kappa (R mu)^T v = tr(R^T B)``. All offsets, starts and windows are one batch.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.geometry.alignment import best_rotation
from stcalib_ros.core.model.arrays import BoolArray, Float64Array
from stcalib_ros.core.paper.vmf import VonMisesFisher, log_normaliser

_MAX_ITERATIONS = 40
"""Iterations of expectation-maximization at most; the best start of several is taken anyway."""
_CONVERGED = 1e-6
"""Largest change of an entry of the rotation below which the iteration ends, about 1e-6 rad."""
_MIN_PI = 1e-12
"""Mixing proportion. Keeps persons in the mixture that match nobody at a poor first rotation."""


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """Sufficient statistics of W windows with P target and Q source persons at L offsets.

    Attributes
    ----------
    B : (L, W, P, Q, 3, 3) ndarray
        ``sum kappa v mu^T`` over joints and frames.
    log_c : (L, W, P, Q) ndarray
        ``sum log C(kappa)``.
    frames : (W, P) ndarray
        Frames in which the target person is observed: the power of their mixing proportion.
    present : (L, W, P, Q) ndarray of bool
        Where both persons are observed.
    """

    B: Float64Array
    log_c: Float64Array
    frames: Float64Array
    present: BoolArray

    def of_sources(self, sources: list[int]) -> Evidence:
        """Return the statistics of these source persons alone."""
        return Evidence(
            self.B[:, :, :, sources],
            self.log_c[..., sources],
            self.frames,
            self.present[..., sources],
        )


def gather_evidence(
    target: Float64Array, known: Float64Array, source: VonMisesFisher, seen: BoolArray
) -> Evidence:
    """Compute the sufficient statistics of all persons and offsets.

    Parameters
    ----------
    target : (P, W, T, S, 3) ndarray
        Oriented points; 0 where unknown.
    known : (P, W, T, S) ndarray
        1 where they are known.
    source : VonMisesFisher
        Distributions of shape (Q, L, W, S).
    seen : (Q, L, W) ndarray of bool
        Where the source person is observed.
    """
    P, W, _, S = known.shape
    Q, L = seen.shape[:2]
    sums = target.sum(2).transpose(1, 0, 3, 2).reshape(W, P * 3, S)
    weighted = (source.kappa[..., None] * source.mu).transpose(1, 2, 3, 0, 4)
    B = sums @ weighted.reshape(L, W, S, Q * 3)
    counts = known.sum(2).transpose(1, 0, 2)
    log_c = counts @ log_normaliser(source.kappa).transpose(1, 2, 3, 0)
    frames = known.max(-1).sum(-1).T
    present = (frames > 0)[:, :, None] & seen.transpose(1, 2, 0)[:, :, None]
    return Evidence(B.reshape(L, W, P, 3, Q, 3).transpose(0, 1, 2, 4, 3, 5), log_c, frames, present)


@dataclass(frozen=True, slots=True, eq=False)
class Mixture:
    """Result of expectation-maximization for L offsets and K starts each.

    Attributes
    ----------
    R : (L, K, 3, 3) ndarray
        ``R_target_source``.
    gamma : (L, K, W, P, Q) ndarray
        Responsibilities; 0 where a person is not observed.
    log_likelihood : (L, K) ndarray
    """

    R: Float64Array
    gamma: Float64Array
    log_likelihood: Float64Array


def maximise(evidence: Evidence, R: Float64Array) -> Mixture:
    """Alternate between responsibilities, mixing proportions and rotation until convergence.

    Parameters
    ----------
    evidence : Evidence
    R : (L, K, 3, 3) ndarray
        Rotations to start from.
    """
    L, K = R.shape[:2]
    _, W, P, Q = evidence.present.shape
    flat = evidence.B.reshape(L, W * P * Q, 9)
    pi = np.full((L, K, W, 1, Q), 1.0 / Q)
    for _ in range(_MAX_ITERATIONS):
        gamma, _ = responsibilities(evidence, R, pi)
        pi = mixing_proportions(gamma)
        S = gamma.reshape(L, K, -1) @ flat
        before, R = R, best_rotation(S.reshape(L, K, 3, 3))
        if np.abs(R - before).max() < _CONVERGED:
            break
    gamma, log_likelihood = responsibilities(evidence, R, pi)
    return Mixture(R, gamma, log_likelihood)


def responsibilities(
    evidence: Evidence, R: Float64Array, pi: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Compute the soft association of every target person (eq. gamma) by log-sum-exp.

    Parameters
    ----------
    evidence : Evidence
    R : (L, K, 3, 3) ndarray
    pi : (L, K, W, 1, Q) ndarray

    Returns
    -------
    gamma : (L, K, W, P, Q) ndarray
    log_likelihood : (L, K) ndarray
        Log-likelihood of the mixture, summed over target persons and windows.
    """
    L, K = R.shape[:2]
    _, W, P, Q = evidence.present.shape
    fit = R.reshape(L, K, 9) @ evidence.B.reshape(L, -1, 9).transpose(0, 2, 1)
    value = fit.reshape(L, K, W, P, Q) + evidence.log_c[:, None]
    value += evidence.frames[..., None] * np.log(np.maximum(pi, _MIN_PI))
    value = np.where(evidence.present[:, None], value, -np.inf)
    top = value.max(-1, keepdims=True)
    top = np.where(np.isfinite(top), top, 0.0)
    weight = np.exp(value - top)
    total = weight.sum(-1, keepdims=True)
    explained = total > 0
    gamma = weight / np.where(explained, total, 1.0)
    log_p = np.where(explained, top + np.log(np.where(explained, total, 1.0)), 0.0)
    return gamma, log_p.sum((2, 3, 4))


def mixing_proportions(gamma: Float64Array) -> Float64Array:
    """Return the fraction (L, K, W, 1, Q) of responsibilities per source person (eq. pi)."""
    mass = gamma.sum(-2, keepdims=True)
    return np.asarray(mass / np.maximum(mass.sum(-1, keepdims=True), _MIN_PI))
