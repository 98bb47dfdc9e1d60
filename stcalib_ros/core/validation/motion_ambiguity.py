"""Ambiguities of the observed motion: it repeats, people move identically, all stay on one line.

They explain why a solution was refused; none is refused by them. Two stretches of reconstructed
motion are compared by their bone directions after the best rotation: what two cameras could not
distinguish either.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.rejection import Rejection, RejectionReason
from stcalib_ros.core.model.skeleton import Skeleton
from stcalib_ros.core.reconstruction.people import found_persons, people_on_grid
from stcalib_ros.core.registration.correlation import PairCovariance, cross_covariance
from stcalib_ros.core.validation.thresholds import (
    MAX_LINE_WIDTH,
    MIN_LINE_LENGTH,
    MIN_PERIOD_OVERLAP_S,
    MIN_PERIOD_RETURN,
    MIN_POSE_SIMILARITY,
    PERIOD_RANGE_S,
)


@dataclass(frozen=True, slots=True)
class Ambiguity:
    """What makes clocks, people or poses of cameras ambiguous.

    Attributes
    ----------
    periods_s : tuple of float
        Periods of each person's motion, s; empty if somebody's motion does not repeat.
    identical : tuple of (int, int)
        Pairs of persons who move identically, by their numbers in the result.
    collinear : bool
        Everybody stays on one straight line.
    """

    periods_s: tuple[float, ...] = ()
    identical: tuple[tuple[int, int], ...] = ()
    collinear: bool = False

    def rejections(self) -> tuple[Rejection, ...]:
        """Return what there is of these."""
        found = []
        if self.periods_s:
            values = {"shortest_s": min(self.periods_s), "longest_s": max(self.periods_s)}
            found.append(Rejection(RejectionReason.PERIODIC_MOTION, values=values))
        for p, q in self.identical:
            values = {"person_a": float(p), "person_b": float(q)}
            found.append(Rejection(RejectionReason.IDENTICAL_MOTION, values=values))
        if self.collinear:
            found.append(Rejection(RejectionReason.COLLINEAR_MOTION))
        return tuple(found)


def find_ambiguity(
    cameras: Sequence[LiftedCamera], skeleton: Skeleton, last: Iteration
) -> Ambiguity:
    """Compare people with one another, and with themselves at other times.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
        All cameras.
    skeleton : Skeleton
    last : Iteration
    """
    step_s = last.observations.step_s
    people, numbers = people_on_grid(skeleton, last)
    found = found_persons(cameras, last)
    ids = {number: person.person_id for numbers, person in found for number in numbers}
    known = [i for i, number in enumerate(numbers) if number in ids]
    if not known:
        return Ambiguity()
    cov = cross_covariance(people, people, max_lag=round(PERIOD_RANGE_S[1] / step_s))
    score = cov.score(min_overlap=round(MIN_PERIOD_OVERLAP_S / step_s))
    periods = [period_s(score[i, i], cov, step_s) for i in known]
    at_same_time = score[:, :, len(cov.lags) // 2]
    return Ambiguity(
        tuple(p for p in periods if p is not None) if None not in periods else (),
        tuple(
            (min(pair), max(pair))
            for i, j in combinations(known, 2)
            if at_same_time[i, j] > MIN_POSE_SIMILARITY
            for pair in [(ids[numbers[i]], ids[numbers[j]])]
            if pair[0] != pair[1]
        ),
        is_collinear(last),
    )


def period_s(score: Float64Array, cov: PairCovariance, step_s: float) -> float | None:
    """Return the period of a motion, s; None if it does not repeat.

    Parameters
    ----------
    score : (L,) ndarray
        Similarity of the motion with itself at all lags. Between two repetitions it has to fall.
    cov : PairCovariance
        Its lags are those of the score.
    step_s : float
        Sample interval, s.
    """
    later = score[len(cov.lags) // 2 :]
    for lag in range(max(2, round(PERIOD_RANGE_S[0] / step_s)), len(later) - 1):
        nearby = later[lag - 1 : lag + 2]
        if not np.isfinite(nearby).all() or later[lag] < nearby.max():
            continue
        lowest = float(np.nanmin(later[1:lag]))
        has_returned = later[lag] - lowest > MIN_PERIOD_RETURN * (later[1] - lowest)
        if has_returned and lowest < MIN_POSE_SIMILARITY:
            return float(cov.lags[len(cov.lags) // 2 + lag] * step_s)
    return None


def is_collinear(last: Iteration) -> bool:
    """Return whether the centres of all people at all times are on one straight line.

    The unit of the adjustment is about a metre: people have their usual size in it.
    """
    known = last.state.triangulated()
    count = known.sum(1)
    rows = count > 0
    weight = known[rows, :, None] / count[rows, None, None]
    body = (last.state.X[rows] * weight).sum(1)
    spread = np.linalg.svd(body - body.mean(0), compute_uv=False) / np.sqrt(len(body))
    return bool(spread[0] > MIN_LINE_LENGTH and spread[1] < MAX_LINE_WIDTH)
