"""Whether a recording will calibrate: its input is checked, its pairs registered, and no more.

The stages are those of the calibration, up to the first adjustment of the best rig on a part of the
joints. What these refuse is refused by a calibration as well; what only the residuals of the whole
adjustment show is not known here.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from stcalib_ros.core.bundle.initialization import Start
from stcalib_ros.core.bundle.outliers import drop_outliers, image_points
from stcalib_ros.core.control import Control
from stcalib_ros.core.diagnosis.facts import CameraFacts, facts_of
from stcalib_ros.core.errors import InputError
from stcalib_ros.core.geometry.interpolation import frame_period
from stcalib_ros.core.integration.exclusions import Exclusions, largest_group
from stcalib_ros.core.lifting.input_checks import require_usable, select_cameras
from stcalib_ros.core.lifting.input_screening import screen_input
from stcalib_ros.core.lifting.views import LiftedViews, lift_views
from stcalib_ros.core.methods import METHODS
from stcalib_ros.core.model.arrays import IntArray
from stcalib_ros.core.model.calibration import Insufficient, Status, UncalibratedCamera
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.recording import CameraRecording, Recording, only_images
from stcalib_ros.core.model.rejection import Rejection, RejectionReason, Remark
from stcalib_ros.core.model.relative_pose import RelativePose
from stcalib_ros.core.options import Options
from stcalib_ros.core.pipeline import make_problem
from stcalib_ros.core.solution import CalibrationProblem, adjust_initially

MIN_FITTING = 0.86
"""Fraction of the keypoints of the people that a camera shares with others that fit the first
adjustment. With less, and less than `MIN_EXPLAINED` of all that it sees, it was matched by chance.
Measured on simulated cameras that see different people (0.71 to 0.84 in 5 s), that share half of
them (0.90 to 1.00), or that people walk out of (0.87 to 0.99)."""

MIN_EXPLAINED = 0.75
"""Fraction of all keypoints of a camera that fit the first adjustment. Where it is less in all
cameras, they see different people. Measured on the same scenes: 0.3 to 0.65 where they do, and 0.79
and more in one camera at least where they do not."""


ENOUGH_IMAGES = 400
"""Images of a camera. Of twice as many or more, only every second, third, ... one is compared with
the other cameras, so that this takes as long as 13 s of 30 Hz do. Chosen."""

ENOUGH_HZ = 12.0
"""Images per second that are compared at least, however many there are: steps and arms are still
followed (`MIN_RATE_HZ` of the advice is 10). Chosen."""


@dataclass(frozen=True, slots=True)
class PairFacts:
    """What two cameras have in common.

    Attributes
    ----------
    camera_a, camera_b : str
    n_matches : int
        Number of pairs of tracks that show one person; 0: nobody was matched.
    shared_s : float
        Time for which both see somebody who was matched, summed over persons, seconds.
    lag_s : float
        ``t_b - t_a`` of the same time, seconds; NaN if nobody was matched.
    epipolar_px : float
        Median distance of matched keypoints from their epipolar lines; NaN likewise.
    """

    camera_a: str
    camera_b: str
    n_matches: int = 0
    shared_s: float = 0.0
    lag_s: float = float("nan")
    epipolar_px: float = float("nan")


@dataclass(frozen=True, slots=True)
class CameraFit:
    """How much of what a camera sees fits the first adjustment.

    Attributes
    ----------
    fitting : float
        Fraction of the keypoints of the people that it shares with others.
    explained : float
        Fraction of all its keypoints.
    """

    fitting: float
    explained: float

    @property
    def is_doubtful(self) -> bool:
        """Whether the camera may be left out: by chance, or since it changed on the way."""
        return self.fitting < MIN_FITTING or self.explained < MIN_EXPLAINED


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """What is in a recording, and what a calibration of it will come to.

    Attributes
    ----------
    cameras : tuple of CameraFacts
    pairs : tuple of PairFacts
        All pairs of cameras that can be compared; empty where fewer than two can.
    calibrated : tuple of str
        Cameras that a calibration is expected to have; empty if none is.
    uncalibrated : tuple of UncalibratedCamera
        Cameras that it will leave out, with the reasons.
    rejections : tuple of Rejection
        Why there will be no calibration; empty if there will.
    remarks : tuple of Remark
        What was put right.
    fits : mapping of str to CameraFit
        How much of what a camera sees fits the first adjustment, by its name; empty where it does
        not come to that.
    unusable : str
        Why nothing can be computed with these cameras and options; empty if something can.
    """

    cameras: tuple[CameraFacts, ...]
    pairs: tuple[PairFacts, ...] = ()
    calibrated: tuple[str, ...] = ()
    uncalibrated: tuple[UncalibratedCamera, ...] = ()
    rejections: tuple[Rejection, ...] = ()
    remarks: tuple[Remark, ...] = ()
    fits: Mapping[str, CameraFit] = field(default_factory=dict)
    unusable: str = ""

    @property
    def will_calibrate(self) -> bool:
        """Whether a calibration is expected to succeed."""
        return bool(self.calibrated)

    @property
    def doubtful(self) -> tuple[str, ...]:
        """Cameras that a calibration is expected to have, but of which little fits."""
        return tuple(n for n in self.calibrated if n in self.fits and self.fits[n].is_doubtful)

    @property
    def reasons(self) -> tuple[Rejection, ...]:
        """All rejections: those of the calibration, then those of single cameras; each once."""
        found = [*self.rejections, *(one.rejection for one in self.uncalibrated)]
        return tuple(one for i, one in enumerate(found) if one not in found[:i])


def examine(recording: Recording, options: Options | None = None) -> Diagnosis:
    """Say what is in a recording, and predict whether it will calibrate.

    Parameters
    ----------
    recording : Recording
    options : Options, optional
        As for `calibrate`.

    Returns
    -------
    Diagnosis

    Examples
    --------
    >>> import stcalib_ros as st
    >>> scene = st.simulate(st.SceneOptions(n_cameras=3, n_people=2, n_frames=180))
    >>> found = st.examine(scene.recording, st.Options(offset_range_s=0.5))
    >>> found.will_calibrate, found.calibrated
    (True, ('cam0', 'cam1', 'cam2'))
    """
    options = options or Options()
    facts = facts_of(recording.cameras, options)
    try:
        return _examined(recording, options, facts)
    except InputError as why:
        return Diagnosis(facts, unusable=str(why))


def _examined(recording: Recording, options: Options, facts: tuple[CameraFacts, ...]) -> Diagnosis:
    reference = require_usable(recording, options)
    screened = screen_input(recording, options)
    views = lift_views(_thinned(screened.recording), options)
    pairs: tuple[PairFacts, ...] = ()
    fits: dict[str, CameraFit] = {}
    try:
        selection = select_cameras(views.lifted, reference, options, screened.faults)
        problem = make_problem(views, selection, options, Control())
        method = METHODS[options.registration.method]
        found = method.register(problem)
        problem = replace(problem, views=found.views or views)
        pairs = _pairs(views, selection.cameras, found.hypotheses)
        group, exclusions = largest_group(problem.exclusions, problem.cameras, found.hypotheses)
        rigs = method.integrate(problem, group, found)
        start = adjust_initially(problem, rigs[0], exclusions)
        fits = _fits(problem, start)
        exclusions = _without_strangers(start.exclusions, fits)
    except Insufficient as why:
        return Diagnosis(
            *(facts, pairs, (), why.uncalibrated, (why.rejection,), screened.remarks, fits)
        )
    left_out = {one.name for one in exclusions.cameras}
    names = tuple(camera.name for camera in facts if camera.name not in left_out)
    return Diagnosis(facts, pairs, names, exclusions.cameras, (), screened.remarks, fits)


def _thinned(recording: Recording) -> Recording:
    """Leave out images of cameras that have more than it takes."""
    return replace(recording, cameras=tuple(map(_thinned_camera, recording.cameras)))


def _thinned_camera(camera: CameraRecording) -> CameraRecording:
    n = len(camera.stamps)
    stride = n // ENOUGH_IMAGES
    if stride > 1:
        stride = min(stride, int(1.0 / (ENOUGH_HZ * frame_period(camera.stamps))))
    return only_images(camera, np.arange(n) % stride == 0) if stride > 1 else camera


def _fits(problem: CalibrationProblem, start: Start) -> dict[str, CameraFit]:
    """Return how much of what each camera sees fits an initial adjustment."""
    last = start.iteration
    obs = last.observations
    used = drop_outliers(obs, last.state, problem.options.bundle).inlier.sum((0, 2))
    cameras = [problem.views.lifted[c] for c in last.rig.cameras]
    fitting = used / np.maximum(obs.observed.sum((0, 2)), 1)
    explained = np.minimum(last.coverage * used / np.maximum(image_points(cameras), 1), 1.0)
    return {
        camera.name: CameraFit(float(shared), float(whole))
        for camera, shared, whole in zip(cameras, fitting, explained, strict=True)
    }


def _without_strangers(exclusions: Exclusions, fits: Mapping[str, CameraFit]) -> Exclusions:
    """Leave out cameras that were matched by chance.

    Raises
    ------
    Insufficient
        Fewer than two are left, or all of them were.
    """
    for name, fit in fits.items():
        if fit.explained < MIN_EXPLAINED and fit.fitting < MIN_FITTING:
            reason = RejectionReason.TOO_LITTLE_EXPLAINED
            why = Rejection(reason, (name,), fit.explained, MIN_EXPLAINED)
            exclusions = exclusions.adding([exclusions.names.index(name)], why)
    left_out = {one.name for one in exclusions.cameras}
    kept = [fit.explained for name, fit in fits.items() if name not in left_out]
    if len(kept) < 2 or max(kept) < MIN_EXPLAINED:
        reason, range_s = RejectionReason.NO_SHARED_MOTION, exclusions.offset_range_s
        raise Insufficient(
            Status.DEGENERATE, Rejection(reason, limit=range_s, unit="s"), exclusions.cameras
        )
    return exclusions


def _pairs(
    views: LiftedViews, cameras: Sequence[int], hypotheses: Sequence[RelativePose]
) -> tuple[PairFacts, ...]:
    """Return what all pairs of cameras have in common, by their best hypothesis."""
    best: dict[tuple[int, int], RelativePose] = {}
    for h in sorted(hypotheses, key=lambda h: h.support):
        best[h.a, h.b] = h
    pairs = [(a, b) for i, a in enumerate(cameras) for b in cameras[i + 1 :]]
    return tuple(_pair(views.lifted, a, b, best.get((a, b))) for a, b in pairs)


def _pair(cameras: Sequence[LiftedCamera], a: int, b: int, h: RelativePose | None) -> PairFacts:
    names = (cameras[a].name, cameras[b].name)
    if h is None:
        return PairFacts(*names)
    shared_s = _shared_s(cameras[a], cameras[b], h)
    return PairFacts(*names, len(h.matches), shared_s, h.lag_s, h.epipolar_px)


def _shared_s(a: LiftedCamera, b: LiftedCamera, h: RelativePose) -> float:
    """Return the time for which both see matched people, as many as the one that sees fewer."""
    period_s = frame_period(a.stamps)
    seen_a, seen_b = _seen(a, {p for p, _ in h.matches}), _seen(b, {q for _, q in h.matches})
    times = a.stamps + h.lag_s
    late = np.minimum(np.searchsorted(b.stamps, times), len(b.stamps) - 1)
    early = np.maximum(late - 1, 0)
    nearest = np.where(times - b.stamps[early] < b.stamps[late] - times, early, late)
    at_one_time = np.abs(b.stamps[nearest] - times) <= max(period_s, frame_period(b.stamps))
    return float((np.minimum(seen_a, seen_b[nearest]) * at_one_time).sum() * period_s)


def _seen(camera: LiftedCamera, tracks: Collection[int]) -> IntArray:
    """Return how many of some tracks are in each image (N,)."""
    seen: IntArray = np.zeros(len(camera.stamps), dtype=np.int64)
    for p in tracks:
        seen[camera.tracks[p].frames] += 1
    return seen
