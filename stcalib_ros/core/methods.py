"""The ways to get from lifted poses to a solution: the default method, and the paper's own.

Both have the same three stages; `stcalib_ros.core.pipeline.run_stages` calls them in turn.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.bundle.covariance import pose_covariance
from stcalib_ros.core.integration.averaging import credible, integrate
from stcalib_ros.core.integration.exclusions import (
    Disconnected,
    Exclusions,
    largest_part,
    require_parallax,
)
from stcalib_ros.core.lifting.views import LiftedViews, with_lenses
from stcalib_ros.core.model.lens_knowledge import LensKnowledge
from stcalib_ros.core.model.relative_pose import RelativePose
from stcalib_ros.core.model.rig import Rig
from stcalib_ros.core.paper.registration import PairRegistration
from stcalib_ros.core.paper.stages import adjust_pairs, integrate_pairs, register_pairs
from stcalib_ros.core.registration.executors import map_tasks
from stcalib_ros.core.registration.pairs import (
    PairTask,
    agreements,
    pair_tasks,
    register,
    with_agreements,
)
from stcalib_ros.core.registration.unknown_lenses import find_lenses
from stcalib_ros.core.solution import CalibrationProblem, adjust_rigs, check_solution
from stcalib_ros.core.validation.verdict import Solution, unsettled_cameras


@dataclass(frozen=True, slots=True, eq=False)
class Registered:
    """Result of pairwise registration.

    Attributes
    ----------
    hypotheses : tuple of RelativePose
        Relative poses of all pairs of cameras; a pair may have several.
    windows : tuple of PairRegistration
        What the paper's method found on its windows, pair by pair; empty with the default.
    views : LiftedViews or None
        All cameras lifted by the lenses that the pairs agree on; None: they stay as they were.
    """

    hypotheses: tuple[RelativePose, ...]
    windows: tuple[PairRegistration, ...] = ()
    views: LiftedViews | None = None


@dataclass(frozen=True, slots=True)
class Method:
    """The stages of a method.

    Attributes
    ----------
    register : callable
        Registers all pairs of cameras of a problem (PR; Section III of the paper).
    integrate : callable
        Finds candidate rigs of a group of connected cameras, the best supported first (MI; IV).
    adjust : callable
        Adjusts the rigs (BA, IBA, STBA, ISTBA; IV), and checks every camera.
    """

    register: Callable[[CalibrationProblem], Registered]
    integrate: Callable[[CalibrationProblem, Sequence[int], Registered], tuple[Rig, ...]]
    adjust: Callable[[CalibrationProblem, Registered, tuple[Rig, ...], Exclusions], Solution]


def _register(problem: CalibrationProblem) -> Registered:
    """Register and refine all pairs of cameras, by the lenses that they agree on."""
    views, tasks = problem.views, _pair_tasks(problem, problem.views)
    if any(views.lifted[c].lens_knowledge is not LensKnowledge.GIVEN for c in problem.cameras):
        views, tasks = _by_found_lenses(problem, tasks)
    found = map_tasks(register, tasks, problem.executor, _ticks(problem, "matching camera pairs"))
    hypotheses = credible([h for hypotheses in found for h in hypotheses])
    require_parallax(views.lifted, hypotheses)
    return Registered(hypotheses, views=views)


def _by_found_lenses(
    problem: CalibrationProblem, tasks: Sequence[PairTask]
) -> tuple[LiftedViews, list[PairTask]]:
    """Lift the cameras by the lenses that the pairs agree on, and return the tasks by these."""
    found = map_tasks(agreements, tasks, problem.executor, _ticks(problem, "estimating lenses"))
    before = problem.views
    lenses = find_lenses(before.lifted, before.skeleton, tasks, found, problem.options.lens)
    views = with_lenses(before, lenses)
    again = zip(_pair_tasks(problem, views), tasks, found, strict=True)
    return views, [with_agreements(*one) for one in again]


def _pair_tasks(problem: CalibrationProblem, views: LiftedViews) -> list[PairTask]:
    return pair_tasks(
        views.lifted, problem.cameras, views.skeleton, problem.options, grid=problem.grid
    )


def _ticks(problem: CalibrationProblem, stage: str) -> Callable[[float], None]:
    return lambda fraction: problem.control.tick(stage, fraction)


def _integrate(
    problem: CalibrationProblem, group: Sequence[int], pairs: Registered
) -> tuple[Rig, ...]:
    """Average over random spanning trees of the hypotheses."""
    problem.control.tick("joining all cameras", 0.0)
    options = problem.options
    rigs = integrate(
        group,
        [h for h in pairs.hypotheses if h.a in group and h.b in group],
        frame_s=problem.grid.step_s,
        n_trees=options.integration.n_trees,
        rng=np.random.default_rng(options.seed),
    )
    return tuple(replace(rig, synchronised=options.synchronised) for rig in rigs)


def _adjust(
    problem: CalibrationProblem, _: Registered, rigs: tuple[Rig, ...], exclusions: Exclusions
) -> Solution:
    return adjust_rigs(problem, rigs, exclusions)


def _register_vmf(problem: CalibrationProblem) -> Registered:
    """Register all pairs of cameras by mixtures of von Mises-Fisher distributions."""
    pairs = register_pairs(
        problem.views, problem.cameras, problem.options, problem.grid, problem.control.tick
    )
    return Registered(tuple(pair.hypothesis for pair in pairs), pairs)


def _integrate_vmf(
    problem: CalibrationProblem, group: Sequence[int], pairs: Registered
) -> tuple[Rig, ...]:
    """Optimise the pose graph of all pairs."""
    return (integrate_pairs(group, pairs.windows, problem.options),)


def _adjust_vmf(
    problem: CalibrationProblem, pairs: Registered, rigs: tuple[Rig, ...], exclusions: Exclusions
) -> Solution:
    """Run the paper's adjustment, without the cameras that it disconnects."""
    rig = rigs[0]
    for _ in range(len(rig.cameras)):
        result = adjust_pairs(
            problem.views.lifted,
            rig,
            pairs.windows,
            problem.options,
            problem.grid,
            problem.control.tick,
        )
        if not isinstance(result, Disconnected):
            covariance = pose_covariance(result[-1].observations, result[-1].state)
            return check_solution(
                problem, result, covariance, exclusions, unsettled=unsettled_cameras(result)
            )
        rig, exclusions = largest_part(exclusions, rig, result)
    raise AssertionError("a rig of fewer than two cameras is never adjusted")


METHODS = {
    "correlation": Method(_register, _integrate, _adjust),
    "vmf": Method(_register_vmf, _integrate_vmf, _adjust_vmf),
}
"""By the names of ``registration.method``."""
