"""Normal equations in a gauge: their solution, and their inverse where not all is observable."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.model.arrays import Float64Array

_SOLVER_RIDGE = 1e-12
"""Added to the diagonal of the scaled normal equations, whose elements are 1: keeps the step finite
along what is not observable. Numerical."""

_RANK_TOLERANCE = 1e-13
"""Ratio. Eigenvalues of the scaled normal equations below this times the largest are zero.
Numerical: a few hundred times the precision of float64."""

_NULL_COMPONENT = 1e-6
"""Squared component. A parameter with more than this in directions that are not observable is
itself not observable. Numerical: rounding leaves about 1e-16."""


@dataclass(frozen=True, slots=True, eq=False)
class ScaledSystem:
    """Normal equations scaled to a unit diagonal (Jacobi), without the direction of the scale.

    Attributes
    ----------
    size : (n,) ndarray
        Square roots of the diagonal before.
    basis : (n, n - 1) ndarray
        Orthonormal; the scaled parameters that keep the length of the gauge.
    H : (n - 1, n - 1) ndarray
        In that basis.
    """

    size: Float64Array
    basis: Float64Array
    H: Float64Array

    @staticmethod
    def of(H: Float64Array, scale: Float64Array) -> ScaledSystem:
        """The system of normal equations H (n, n) and the direction of the scale (n,)."""
        size = np.sqrt(np.maximum(np.diag(H), 1e-30))
        basis = np.linalg.qr((scale / size)[:, None], mode="complete")[0][:, 1:]
        return ScaledSystem(size, basis, basis.T @ (H / np.outer(size, size)) @ basis)

    def solve(self, g: Float64Array) -> Float64Array:
        """Solution (n,) for a right side (n,)."""
        H = self.H + _SOLVER_RIDGE * np.eye(len(self.H))
        return np.asarray(
            self.basis @ np.linalg.solve(H, self.basis.T @ (g / self.size)) / self.size
        )

    def inverse(self) -> Float64Array:
        """Covariance (n, n); what is not observable has an infinite variance."""
        value, vector = np.linalg.eigh(self.H)
        good = value > _RANK_TOLERANCE * value.max(initial=0.0)
        kept, null = self.basis @ vector[:, good], self.basis @ vector[:, ~good]
        lost = (null**2).sum(1) > _NULL_COMPONENT
        inverse = np.asarray(kept / value[good] @ kept.T / np.outer(self.size, self.size))
        inverse[lost], inverse[:, lost] = 0.0, 0.0
        inverse[lost, lost] = np.inf
        return inverse


def propagate(J: Float64Array, P: Float64Array) -> Float64Array:
    """Covariance ``J P J^T``; infinite variances stay infinite in all that depends on them."""
    lost = np.isinf(np.diag(P))
    if not lost.any():
        return np.asarray(J @ P @ J.T)
    out = J @ np.where(np.isinf(P), 0.0, P) @ J.T
    touched = (J[:, lost] != 0.0).any(1)
    out[touched], out[:, touched] = 0.0, 0.0
    out[touched, touched] = np.inf
    return np.asarray(out)
