"""Rotations of pairs around triples of cameras, which end where they began.

With lenses that are wrong, the matrix of each pair is close to an essential one of a rotation that
is wrong, and such rotations do not fit together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.geometry.so3 import log_so3
from stcalib_ros.core.model.arrays import Float64Array, IntArray


@dataclass(frozen=True, slots=True, eq=False)
class RotationLoops:
    """Triples of cameras a, b and c, of which all three pairs are known.

    Attributes
    ----------
    ab, bc, ac : (T,) ndarray of int
        Numbers of the pairs.
    share : float
        Independent loops over T.
    """

    ab: IntArray
    bc: IntArray
    ac: IntArray
    share: float

    def turns(self, R_a_b: Float64Array) -> Float64Array:
        """Return the rotation vectors (T, 3), rad, of loops of rotations (P, 3, 3)."""
        return log_so3(self._around(R_a_b))

    def _around(self, R: Float64Array) -> Float64Array:
        return np.asarray(R[self.ab] @ R[self.bc] @ np.swapaxes(R[self.ac], -1, -2))

    def derivatives(self, R_a_b: Float64Array) -> tuple[tuple[IntArray, Float64Array], ...]:
        """Return numbers of pairs (T,), and derivatives (T, 3, 3) of the turns by their rotation.

        They hold where the turns are small.
        """
        around = self._around(R_a_b)
        whole = np.broadcast_to(np.eye(3), around.shape)
        return (self.ab, whole), (self.bc, R_a_b[self.ab]), (self.ac, -around)


def rotation_loops(a: IntArray, b: IntArray) -> RotationLoops:
    """Return the loops of pairs of cameras a and b (P,), all in one order of the cameras."""
    number = {pair: k for k, pair in enumerate(zip(a.tolist(), b.tolist(), strict=True))}
    loops = [
        (number[i, j], number[j, k], number[i, k])
        for i, j in number
        for k in np.unique(b).tolist()
        if (j, k) in number and (i, k) in number
    ]
    independent = len(number) - len(np.union1d(a, b)) + 1
    ab, bc, ac = np.array(loops, dtype=np.int64).reshape(-1, 3).T
    return RotationLoops(ab, bc, ac, independent / max(1, len(loops)))
