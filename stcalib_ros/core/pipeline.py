"""The calibration, from a recording to poses and clocks: a row of stages.

lift, pairwise registration, multi-view integration, iterated bundle adjustment, quality. Each
stage is a function of plain records; `run_stages` keeps what each of them found.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.averaging import Rig, integrate
from stcalib_ros.core.checks import (
    Insufficient,
    require_known_cameras,
    require_line_times,
    require_reference,
    select_cameras,
)
from stcalib_ros.core.covariance import pose_covariance
from stcalib_ros.core.errors import Cancelled
from stcalib_ros.core.evidence import CameraEvidence, evidence
from stcalib_ros.core.final.clock_rate import with_clock_rates
from stcalib_ros.core.final.image_times import added_covariance, with_image_times
from stcalib_ros.core.final.line_time import refine_with_line_times, with_line_times
from stcalib_ros.core.final.refine import refine
from stcalib_ros.core.final.spline import with_splines
from stcalib_ros.core.hypotheses import PairHypothesis
from stcalib_ros.core.left_out import LeftOut
from stcalib_ros.core.lift import LiftedCamera
from stcalib_ros.core.options import Options
from stcalib_ros.core.pairs import pair_tasks, registered, spread
from stcalib_ros.core.paper.pairs import Views, lift_views
from stcalib_ros.core.paper.stages import Grid, adjust_pairs, integrate_pairs, register_pairs
from stcalib_ros.core.placement import Placement, place
from stcalib_ros.core.resection import Resection, joined, register_again
from stcalib_ros.core.result import make_calibration, nothing
from stcalib_ros.core.rounds import Round, Unconnected, first_round, iterate, sub_rig
from stcalib_ros.core.skeleton import Skeleton
from stcalib_ros.core.slow_motion import put_back
from stcalib_ros.core.starts import best_start
from stcalib_ros.core.timeline import common_step
from stcalib_ros.core.types import Calibration, FloatArray, Recording
from stcalib_ros.core.velocity_noise import settled
from stcalib_ros.core.verdict import Solution, judge, rivalry

Progress = Callable[[str, float], None]
"""Called with the name of the stage and the fraction of it that is done."""


@dataclass(frozen=True, slots=True, eq=False)
class Stages:
    """Results of every stage; those after a failure are empty.

    Attributes
    ----------
    skeleton : Skeleton
    lifted : tuple of LiftedCamera
        In the order of the recording.
    hypotheses : tuple of PairHypothesis
        Of all pairs of cameras: registered (PR), and refined ones beside them.
    rigs : tuple of Rig
        Of the multi-view integration (MI), best first.
    rounds : tuple of Round
        Of the adjustment, the first and the last two: the first is STBA, the others ISTBA; where
        key points lean one way, one more without that.
    calibration : Calibration
    placement : Placement or None
        How the calibration lies in the world; None without cameras.
    """

    skeleton: Skeleton
    lifted: tuple[LiftedCamera, ...]
    hypotheses: tuple[PairHypothesis, ...]
    rigs: tuple[Rig, ...]
    rounds: tuple[Round, ...]
    calibration: Calibration
    placement: Placement | None = None


def calibrate(
    recording: Recording,
    options: Options | None = None,
    *,
    progress: Progress | None = None,
    cancelled: Callable[[], bool] | None = None,
    adjusted: Callable[[float], None] | None = None,
    executor: Executor | None = None,
) -> Calibration:
    """Calibrate cameras from the people that they see.

    Parameters
    ----------
    recording : Recording
    options : Options, optional
    progress : callable, optional
        Called with the name of the stage and the fraction of it that is done.
    cancelled : callable, optional
        Asked between steps; the calibration ends when it returns true.
    adjusted : callable, optional
        Called with the root mean square reprojection error so far, px, as soon as there is one
        and after every further round of the adjustment.
    executor : concurrent.futures.Executor, optional
        Registers the pairs of cameras; the numbers are the same with any. Default: this thread.

    Returns
    -------
    Calibration
        With a status other than ``OK`` where the data does not carry a calibration; its
        message says why.

    Raises
    ------
    InputError
        The reference camera or the joint layouts cannot be used.
    CalibrationError
        A worker of the executor was lost.
    Cancelled
        `cancelled` returned true.
    """
    run = _Run(recording, options or Options(), progress, cancelled, adjusted, executor)
    return run.stages().calibration


def run_stages(
    recording: Recording,
    options: Options | None = None,
    *,
    progress: Progress | None = None,
    cancelled: Callable[[], bool] | None = None,
    executor: Executor | None = None,
) -> Stages:
    """Like `calibrate`, with what every stage found."""
    run = _Run(recording, options or Options(), progress, cancelled, executor=executor)
    return run.stages()


class _Run:
    """One calibration under way: its input, and the results of the stages so far."""

    def __init__(
        self,
        recording: Recording,
        options: Options,
        progress: Progress | None,
        cancelled: Callable[[], bool] | None,
        adjusted: Callable[[float], None] | None = None,
        executor: Executor | None = None,
    ) -> None:
        self.recording, self.options = recording, options
        self.progress, self.cancelled, self.adjusted = progress, cancelled, adjusted
        self.executor = executor
        self.hypotheses: tuple[PairHypothesis, ...] = ()
        self.rigs: tuple[Rig, ...] = ()
        self.rounds: tuple[Round, ...] = ()
        self.left_out = LeftOut(
            [camera.name for camera in recording.cameras], offset_range_s=options.offset_range_s
        )
        self.placement: Placement | None = None

    def tick(self, stage: str, fraction: float) -> None:
        """Report progress; leave if the caller wants to."""
        if self.cancelled is not None and self.cancelled():
            raise Cancelled(f"cancelled during {stage}")
        if self.progress is not None:
            self.progress(stage, fraction)

    def stages(self) -> Stages:
        first = require_reference(self.recording, self.options)
        require_known_cameras(self.recording, self.options)
        require_line_times(self.recording)
        self.tick("lift", 0.0)
        views = lift_views(self.recording, self.options)
        self.skeleton, self.lifted = views.skeleton, views.lifted
        try:
            calibration = self._calibration(first)
        except Insufficient as why:
            calibration = nothing(
                self.recording,
                status=why.status,
                message=why.message,
                uncalibrated=why.uncalibrated,
            )
        return Stages(
            self.skeleton,
            self.lifted,
            self.hypotheses,
            self.rigs,
            self.rounds,
            calibration,
            self.placement,
        )

    def _calibration(self, first: int) -> Calibration:
        selection = select_cameras(self.lifted, first, self.options)
        self.left_out.cameras = selection.rejected
        self.step_s = common_step([self.lifted[c] for c in selection.cameras])
        if self.options.registration.method == "vmf":
            return self._by_the_paper(selection.cameras)
        self.hypotheses = self._register(selection.cameras)
        group = self.left_out.largest_group(selection.cameras, self.hypotheses)
        self.tick("integration", 0.0)
        rigs = integrate(
            group,
            [h for h in self.hypotheses if h.a in group and h.b in group],
            frame_s=self.step_s,
            n_trees=self.options.integration.n_trees,
            rng=np.random.default_rng(self.options.seed),
        )
        self.rigs = tuple(replace(rig, synchronised=self.options.synchronised) for rig in rigs)
        start, rival = best_start(self.rigs, self._start, self.left_out, self.tick)
        if rival is not None:
            range_s = self.options.offset_range_s
            complaint = rivalry(start, rival, offset_range_s=range_s)
            return self._verdict(self._solved(start, give_up=True), complaint)
        found = self._solved(start)
        return self._verdict(self._with_those_left_out(found, selection.cameras))

    def _solved(self, start: Round, *, give_up: bool = False) -> Solution:
        """Adjust to the end, without cameras that have to be doubted."""
        while True:
            rounds = self._iterate(start)
            rounds, covariance = self._refined(rounds)
            last = rounds[-1]
            self.tick("quality", 0.0)
            found = self._evidence(last, covariance)
            bad = [i for i, e in enumerate(found) if e.complaint() is not None]
            if not bad or give_up or 2 * len(bad) >= len(found):
                return Solution(rounds, covariance, found, self.left_out.cameras)
            worst = min(bad, key=lambda i: found[i].inliers)
            self.left_out.add([int(last.rig.cameras[worst])], str(found[worst].complaint()))
            start = self._start(sub_rig(last.rig, _all_but(len(found), [worst])))

    def _with_those_left_out(self, before: Solution, order: Sequence[int]) -> Solution:
        """The solution with cameras that come back now that the people are known, if any do."""
        present = before.last.rig.cameras.tolist()
        found: dict[int, Resection] = {}
        if not before.sound:
            return before
        for c in order:
            if c not in present:
                self.tick("registration of a camera that was left out", 0.0)
                one = register_again(self.lifted, c, self.skeleton, before.last, self.options)
                found |= {} if one is None else {c: one}
        if not found:
            return before
        self.left_out.take_back(list(found))
        try:
            after = self._solved(self._start(joined(before.last.rig, found, order)))
        except Insufficient:
            return before
        kept = set(after.last.rig.cameras.tolist())
        return after if after.sound and kept > set(present) else before

    def _by_the_paper(self, cameras: Sequence[int]) -> Calibration:
        """The paper's own stages, from pairwise registration to ISTBA."""
        views = Views(self.skeleton, self.lifted)
        grid = Grid(*self._grid(cameras), step_s=self.step_s)
        pairs = register_pairs(views, cameras, self.options, grid, self.tick)
        self.hypotheses = tuple(pair.hypothesis for pair in pairs)
        rig = integrate_pairs(
            self.left_out.largest_group(cameras, self.hypotheses), pairs, self.options
        )
        self.rigs = (rig,)
        while True:
            result = adjust_pairs(self.lifted, rig, pairs, self.options, grid, self.tick)
            if not isinstance(result, Unconnected):
                break
            rig = self.left_out.largest_part(rig, result)
        last = result[-1]
        covariance = pose_covariance(last.observations, last.state)
        found = self._evidence(last, covariance)
        return self._verdict(Solution(result, covariance, found, self.left_out.cameras))

    def _grid(self, cameras: Sequence[int]) -> tuple[float, int]:
        """Time of the first sample and number of samples that hold all images of some cameras."""
        start = min(float(self.lifted[c].stamps[0]) for c in cameras)
        end = max(float(self.lifted[c].stamps[-1]) for c in cameras)
        return start, int((end - start) / self.step_s) + 1

    def _evidence(self, last: Round, covariance: FloatArray) -> tuple[CameraEvidence, ...]:
        return evidence(
            self.lifted,
            self.skeleton,
            last,
            covariance,
            offset_range_s=self.options.offset_range_s,
        )

    def _register(self, cameras: Sequence[int]) -> tuple[PairHypothesis, ...]:
        """Pairwise registration and two-view refinement of all pairs of cameras."""
        start, n = self._grid(cameras)
        tasks = pair_tasks(
            self.lifted, cameras, self.skeleton, self.options, start=start, step=self.step_s, n=n
        )
        found = spread(
            registered,
            tasks,
            self.executor,
            lambda fraction: self.tick("pairwise registration", fraction),
        )
        return tuple(h for hypotheses in found for h in hypotheses)

    def _start(self, rig: Rig) -> Round:
        """First round at a rig; cameras that fall off are reported and left out."""
        while True:
            result = first_round(self.lifted, rig, self.options.bundle, step_s=self.step_s)
            if isinstance(result, Round):
                return result
            rig = self.left_out.largest_part(rig, result)

    def _iterate(self, start: Round) -> tuple[Round, ...]:
        while True:
            result = iterate(
                self.lifted,
                start,
                self.options.bundle,
                step_s=self.step_s,
                tick=self._tick_round,
            )
            if not isinstance(result, Unconnected):
                return result
            start = self._start(self.left_out.largest_part(start.rig, result))

    def _refined(self, rounds: tuple[Round, ...]) -> tuple[tuple[Round, ...], FloatArray]:
        """Adjust with line times, biases, errors of stamps, clock rates; covariance of that."""
        bundle, layout = self.options.bundle, self.skeleton.layout
        self._tick_round(1.0, rounds[-1])
        if self.options.estimate_line_time:
            last, refined = refine_with_line_times(self.lifted, rounds[-1], layout, bundle)
            rounds = (*rounds[:-1], last)
        else:
            refined = refine(self.lifted, rounds[-1], layout, bundle)
        if refined is not None:
            rounds += (refined.round,)
        last = with_image_times(self.lifted, rounds[-1], bundle)
        if self.options.estimate_line_time and last.stamps is not None:
            last = with_line_times(self.lifted, last, bundle)
        last = with_clock_rates(last, bundle)
        state = put_back(last.observations, last.state, iterations=bundle.max_iterations)
        if state is last.state:
            state = settled(last.observations, state)
        last = with_splines(self.lifted, last.moved(last.observations, state), bundle)
        covariance = pose_covariance(last.observations, last.state) + added_covariance(last)
        if last.lines is not None:
            covariance = covariance + last.lines.added
        if refined is not None:
            covariance = covariance + refined.excess
        return (*rounds[:-1], last), covariance

    def _tick_round(self, fraction: float, before: Round) -> None:
        if self.adjusted is not None:
            self.adjusted(before.rms_px())
        self.tick("bundle adjustment", fraction)

    def _verdict(self, solution: Solution, complaint: str = "") -> Calibration:
        """The result, with its status."""
        self.rounds = solution.rounds
        last, covariance = solution.last, solution.covariance
        self.placement = place(
            self.recording, self.lifted, self.skeleton, last, covariance, self.options
        )
        status, message = judge(
            self.lifted, self.skeleton, solution, (complaint, self.placement.complaint)
        )
        return make_calibration(
            self.recording,
            self.lifted,
            self.skeleton,
            last,
            covariance,
            self.placement,
            status=status,
            message=message,
            uncalibrated=solution.left_out,
            world_frame=self.options.world_frame,
        )


def _all_but(n: int, left_out: Sequence[int]) -> list[int]:
    return [i for i in range(n) if i not in left_out]
