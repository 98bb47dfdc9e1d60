"""People of a recording, triangulated by a calibration that is given."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.bundle.istba import finish_iteration
from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.bundle.limits import FLOOR_PX
from stcalib_ros.core.bundle.observations import observe
from stcalib_ros.core.bundle.outliers import drop_outliers, image_points
from stcalib_ros.core.bundle.residuals import errors_px
from stcalib_ros.core.bundle.state import initial_state
from stcalib_ros.core.capture.evidence import CaptureEvidence
from stcalib_ros.core.errors import InputError
from stcalib_ros.core.integration.association import associate
from stcalib_ros.core.lifting.body_size import pose_size
from stcalib_ros.core.lifting.input_screening import readable_input
from stcalib_ros.core.lifting.lift import lift_recording
from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.recording import Recording
from stcalib_ros.core.model.rig import Rig
from stcalib_ros.core.model.rolling_shutter import with_known_line_times
from stcalib_ros.core.model.skeleton import Skeleton, common_skeleton
from stcalib_ros.core.monitoring.lenses import with_lenses_in_force
from stcalib_ros.core.monitoring.matching import metres_per_unit, on_reference_clock, rig_of
from stcalib_ros.core.options import Options
from stcalib_ros.core.reconstruction.trajectories import PersonTrajectory
from stcalib_ros.core.registration.resampling import common_grid


@dataclass(frozen=True, slots=True, eq=False)
class Capture:
    """People of a recording by a calibration.

    Attributes
    ----------
    people : tuple of PersonTrajectory
        In the frame and unit of the calibration; those who were observed most first.
    explained : mapping of str to float
        Fraction of the keypoints of each camera that agree with the others, by its name: little
        where it has moved, its clock was set, or it sees others than the rest.
    reprojection_rms_px : float
        Root mean square over these keypoints; NaN without any.
    """

    people: tuple[PersonTrajectory, ...]
    explained: Mapping[str, float]
    reprojection_rms_px: float


def capture_people(
    recording: Recording, calibration: Calibration, options: Options | None = None
) -> Capture:
    """Triangulate the people of a recording by a calibration, without calibrating again.

    Parameters
    ----------
    recording : Recording
        Of the same cameras, by the same clocks; further cameras are ignored.
    calibration : Calibration
    options : Options, optional
        For `min_score` and the limits of outliers.

    Raises
    ------
    InputError
        Fewer than two of the calibrated cameras see anybody.

    Examples
    --------
    >>> import stcalib_ros as st
    >>> scene = st.simulate(st.SceneOptions(n_cameras=3, n_people=2, n_frames=90))
    >>> people = st.capture_people(scene.recording, scene.truth).people
    >>> [(person.person_id, person.joints_ref.shape[1:]) for person in people]
    [(0, (17, 3)), (1, (17, 3))]
    """
    found = find_evidence(recording, calibration, options)
    if found is None:
        seen = _calibrated_cameras(recording, calibration, options or Options())
        return Capture((), {camera.name: 0.0 for camera in seen.cameras}, float("nan"))
    n_used = found.last.state.inlier.sum((0, 2)) / np.maximum(image_points(found.lifted), 1)
    explained = {c.name: float(share) for c, share in zip(found.lifted, n_used, strict=True)}
    return Capture(found.trajectories(), explained, found.last.rms_px())


def find_evidence(
    recording: Recording, calibration: Calibration, options: Options | None = None
) -> CaptureEvidence | None:
    """Triangulate the people of a recording, and return how well the cameras agree on them.

    None where nobody is seen by two cameras at a time.

    Parameters
    ----------
    recording : Recording
        Of the same cameras, by the same clocks; further cameras are ignored.
    calibration : Calibration
    options : Options, optional
        For `min_score` and the limits of outliers.

    Raises
    ------
    InputError
        Fewer than two of the calibrated cameras see anybody.
    """
    options = options or Options()
    seen = _calibrated_cameras(recording, calibration, options)
    skeleton = common_skeleton(seen)
    cameras, rig = _on_one_clock(seen, calibration, skeleton, options)
    unit_m = metres_per_unit(cameras, rig)
    rig = replace(rig, t_ref_cam=rig.t_ref_cam * unit_m)
    last = _triangulated(cameras, rig, options, usual_px=calibration.reprojection_rms_px)
    if last is None:
        return None
    return CaptureEvidence(tuple(cameras), last, skeleton, lambda points: points / unit_m)


def metres_of(
    calibration: Calibration, people: Sequence[PersonTrajectory], recording: Recording
) -> float:
    """Return the metres of the unit of a calibration, by the size of its people if it has none.

    Parameters
    ----------
    calibration : Calibration
    people : sequence of PersonTrajectory
        In its unit; one or more.
    recording : Recording
        That they are from.
    """
    if calibration.metric:
        return 1.0
    skeleton = common_skeleton(recording)
    joints = np.concatenate([person.joints_ref for person in people])
    return 1.0 / pose_size(joints, skeleton.directions, skeleton.adult_lengths)


def _calibrated_cameras(
    recording: Recording, calibration: Calibration, options: Options
) -> Recording:
    """Return the recording of the cameras of a calibration that see anybody, with its lenses."""
    poses = {camera.name: camera for camera in calibration.cameras}
    readable = readable_input(
        with_lenses_in_force(recording, calibration), min_score=options.min_score
    )
    cameras = tuple(c for c in readable.cameras if c.name in poses and c.tracks)
    if len(cameras) < 2:
        recorded = ", ".join(camera.name for camera in recording.cameras)
        raise InputError(
            f"people need two calibrated cameras that see them: the recording has {recorded}, and "
            f"the calibration {', '.join(poses) or 'none'}; their names have to be the same"
        )
    line_times = {camera.name: poses[camera.name].line_time_s for camera in cameras}
    return with_known_line_times(replace(readable, cameras=cameras), line_times)


def _on_one_clock(
    recording: Recording, calibration: Calibration, skeleton: Skeleton, options: Options
) -> tuple[list[LiftedCamera], Rig]:
    """Return the cameras, lifted, with stamps by the reference clock, and their poses."""
    known = {camera.name: camera for camera in calibration.cameras}
    poses = [known[camera.name] for camera in recording.cameras]
    since_epoch_s = recording.epoch_ns * 1e-9 - calibration.epoch_s
    lifted = lift_recording(recording, skeleton, min_score=options.min_score)
    pairs = zip(lifted, poses, strict=True)
    return [on_reference_clock(*pair, since_epoch_s) for pair in pairs], rig_of(poses)


def _triangulated(
    cameras: Sequence[LiftedCamera], rig: Rig, options: Options, *, usual_px: float
) -> Iteration | None:
    """Associate people and triangulate them, twice: the second time without the outliers.

    In the end, errors count against the usual one of the calibration: where cameras are not where
    they were, all errors are large.
    """
    step_s = common_grid(cameras).step_s
    association = associate(cameras, rig, step_s=step_s, floor_px=FLOOR_PX)
    observations = observe(cameras, rig, association, step_s=step_s)
    if not len(observations.person):
        return None
    state = drop_outliers(observations, initial_state(observations, rig), options.bundle)
    again = initial_state(replace(observations, observed=state.inlier), rig)
    state = drop_outliers(observations, again, options.bundle)
    if np.isfinite(usual_px):
        bundle = options.bundle
        limit_px = max(bundle.outlier_floor_px, bundle.outlier_factor * usual_px)
        fits = errors_px(observations, state) < limit_px
        state = state.with_inliers(state.inlier & fits)
    return finish_iteration(rig, association, observations, state, image_points(cameras))
