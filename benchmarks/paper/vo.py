"""Spatiotemporal bundle adjustment of Vo et al. (TPAMI 2020), as the paper compares with it.

Camera poses come from incremental structure from motion on the static background, offsets start
at zero, and who is who is given; then the reprojection error of moving joints is minimised over
poses, offsets and motion.

Assumed here: background points and their matches are simulated (`benchmarks.paper.background`),
and the adjustment is ours (`stcalib_ros.core.bundle.levenberg_marquardt`), as the paper used its
own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.paper.background import background_views
from benchmarks.paper.sfm import incremental_sfm
from stcalib_ros.core.bundle.levenberg_marquardt import adjust
from stcalib_ros.core.bundle.observations import observe
from stcalib_ros.core.bundle.outliers import drop_outliers
from stcalib_ros.core.bundle.residuals import errors_px
from stcalib_ros.core.bundle.state import BundleState, initial_state
from stcalib_ros.core.integration.association import Association
from stcalib_ros.core.lifting.lift import lift_recording
from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.recording import Recording
from stcalib_ros.core.model.rig import Rig
from stcalib_ros.core.model.skeleton import common_skeleton
from stcalib_ros.core.options import Options
from stcalib_ros.core.registration.resampling import common_step
from stcalib_ros.core.synthetic import SceneRig as World

_ROUNDS = 8
"""Rounds of the adjustment."""


@dataclass(frozen=True, slots=True, eq=False)
class VoResult:
    """Poses and clocks, and the reprojection error.

    Attributes
    ----------
    rig : Rig
    mean_px, rms_px : float
    """

    rig: Rig
    mean_px: float
    rms_px: float


def calibrate_vo(
    rng: np.random.Generator, recording: Recording, truth: Calibration, world: World
) -> VoResult:
    """Run it on a recording.

    Parameters
    ----------
    rng : Generator
        Generator for the background.
    recording : Recording
    truth : Calibration
        Only its persons are used: the associations are given.
    world : Rig
        The true cameras, for the simulation of the background.

    Raises
    ------
    SfmFailure
        The initialisation does not register all cameras.
    """
    options = Options()
    skeleton = common_skeleton(recording)
    lifted = lift_recording(recording, skeleton, min_score=options.min_score)
    step_s = common_step(lifted)
    rig = incremental_sfm(background_views(rng, world)).rig
    for _ in range(_ROUNDS):
        association = given_association(lifted, truth, rig)
        observations = observe(lifted, rig, association, step_s=step_s)
        state = initial_state(observations, rig)
        state = drop_outliers(observations, state, options.bundle)
        state = adjust(observations, state, iterations=12, tolerance=0.1)
        rig = _rig_of(state, rig)
    errors = errors_px(observations, state)[state.inlier]
    return VoResult(rig, float(errors.mean()), float(np.sqrt(np.mean(errors**2))))


def given_association(lifted: Sequence[LiftedCamera], truth: Calibration, rig: Rig) -> Association:
    """The true persons of all tracks, in one slot as long as the recording."""
    person_of = tuple(
        np.array(
            [[_person(truth, camera.name, track.track_id)] for track in camera.tracks],
            dtype=np.int64,
        ).reshape(-1, 1)
        for camera in lifted
    )
    times = np.concatenate([camera.stamps + rig.offset_s[c] for c, camera in enumerate(lifted)])
    start, end = float(times.min()), float(times.max())
    n = 1 + max(int(p.max(initial=-1)) for p in person_of)
    return Association(person_of, start, end - start, n, 0.0, {})


def _person(truth: Calibration, camera: str, track_id: int) -> int:
    for k, person in enumerate(truth.persons):
        if track_id in person.tracks.get(camera, ()):
            return k
    return -1


def _rig_of(state: BundleState, rig: Rig) -> Rig:
    R_ref_cam = np.swapaxes(state.R_cam_ref, -1, -2)
    return replace(
        rig,
        R_ref_cam=R_ref_cam,
        t_ref_cam=0.0 - np.einsum("cij,cj->ci", R_ref_cam, state.t_cam_ref),
        offset_s=rig.offset_s + state.shift_s,
    )
