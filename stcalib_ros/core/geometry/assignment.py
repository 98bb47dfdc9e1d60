"""One-to-one assignment of least cost.

That of SciPy, with the same choice among equals. SciPy itself takes longer to import than all else
that `stcalib doctor` imports, and nothing else in it is needed there.

References
----------
D. F. Crouse, "On implementing 2D rectangular assignment algorithms", IEEE Transactions on Aerospace
and Electronic Systems 52 (4), 2016.
"""

from __future__ import annotations

import numpy as np

from stcalib_ros.core.model.arrays import BoolArray, Float64Array, IntArray


def assign(cost: Float64Array, *, maximize: bool = False) -> tuple[IntArray, IntArray]:
    """Assign rows to columns one to one, as many as can be, at the least sum of costs.

    Parameters
    ----------
    cost : (R, C) ndarray
        Infinite where a row and a column are not to be assigned to each other.
    maximize : bool
        The numbers are gains; the sum is to be the greatest.

    Returns
    -------
    rows, columns : (min(R, C),) ndarray of int
        What is assigned to what, by rows in ascending order.

    Raises
    ------
    ValueError
        A number is NaN, or no assignment has a finite sum.
    """
    cost = np.asarray(cost, dtype=np.float64) * (-1.0 if maximize else 1.0)
    if np.isnan(cost).any() or (cost == -np.inf).any():
        raise ValueError("costs: expected numbers, got NaN or an infinite gain")
    if len(cost) <= cost.shape[1]:
        return np.arange(len(cost)), _columns(cost)
    rows = _columns(cost.T)
    columns = np.argsort(rows)
    return rows[columns], columns


def _columns(cost: Float64Array) -> IntArray:
    """Columns (R,) of the rows of costs (R, C), R <= C."""
    if cost.size:
        cheapest = cost == cost.min(axis=1, keepdims=True)
        if (cheapest.sum(axis=1) == 1).all() and (cheapest.sum(axis=0) <= 1).all():
            return np.asarray(cheapest.argmax(axis=1))
    solution = _Solution(cost)
    for row in range(len(cost)):
        solution.add(row)
    return solution.column_of


class _Solution:
    """The best assignment of some rows, which grows row by row along shortest paths."""

    def __init__(self, cost: Float64Array) -> None:
        self.cost = cost
        self.row_price, self.column_price = np.zeros(len(cost)), np.zeros(cost.shape[1])
        self.column_of: IntArray = np.full(len(cost), -1, dtype=np.int64)
        self.row_of: IntArray = np.full(cost.shape[1], -1, dtype=np.int64)

    def add(self, row: int) -> None:
        """Assign one more row; others may change their columns."""
        n = len(self.row_of)
        length, before = np.full(n, np.inf), np.full(n, -1)
        reached = np.zeros(n, dtype=bool)
        left = np.arange(n)[::-1]
        rows, shortest = [row], 0.0
        while True:
            i = rows[-1]
            r = shortest + self.cost[i, left] - self.row_price[i] - self.column_price[left]
            nearer = r < length[left]
            length[left[nearer]], before[left[nearer]] = r[nearer], i
            k = self._nearest(length[left], self.row_of[left] < 0)
            column, shortest = int(left[k]), float(length[left[k]])
            if not np.isfinite(shortest):
                raise ValueError("costs: no assignment has a finite sum")
            reached[column] = True
            left[k], left = left[-1], left[:-1]
            if self.row_of[column] < 0:
                break
            rows.append(int(self.row_of[column]))
        self.row_price[rows[1:]] += shortest - length[self.column_of[rows[1:]]]
        self.row_price[row] += shortest
        self.column_price[reached] -= shortest - length[reached]
        self._exchange(row, column, before)

    @staticmethod
    def _nearest(length: Float64Array, free: BoolArray) -> int:
        """Index of the least length; of equals, the last that is free, or else the first."""
        least = length == length.min()
        if (least & free).any():
            return len(least) - 1 - int((least & free)[::-1].argmax())
        return int(least.argmax())

    def _exchange(self, row: int, column: int, before: IntArray) -> None:
        """Give every row on the path the column that comes next."""
        i = -1
        while i != row:
            i = int(before[column])
            self.row_of[column] = i
            self.column_of[i], column = column, int(self.column_of[i])
