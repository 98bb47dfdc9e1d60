"""The calibration, from a recording to poses and clocks: a row of stages.

lift, pairwise registration, multi-view integration, iterated bundle adjustment, quality. Each
stage is a function of plain records; `run_stages` keeps what each of them found.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.averaging import Rig, connected_groups, integrate
from stcalib_ros.core.checks import (
    Insufficient,
    require_known_cameras,
    require_reference,
    select_cameras,
)
from stcalib_ros.core.covariance import pose_covariance
from stcalib_ros.core.errors import Cancelled
from stcalib_ros.core.final.clock_rate import with_clock_rates
from stcalib_ros.core.final.image_times import added_covariance, with_image_times
from stcalib_ros.core.final.refine import refine
from stcalib_ros.core.hypotheses import PairHypothesis
from stcalib_ros.core.lift import LiftedCamera
from stcalib_ros.core.options import Options
from stcalib_ros.core.pairs import pair_tasks, registered, spread
from stcalib_ros.core.paper.pairs import Views, lift_views
from stcalib_ros.core.paper.stages import Grid, adjust_pairs, integrate_pairs, register_pairs
from stcalib_ros.core.placement import Placement, place
from stcalib_ros.core.quality import CameraEvidence, evidence
from stcalib_ros.core.result import make_calibration, nothing
from stcalib_ros.core.rounds import Round, Unconnected, first_round, iterate, sub_rig
from stcalib_ros.core.skeleton import Skeleton
from stcalib_ros.core.timeline import common_step
from stcalib_ros.core.types import (
    Calibration,
    FloatArray,
    Recording,
    Status,
    UncalibratedCamera,
)
from stcalib_ros.core.velocity_noise import settled

Progress = Callable[[str, float], None]
"""Called with the name of the stage and the fraction of it that is done."""

_RIVAL_SUPPORT = 0.5
_FEW_RIGS = 3
_COMPLETE = 0.6
_CLOSE = 0.3
_DECISIVE = 0.1
_OTHER_OFFSET_FRAMES = 3.0

_Start = tuple[Round, list[UncalibratedCamera]]
_FIT_SCALE_PX = 12.0


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
        self.rejected: list[UncalibratedCamera] = []
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
        self.rejected = list(selection.rejected)
        self.step_s = common_step([self.lifted[c] for c in selection.cameras])
        if self.options.registration.method == "vmf":
            return self._by_the_paper(selection.cameras)
        self.hypotheses = self._register(selection.cameras)
        group = self._group(selection.cameras)
        self.tick("integration", 0.0)
        rigs = integrate(
            group,
            [h for h in self.hypotheses if h.a in group and h.b in group],
            frame_s=self.step_s,
            n_trees=self.options.integration.n_trees,
            rng=np.random.default_rng(self.options.seed),
        )
        self.rigs = tuple(replace(rig, synchronised=self.options.synchronised) for rig in rigs)
        start, rival = self._best_start()
        complaint = None if rival is None else self._rivalry(start, rival)
        while True:
            self.rounds = self._iterate(start)
            covariance = self._refine()
            last = self.rounds[-1]
            self.tick("quality", 0.0)
            found = self._evidence(last, covariance)
            bad = [i for i, e in enumerate(found) if e.complaint() is not None]
            if not bad or complaint or 2 * len(bad) >= len(found):
                return self._verdict(covariance, complaint, found)
            worst = min(bad, key=lambda i: found[i].inliers)
            self._reject(last.rig, [worst], str(found[worst].complaint()))
            start = self._start(sub_rig(last.rig, _all_but(len(found), [worst])))

    def _by_the_paper(self, cameras: Sequence[int]) -> Calibration:
        """The paper's own stages, from pairwise registration to ISTBA."""
        views = Views(self.skeleton, self.lifted)
        grid = Grid(*self._grid(cameras), step_s=self.step_s)
        pairs = register_pairs(views, cameras, self.options, grid, self.tick)
        self.hypotheses = tuple(pair.hypothesis for pair in pairs)
        rig = integrate_pairs(self._group(cameras), pairs, self.options)
        self.rigs = (rig,)
        while True:
            result = adjust_pairs(self.lifted, rig, pairs, self.options, grid, self.tick)
            if not isinstance(result, Unconnected):
                break
            rig = self._largest(rig, result)
        self.rounds = result
        last = self.rounds[-1]
        covariance = pose_covariance(last.observations, last.state)
        return self._verdict(covariance, None, self._evidence(last, covariance))

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

    def _group(self, cameras: Sequence[int]) -> list[int]:
        """The cameras that hang together: the reference's group if it has two, else the largest."""
        position = {c: i for i, c in enumerate(cameras)}
        groups = connected_groups(cameras, self.hypotheses)
        kept = next((g for g in groups if cameras[0] in g and len(g) > 1), groups[0])
        self._reject_groups(
            [g for g in groups if g is not kept], kept, "shares nobody's motion with"
        )
        if len(kept) < 2:
            raise Insufficient(
                Status.INSUFFICIENT_DATA,
                "no two cameras see the same person move: check that their views overlap, that "
                f"their clocks agree within {self.options.offset_range_s:g} s (offset_range_s), "
                "and record longer",
                self.rejected,
            )
        return sorted(kept, key=lambda c: position[c])

    def _reject_groups(
        self, groups: Sequence[Sequence[int]], kept: Sequence[int], lacking: str
    ) -> None:
        names = ", ".join(self.lifted[c].name for c in kept)
        for group in groups:
            for c in group:
                others = [self.lifted[d].name for d in group if d != c]
                reason = f"{lacking} {names}"
                if others:
                    reason += f"; it forms a separate group with {', '.join(others)}"
                self.rejected.append(UncalibratedCamera(self.lifted[c].name, reason))

    def _best_start(self) -> tuple[Round, Round | None]:
        """First adjustment of the candidate rigs: the best fit, and a rival that fits as well."""
        starts = self._first_rounds()
        fits = _fits(starts)
        best = max(fits)
        close = [s for s, fit in zip(starts, fits, strict=True) if fit >= best - _CLOSE * abs(best)]
        if len(close) > 1:
            close = [self._repeated(start) for start in close]
        fits = _fits(close)
        first, *others = np.argsort([-fit for fit in fits], kind="stable").tolist()
        start, self.rejected = close[first]
        for k in others:
            n_other = start.differing(close[k][0], _OTHER_OFFSET_FRAMES * self.step_s)
            stake = abs(fits[first]) * n_other / len(start.rig.cameras)
            if n_other and fits[first] - fits[k] < _DECISIVE * stake:
                return start, close[k][0]
        return start, None

    def _first_rounds(self) -> list[_Start]:
        """First rounds of the best supported rigs: of three, of all while none explains enough."""
        rejected = list(self.rejected)
        starts: list[_Start] = []
        why: Insufficient | None = None
        for k, rig in enumerate(self.rigs):
            complete = any(start.share > _COMPLETE for start, _ in starts)
            supported = rig.support >= _RIVAL_SUPPORT * self.rigs[0].support
            if starts and not (supported and (k < _FEW_RIGS or not complete)):
                break
            self.tick("first adjustment", k / len(self.rigs))
            self.rejected = list(rejected)
            try:
                starts.append((self._start(rig), self.rejected))
            except Insufficient as reason:
                why = why or reason
        if why is not None and not starts:
            raise why
        return starts

    def _repeated(self, start: _Start) -> _Start:
        """The same once more from where it came to: persons are found better by then."""
        self.rejected = start[1]
        try:
            return self._start(start[0].rig), self.rejected
        except Insufficient:
            return start

    def _start(self, rig: Rig) -> Round:
        """First round at a rig; cameras that fall off are reported and left out."""
        while True:
            result = first_round(self.lifted, rig, self.options.bundle, step_s=self.step_s)
            if isinstance(result, Round):
                return result
            rig = self._largest(rig, result)

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
            start = self._start(self._largest(start.rig, result))

    def _refine(self) -> FloatArray:
        """Adjust with biases of key points, errors of stamps, clock rates; covariance of that."""
        bundle = self.options.bundle
        self._tick_round(1.0, self.rounds[-1])
        refined = refine(self.lifted, self.rounds[-1], self.skeleton.layout, bundle)
        if refined is not None:
            self.rounds += (refined.round,)
        last = with_clock_rates(with_image_times(self.lifted, self.rounds[-1], bundle), bundle)
        last = last.moved(last.observations, settled(last.observations, last.state))
        self.rounds = (*self.rounds[:-1], last)
        covariance = pose_covariance(last.observations, last.state) + added_covariance(last)
        return covariance if refined is None else covariance + refined.excess

    def _tick_round(self, fraction: float, before: Round) -> None:
        if self.adjusted is not None:
            self.adjusted(before.rms_px())
        self.tick("bundle adjustment", fraction)

    def _largest(self, rig: Rig, apart: Unconnected) -> Rig:
        """The part of a rig that holds together; the reference's if it has two cameras."""
        groups = apart.groups
        kept = next((g for g in groups if 0 in g and len(g) > 1), groups[0])
        self._reject_groups(
            [rig.cameras[list(g)].tolist() for g in groups if g is not kept],
            rig.cameras[list(kept)].tolist(),
            "hardly anything that it sees matches what is seen by",
        )
        if len(kept) < 2:
            raise Insufficient(
                Status.INSUFFICIENT_DATA,
                "people could not be matched across views: too few of their image points fit any "
                "two cameras; check the intrinsics, let views overlap more, and record longer",
                self.rejected,
            )
        return sub_rig(rig, kept)

    def _reject(self, rig: Rig, members: Sequence[int], reason: str) -> None:
        names = [self.lifted[rig.cameras[i]].name for i in members]
        self.rejected += [UncalibratedCamera(name, reason) for name in names]

    def _rivalry(self, best: Round, other: Round) -> str:
        """Say how two solutions that fit alike differ."""
        frames = best.clock_difference_s(other) / self.step_s
        what = (
            f"their clocks differ by {frames:.1f} frames" if frames >= 1.0 else "their poses differ"
        )
        return (
            f"two solutions fit about equally well, but {what}: motion that repeats itself, or "
            "people who move alike, do not tell them apart, or the true offset lies outside of "
            f"offset_range_s (+-{self.options.offset_range_s:g} s); set that to what is possible, "
            "or record more varied motion"
        )

    def _verdict(
        self, covariance: FloatArray, complaint: str | None, found: Sequence[CameraEvidence]
    ) -> Calibration:
        """The result, with its status."""
        last = self.rounds[-1]
        names = [self.lifted[c].name for c in last.rig.cameras]
        doubts = [
            f"{n}: {e.complaint()}" for n, e in zip(names, found, strict=True) if e.complaint()
        ]
        self.placement = place(
            self.recording, self.lifted, self.skeleton, last, covariance, self.options
        )
        status, message = Status.OK, _summary(len(names), len(self.recording.cameras))
        if complaint is not None:
            status, message = Status.DEGENERATE, complaint
        elif doubts:
            status, message = Status.DEGENERATE, "; ".join(doubts)
        elif self.placement.complaint:
            status, message = Status.DEGENERATE, self.placement.complaint
        elif len(self.rounds) > 1 and self.rounds[-2].differing(last, self.step_s):
            status = Status.NOT_CONVERGED
            message = "the adjustment had not settled after the last round: raise bundle.rounds"
        return make_calibration(
            self.recording,
            self.lifted,
            self.skeleton,
            last,
            covariance,
            self.placement,
            status=status,
            message=message,
            uncalibrated=self.rejected,
            world_frame=self.options.world_frame,
        )


def _summary(n: int, total: int) -> str:
    return f"{n} of {total} cameras calibrated"


def _all_but(n: int, left_out: Sequence[int]) -> list[int]:
    return [i for i in range(n) if i not in left_out]


def _fits(starts: Sequence[_Start]) -> list[float]:
    """How well each fits, all by the same measure."""
    scale_px = max(_FIT_SCALE_PX, 2.0 * min(start.median_px for start, _ in starts))
    return [start.fit(scale_px) for start, _ in starts]
