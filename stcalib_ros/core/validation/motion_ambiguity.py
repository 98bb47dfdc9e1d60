"""What the motion of the people leaves open: steps that repeat, people who move alike, one line.

Told from the people as they were reconstructed. Two stretches of motion are compared by their bone
directions, after the rotation that suits them best: what two cameras could not tell apart either.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.skeleton import Skeleton
from stcalib_ros.core.reconstruction.people import found_persons, people_on_grid
from stcalib_ros.core.registration.correlation import PairCovariance, cross_covariance

_LONGEST_PERIOD_S = 3.0
_SHORTEST_PERIOD_S = 0.25
_MIN_OVERLAP_S = 1.0
_RETURNS = 0.9
"""Of the way to unlike poses and back, the part that counts as being back."""
_ALIKE = 0.97
_LINE_LENGTH = 0.5
_LINE_WIDTH = 0.1


@dataclass(frozen=True, slots=True)
class Ambiguity:
    """What does not tell clocks, people or places apart.

    Attributes
    ----------
    periods_s : tuple of float
        After which the motion of each person repeats itself; empty if somebody's does not.
    alike : tuple of (int, int)
        Persons who move alike, by their numbers in the result.
    on_a_line : bool
        Everybody stays on one straight line.
    """

    periods_s: tuple[float, ...] = ()
    alike: tuple[tuple[int, int], ...] = ()
    on_a_line: bool = False

    def sentences(self) -> list[str]:
        """What there is of these, and what would help."""
        said = []
        if self.periods_s:
            said.append(
                f"everybody's motion repeats itself after {_range(self.periods_s)}: offsets that "
                "are wrong by that look right; let people turn, stop and start"
            )
        if self.alike:
            pairs = ", ".join(f"{p} and {q}" for p, q in self.alike)
            said.append(f"persons {pairs} move alike: let everybody move in his own way")
        if self.on_a_line:
            said.append("everybody stays on one line: let people walk across it, too")
        return said


def find_ambiguity(
    cameras: Sequence[LiftedCamera], skeleton: Skeleton, last: Iteration
) -> Ambiguity:
    """Compare the people of a round with one another and with themselves at other times."""
    step_s = last.observations.step_s
    people, numbers = people_on_grid(skeleton, last)
    ids = {number: person.person_id for number, person in found_persons(cameras, last)}
    known = [i for i, number in enumerate(numbers) if number in ids]
    if not known:
        return Ambiguity()
    cov = cross_covariance(people, people, max_lag=round(_LONGEST_PERIOD_S / step_s))
    score = cov.score(min_overlap=round(_MIN_OVERLAP_S / step_s))
    periods = [period_s(score[i, i], cov, step_s) for i in known]
    at_once = score[:, :, len(cov.lags) // 2]
    return Ambiguity(
        tuple(p for p in periods if p is not None) if None not in periods else (),
        tuple(
            (min(pair), max(pair))
            for i, j in combinations(known, 2)
            if at_once[i, j] > _ALIKE
            for pair in [(ids[numbers[i]], ids[numbers[j]])]
        ),
        on_a_line(last),
    )


def period_s(score: Float64Array, cov: PairCovariance, step_s: float) -> float | None:
    """Time after which a motion looks as it did, by its agreement (L,) with itself at all lags.

    It has to become unlike itself in between.
    """
    later = score[len(cov.lags) // 2 :]
    for lag in range(max(2, round(_SHORTEST_PERIOD_S / step_s)), len(later) - 1):
        nearby = later[lag - 1 : lag + 2]
        if not np.isfinite(nearby).all() or later[lag] < nearby.max():
            continue
        lowest = float(np.nanmin(later[1:lag]))
        if later[lag] - lowest > _RETURNS * (later[1] - lowest) and lowest < _ALIKE:
            return float(cov.lags[len(cov.lags) // 2 + lag] * step_s)
    return None


def on_a_line(last: Iteration) -> bool:
    """Whether the middles of all people at all times make one straight line.

    The unit of a round is about a metre: people are as large as usual in it.
    """
    known = last.state.triangulated()
    count = known.sum(1)
    rows = count > 0
    weight = known[rows, :, None] / count[rows, None, None]
    body = (last.state.X[rows] * weight).sum(1)
    spread = np.linalg.svd(body - body.mean(0), compute_uv=False) / np.sqrt(len(body))
    return bool(spread[0] > _LINE_LENGTH and spread[1] < _LINE_WIDTH)


def _range(periods: Sequence[float]) -> str:
    low, high = min(periods), max(periods)
    return f"{low:.2f} s" if f"{low:.2f}" == f"{high:.2f}" else f"{low:.2f} to {high:.2f} s"
