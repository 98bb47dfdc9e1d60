"""The calibration, from a recording to poses and clocks: a row of stages.

lift, pairwise registration, multi-view integration, iterated bundle adjustment, quality. Each
stage is a function of plain records; `run_stages` keeps what each of them found.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import replace

import numpy as np

from stcalib_ros.core.bundle.covariance import pose_covariance
from stcalib_ros.core.bundle.initialization import select_initial_rig
from stcalib_ros.core.bundle.istba import initial_adjustment, run_istba
from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.errors import Cancelled
from stcalib_ros.core.integration.averaging import integrate
from stcalib_ros.core.integration.exclusions import Disconnected, Exclusions
from stcalib_ros.core.lifting.input_checks import (
    require_known_cameras,
    require_line_times,
    require_reference,
    select_cameras,
)
from stcalib_ros.core.lifting.views import LiftedViews, lift_views
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.core.model.recording import Recording
from stcalib_ros.core.model.rejection import Insufficient
from stcalib_ros.core.model.relative_pose import RelativePose
from stcalib_ros.core.model.rig import Rig, sub_rig
from stcalib_ros.core.options import Options
from stcalib_ros.core.output.assemble import failed_calibration, make_calibration
from stcalib_ros.core.output.world_frame import WorldAlignment, place
from stcalib_ros.core.paper.stages import Grid, adjust_pairs, integrate_pairs, register_pairs
from stcalib_ros.core.reconstruction.resection import Resection, add_cameras, resect
from stcalib_ros.core.refinement.sequence import refine
from stcalib_ros.core.registration.executors import map_tasks
from stcalib_ros.core.registration.pairs import pair_tasks, register
from stcalib_ros.core.registration.resampling import common_step
from stcalib_ros.core.stages import Stages
from stcalib_ros.core.validation.camera_checks import CameraChecks, check_cameras
from stcalib_ros.core.validation.verdict import Solution, judge, rivalry

Progress = Callable[[str, float], None]
"""Called with the name of the stage and the fraction of it that is done."""


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
        self.hypotheses: tuple[RelativePose, ...] = ()
        self.rigs: tuple[Rig, ...] = ()
        self.rounds: tuple[Iteration, ...] = ()
        self.left_out = Exclusions(
            [camera.name for camera in recording.cameras], offset_range_s=options.offset_range_s
        )
        self.placement: WorldAlignment | None = None

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
            calibration = failed_calibration(
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
        start, rival = select_initial_rig(self.rigs, self._start, self.left_out, self.tick)
        if rival is not None:
            range_s = self.options.offset_range_s
            complaint = rivalry(start, rival, offset_range_s=range_s)
            return self._verdict(self._solved(start, give_up=True), complaint)
        found = self._solved(start)
        return self._verdict(self._with_those_left_out(found, selection.cameras))

    def _solved(self, start: Iteration, *, give_up: bool = False) -> Solution:
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
                one = resect(self.lifted, c, self.skeleton, before.last, self.options)
                found |= {} if one is None else {c: one}
        if not found:
            return before
        self.left_out.reinstate(list(found))
        try:
            after = self._solved(self._start(add_cameras(before.last.rig, found, order)))
        except Insufficient:
            return before
        kept = set(after.last.rig.cameras.tolist())
        return after if after.sound and kept > set(present) else before

    def _by_the_paper(self, cameras: Sequence[int]) -> Calibration:
        """The paper's own stages, from pairwise registration to ISTBA."""
        views = LiftedViews(self.skeleton, self.lifted)
        grid = Grid(*self._grid(cameras), step_s=self.step_s)
        pairs = register_pairs(views, cameras, self.options, grid, self.tick)
        self.hypotheses = tuple(pair.hypothesis for pair in pairs)
        rig = integrate_pairs(
            self.left_out.largest_group(cameras, self.hypotheses), pairs, self.options
        )
        self.rigs = (rig,)
        while True:
            result = adjust_pairs(self.lifted, rig, pairs, self.options, grid, self.tick)
            if not isinstance(result, Disconnected):
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

    def _evidence(self, last: Iteration, covariance: Float64Array) -> tuple[CameraChecks, ...]:
        return check_cameras(
            self.lifted,
            self.skeleton,
            last,
            covariance,
            offset_range_s=self.options.offset_range_s,
        )

    def _register(self, cameras: Sequence[int]) -> tuple[RelativePose, ...]:
        """Pairwise registration and two-view refinement of all pairs of cameras."""
        start, n = self._grid(cameras)
        tasks = pair_tasks(
            self.lifted, cameras, self.skeleton, self.options, start=start, step=self.step_s, n=n
        )
        found = map_tasks(
            register,
            tasks,
            self.executor,
            lambda fraction: self.tick("pairwise registration", fraction),
        )
        return tuple(h for hypotheses in found for h in hypotheses)

    def _start(self, rig: Rig) -> Iteration:
        """First round at a rig; cameras that fall off are reported and left out."""
        while True:
            result = initial_adjustment(self.lifted, rig, self.options.bundle, step_s=self.step_s)
            if isinstance(result, Iteration):
                return result
            rig = self.left_out.largest_part(rig, result)

    def _iterate(self, start: Iteration) -> tuple[Iteration, ...]:
        while True:
            result = run_istba(
                self.lifted,
                start,
                self.options.bundle,
                step_s=self.step_s,
                tick=self._tick_round,
            )
            if not isinstance(result, Disconnected):
                return result
            start = self._start(self.left_out.largest_part(start.rig, result))

    def _refined(self, rounds: tuple[Iteration, ...]) -> tuple[tuple[Iteration, ...], Float64Array]:
        self._tick_round(1.0, rounds[-1])
        refined = refine(
            self.lifted,
            rounds,
            self.skeleton.layout,
            self.options.bundle,
            estimate_line_delays=self.options.estimate_line_time,
        )
        return refined.iterations, refined.covariance.poses_and_offsets()

    def _tick_round(self, fraction: float, before: Iteration) -> None:
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
