"""From candidate rigs to one that can be trusted: adjust, check, exclude, reinstate.

Every loop here leaves out at least one camera per pass, and so ends.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

from stcalib_ros.core.bundle.initialization import Start, select_initial_rig
from stcalib_ros.core.bundle.istba import initial_adjustment, run_istba
from stcalib_ros.core.bundle.iteration import Iteration, absorbed
from stcalib_ros.core.bundle.limits import OTHER_OFFSET_FRAMES
from stcalib_ros.core.control import Control
from stcalib_ros.core.integration.exclusions import Disconnected, Exclusions, largest_part
from stcalib_ros.core.lifting.views import LiftedViews, with_lenses
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.calibration import Insufficient
from stcalib_ros.core.model.rejection import Rejection, RejectionReason
from stcalib_ros.core.model.rig import Rig, sub_rig
from stcalib_ros.core.options import Options
from stcalib_ros.core.reconstruction.mirrored_view import mirrored_view
from stcalib_ros.core.reconstruction.resection import Resection, add_cameras, resect
from stcalib_ros.core.refinement.sequence import refine
from stcalib_ros.core.registration.resampling import Grid
from stcalib_ros.core.validation.camera_checks import CameraChecks, check_cameras, rejection
from stcalib_ros.core.validation.estimated_lenses import undetermined_lenses
from stcalib_ros.core.validation.inconsistencies import inconsistencies
from stcalib_ros.core.validation.thresholds import DEFAULT
from stcalib_ros.core.validation.verdict import Solution, rival_solution, unsettled_cameras

_FAULTY = (
    RejectionReason.CLOCK_NOT_STEADY,
    RejectionReason.POSE_CHANGED,
    RejectionReason.PART_DISAGREES,
    RejectionReason.IMAGE_RESIZED,
    RejectionReason.IMAGE_TURNED,
    RejectionReason.DISTORTION_DISAGREES,
)
"""Reasons for which a camera has no one pose, clock and lens that it could be registered at."""


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationProblem:
    """The input of the stages after lifting.

    Attributes
    ----------
    given : LiftedViews
        All cameras, by the lenses that the recording has or that were assumed.
    views : LiftedViews
        The same, by the lenses that registration found.
    cameras : tuple of int
        Cameras to be calibrated, the reference first.
    exclusions : Exclusions
        Cameras that were left out before.
    grid : Grid
        Sample times that span all their frames.
    options : Options
    control : Control
    executor : concurrent.futures.Executor, optional
        Registers the pairs of cameras.
    """

    given: LiftedViews
    views: LiftedViews
    cameras: tuple[int, ...]
    exclusions: Exclusions
    grid: Grid
    options: Options
    control: Control
    executor: Executor | None = None

    def at(self, rig: Rig) -> CalibrationProblem:
        """The problem with the lenses of a rig."""
        lenses = dict(zip(rig.cameras.tolist(), rig.lenses, strict=False))
        return replace(self, views=with_lenses(self.views, lenses)) if lenses else self

    def holding(self, cameras: Sequence[int]) -> CalibrationProblem:
        """The problem with the lenses of some cameras as they were given."""
        lenses = {c: self.given.recording.cameras[c].intrinsics for c in cameras}
        views = with_lenses(self.views, lenses)
        lifted = tuple(
            replace(one, lens_prior=None) if c in lenses else one
            for c, one in enumerate(views.lifted)
        )
        return replace(self, views=replace(views, lifted=lifted))


def adjust_rigs(
    problem: CalibrationProblem, rigs: Sequence[Rig], exclusions: Exclusions
) -> Solution:
    """Adjust candidate rigs, and bring the one that fits best to the end (STBA, ISTBA).

    Cameras in which another solution differs that fits about as well are left out.

    Parameters
    ----------
    problem : CalibrationProblem
    rigs : sequence of Rig
        Candidates, the best supported first.
    exclusions : Exclusions
        Cameras left out so far.

    Raises
    ------
    Insufficient
        No two cameras stay connected.
    """

    def adjust(rig: Rig, exclusions: Exclusions) -> Start:
        return adjust_initially(problem, rig, exclusions)

    start, rival = select_initial_rig(rigs, adjust, exclusions, problem.control.tick)
    if rival is None:
        return _reinstate_excluded(problem, _exclude_unreliable(problem, start))
    rivalry = rival_solution(start.iteration, rival, offset_range_s=problem.options.offset_range_s)
    step_s = start.iteration.observations.step_s
    disputed = start.iteration.differing(rival, OTHER_OFFSET_FRAMES * step_s).tolist()
    rest = [sub for rig in rigs if (sub := _without(rig, disputed)) is not None]
    if not rest or _without(start.iteration.rig, disputed) is None:
        return replace(_solve(problem, start), rival=rivalry)
    names = tuple(problem.exclusions.names[c] for c in disputed)
    left_out = start.exclusions.adding(disputed, replace(rivalry, cameras=names))
    return adjust_rigs(problem, rest, _name_faults(problem, start.iteration, left_out))


def _name_faults(problem: CalibrationProblem, last: Iteration, left_out: Exclusions) -> Exclusions:
    """Name what is wrong with the input of cameras that are left out, where their residuals say.

    A clock that changes fits one solution before, and another one after.
    """
    views = problem.at(last.rig).views
    faults = inconsistencies(views.lifted, views.skeleton, last)
    named = {
        c: replace(found.rejections[0], cameras=(problem.exclusions.names[c],))
        for c, found in zip(last.rig.cameras.tolist(), faults, strict=True)
        if found.rejections
    }
    return left_out.because(named)


def _without(rig: Rig, cameras: Sequence[int]) -> Rig | None:
    """Return a rig without some cameras; None if fewer than two are left."""
    kept = [i for i, c in enumerate(rig.cameras) if c not in cameras]
    return sub_rig(rig, kept) if len(kept) > 1 else None


def adjust_initially(problem: CalibrationProblem, rig: Rig, exclusions: Exclusions) -> Start:
    """Make the initial adjustment at a rig, without the cameras that it disconnects."""
    for _ in range(len(rig.cameras)):
        result = initial_adjustment(
            problem.views.lifted, rig, problem.options.bundle, step_s=problem.grid.step_s
        )
        if isinstance(result, Iteration):
            return Start(result, exclusions)
        rig, exclusions = largest_part(exclusions, rig, result)
    raise AssertionError("a rig of fewer than two cameras is never adjusted")


def _iterate(problem: CalibrationProblem, start: Start) -> tuple[tuple[Iteration, ...], Exclusions]:
    """Run ISTBA, without the cameras that it disconnects."""
    for _ in range(len(start.iteration.rig.cameras)):
        result = run_istba(
            problem.views.lifted,
            start.iteration,
            problem.options.bundle,
            step_s=problem.grid.step_s,
            tick=problem.control.tick_iteration,
        )
        if not isinstance(result, Disconnected):
            return result, start.exclusions
        rig, exclusions = largest_part(start.exclusions, start.iteration.rig, result)
        start = adjust_initially(problem, rig, exclusions)
    raise AssertionError("a rig of fewer than two cameras is never adjusted")


def _solve(problem: CalibrationProblem, start: Start) -> Solution:
    """Bring an initial adjustment to the end, and check its cameras."""
    options = problem.options
    iterations, exclusions = _iterate(problem, start)
    problem.control.tick_iteration(1.0, iterations[-1])
    unsettled = unsettled_cameras(iterations)
    views = problem.at(iterations[-1].rig).views
    refined = refine(
        views.lifted,
        (*iterations[:-1], absorbed(iterations[-1])),
        views.skeleton.layout,
        options.bundle,
        estimate_line_delays=options.estimate_line_time,
    )
    covariance = refined.covariance.poses_and_offsets()
    held = undetermined_lenses(views.lifted, refined.iterations[-1])
    if held:
        problem = problem.holding(held)
        rig = replace(refined.iterations[-1].rig, lenses=())
        return _solve(problem, adjust_initially(problem, rig, exclusions))
    found = check_solution(problem, refined.iterations, covariance, exclusions, unsettled=unsettled)
    return replace(found, joint_covariance=refined.covariance)


def check_solution(
    problem: CalibrationProblem,
    iterations: tuple[Iteration, ...],
    covariance: Float64Array,
    exclusions: Exclusions,
    *,
    unsettled: int,
) -> Solution:
    """Check every camera of an adjustment that was brought to the end.

    Parameters
    ----------
    problem : CalibrationProblem
    iterations : tuple of Iteration
    covariance : (7 C, 7 C) ndarray
    exclusions : Exclusions
    unsettled : int
        Number of cameras that the last iteration before refinement still moved.
    """
    problem.control.tick("checking the result", 0.0)
    views = problem.at(iterations[-1].rig).views
    checks = check_cameras(
        views.lifted,
        views.skeleton,
        iterations[-1],
        covariance,
        offset_range_s=problem.options.offset_range_s,
    )
    return Solution(views, iterations, covariance, checks, exclusions, unsettled)


def _exclude_unreliable(problem: CalibrationProblem, start: Start) -> Solution:
    """Solve, and again without the least reliable camera while fewer than half fail the checks."""
    found = _without_mirrored(problem, _solve(problem, start))
    for _ in range(len(start.iteration.rig.cameras)):
        rig, names = found.last.rig, problem.exclusions.names
        failed = {
            i: why
            for i, (c, checks) in enumerate(zip(rig.cameras, found.checks, strict=True))
            if (why := rejection(checks, camera=names[c])) is not None
        }
        # Others may fail because of what is wrong with these.
        failed = {i: failed[i] for i in failed if found.checks[i].inconsistencies} or failed
        if not failed or len(failed) >= DEFAULT.max_failed_fraction * len(found.checks):
            break
        worst = min(failed, key=lambda i: _reliability(found.checks[i]))
        exclusions = found.exclusions.adding([int(rig.cameras[worst])], failed[worst])
        rest = sub_rig(rig, [i for i in range(len(rig.cameras)) if i != worst])
        found = _solve(problem, adjust_initially(problem, rest, exclusions))
    return found


def _without_mirrored(problem: CalibrationProblem, found: Solution) -> Solution:
    """Leave out cameras that agree with the others for a moment, and in a mirror all the time."""
    rig = found.last.rig
    mirrored: dict[int, Rejection] = {}
    for c, checks in zip(rig.cameras.tolist(), found.checks, strict=True):
        if checks.explained_fraction < DEFAULT.min_explained_fraction:
            views = found.views
            why = mirrored_view(views.lifted, c, views.skeleton, found.last, problem.options)
            mirrored |= {} if why is None else {c: why}
    rest = _without(rig, list(mirrored))
    if not mirrored or rest is None:
        return found
    exclusions = found.exclusions
    for c, why in mirrored.items():
        exclusions = exclusions.adding([c], why)
    return _solve(problem, adjust_initially(problem, rest, exclusions))


def _reliability(checks: CameraChecks) -> tuple[float, int]:
    """Order cameras that fail: first those whose own input is wrong, by how far beyond the limit.

    What is wrong with one camera disturbs all others.
    """
    excess = [abs(why.measured / why.limit) for why in checks.inconsistencies]
    return -max(excess, default=0.0), checks.inliers


def _reinstate_excluded(problem: CalibrationProblem, before: Solution) -> Solution:
    """Take back cameras that can be registered now that the people are known, if any can."""
    present = before.last.rig.cameras.tolist()
    if not before.sound or set(present) >= set(problem.cameras):
        return before
    views = before.views
    faulty = {one.name for one in before.exclusions.cameras if one.rejection.reason in _FAULTY}
    found: dict[int, Resection] = {}
    mirrored: dict[int, Rejection] = {}
    for c in problem.cameras:
        if c not in present and problem.exclusions.names[c] not in faulty:
            problem.control.tick("placing a camera that was left out", 0.0)
            task = (views.lifted, c, views.skeleton, before.last, problem.options)
            if (one := resect(*task)) is not None:
                found[c] = one
            elif (why := mirrored_view(*task)) is not None:
                mirrored[c] = why
    before = replace(before, exclusions=before.exclusions.because(mirrored))
    if not found:
        return before
    rig = add_cameras(views.lifted, before.last.rig, found, problem.cameras)
    try:
        start = adjust_initially(problem, rig, before.exclusions.reinstating(list(found)))
        after = _exclude_unreliable(problem, start)
    except Insufficient:
        return before
    kept = set(after.last.rig.cameras.tolist())
    return after if after.sound and kept > set(present) else before
