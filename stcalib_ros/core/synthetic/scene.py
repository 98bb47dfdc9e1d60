"""Simulated recordings with a known answer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.model.arrays import Float64Array, IntArray
from stcalib_ros.core.model.calibration import (
    Calibration,
    CameraCalibration,
    PersonAssociation,
    Status,
)
from stcalib_ros.core.model.recording import LensModel, Recording
from stcalib_ros.core.synthetic.changes import CameraChange
from stcalib_ros.core.synthetic.clips import MotionClip
from stcalib_ros.core.synthetic.noise import child_rng
from stcalib_ros.core.synthetic.observe import CameraObservation, Clock, observe
from stcalib_ros.core.synthetic.options import SceneOptions
from stcalib_ros.core.synthetic.people import PersonMotion, make_people
from stcalib_ros.core.synthetic.rigs import SceneRig, ring_rig, staged

EPOCH_NS = 1_760_000_000 * 10**9
"""Nanoseconds since the Unix epoch of time 0 of simulated recordings: some day in 2025."""
_MIN_OWNED_FRACTION = 0.2
"""Fraction of its frames from which on a track with exchanged ids belongs to a person. Chosen."""


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """A simulated recording and the truth about it.

    Attributes
    ----------
    options : SceneOptions
    recording : Recording
    truth : Calibration
        True calibration in the frame and clock of the first camera, metres.
    rig : SceneRig
        The cameras in the world (z up, floor at 0).
    people : tuple of PersonMotion
        Joints in the world at any time of the reference clock (seconds since the epoch).
    exposures_s : tuple of (N,) ndarray
        Per camera, the times of its images (of row 0) by the reference clock.
    track_persons : mapping of str to mapping of int to (F,) ndarray
        Per camera and track id, the true person in each frame of the track.
    """

    options: SceneOptions
    recording: Recording
    truth: Calibration
    rig: SceneRig
    people: tuple[PersonMotion, ...]
    exposures_s: tuple[Float64Array, ...]
    track_persons: Mapping[str, Mapping[int, IntArray]]

    def joints_world(self, times: Float64Array) -> Float64Array:
        """Return the true joints (P, T, 17, 3) in the world at times of the reference clock."""
        return np.stack([person(times) for person in self.people])

    def joints_ref(self, times: Float64Array) -> Float64Array:
        """Return the true joints (P, T, 17, 3) in the frame of the reference camera."""
        world = self.joints_world(times)
        return np.asarray(world @ self.rig.R_cam_world[0].T + self.rig.t_cam_world[0])

    @property
    def offsets_s(self) -> Float64Array:
        """True time offsets (C,), seconds."""
        return np.array([camera.time_offset_s for camera in self.truth.cameras])


def simulate(
    options: SceneOptions | None = None,
    *,
    clips: Sequence[MotionClip] = (),
    changes: Sequence[CameraChange] = (),
    rng: np.random.Generator | None = None,
) -> Scene:
    """Simulate cameras that watch people.

    Parameters
    ----------
    options : SceneOptions, optional
    clips : sequence of MotionClip
        Motion capture to compose the people's motion of; without any it is procedural.
    changes : sequence of CameraChange
        Changes of cameras during the recording; the truth is the state before them.
    rng : Generator, optional
        Source of randomness instead of ``options.seed``.

    Examples
    --------
    >>> import stcalib_ros as st
    >>> scene = st.simulate(st.SceneOptions(n_cameras=2, n_people=2, n_frames=60, seed=1))
    >>> [len(camera.stamps) for camera in scene.recording.cameras]
    [60, 60]
    """
    options = options or SceneOptions()
    rng = np.random.default_rng(options.seed) if rng is None else rng
    rig = make_rig(child_rng(rng), options)
    clocks = _clocks(child_rng(rng), options, len(rig.names))
    own = [[change for change in changes if change.camera == c] for c in range(len(clocks))]
    clocks = [clock.changed(given) for clock, given in zip(clocks, own, strict=True)]
    exposures = [clock.exposures_s for clock in clocks]
    span = (min(e[0] for e in exposures), max(e[-1] for e in exposures))
    people = make_people(
        child_rng(rng), options.people, options.n_people, span, options.area_radius_m, clips
    )
    seed = rng.integers(2**63, size=4)
    seen = [
        observe(np.random.default_rng([*seed, c]), seed, options, rig, c, clock, people, own[c])
        for c, clock in enumerate(clocks)
    ]
    recording = Recording(tuple(s.camera for s in seen), EPOCH_NS)
    return Scene(
        options,
        recording,
        true_calibration(
            rig, clocks, seen, recording.epoch_ns, line_times_s=options.line_times(len(rig.names))
        ),
        rig,
        people,
        tuple(exposures),
        {s.camera.name: s.track_persons for s in seen},
    )


def make_rig(rng: np.random.Generator, options: SceneOptions) -> SceneRig:
    """Return the cameras of a scene: those of the options, or a random ring."""
    if options.rig is not None:
        return staged(options.rig, scale=options.rig_scale)
    return ring_rig(
        rng,
        options.n_cameras,
        image_size=options.image_size,
        focal_px=options.focal_px,
        radius_m=options.ring_radius_m,
        height_m=options.ring_height_m,
        model=LensModel(options.lens_model),
        distortion=options.distortion,
        principal_point_px=options.principal_point_px,
    )


def _clocks(rng: np.random.Generator, options: SceneOptions, n_cameras: int) -> list[Clock]:
    return [
        Clock.random(child_rng(rng), options, fps, is_reference=c == 0)
        for c, fps in enumerate(options.rates(n_cameras))
    ]


def true_calibration(
    rig: SceneRig,
    clocks: Sequence[Clock],
    seen: Sequence[CameraObservation],
    epoch_ns: int,
    *,
    line_times_s: Sequence[float] = (),
) -> Calibration:
    """Return the true calibration in the frame and clock of the first camera, metres."""
    epoch_s = epoch_ns * 1e-9
    n_observations = sum(s.n_keypoints for s in seen)
    squares = sum(s.noise_square_px2 for s in seen)
    return Calibration(
        status=Status.OK,
        message="true values of a simulated scene",
        reference=rig.names[0],
        metric=True,
        epoch_s=epoch_s,
        window_s=(
            epoch_s + min(clock.exposures_s[0] for clock in clocks),
            epoch_s + max(clock.exposures_s[-1] for clock in clocks),
        ),
        cameras=_true_cameras(rig, clocks, line_times_s or (0.0,) * len(rig.names)),
        uncalibrated=(),
        persons=_associations(seen),
        pairs=(),
        reprojection_rms_px=float(np.sqrt(squares / max(1, n_observations))),
        n_observations=n_observations,
        n_inliers=n_observations,
    )


def _true_cameras(
    rig: SceneRig, clocks: Sequence[Clock], lines: Sequence[float]
) -> tuple[CameraCalibration, ...]:
    R_ref_cam = rig.R_cam_world[0] @ rig.R_cam_world.swapaxes(1, 2)
    t_ref_cam = rig.centres_world @ rig.R_cam_world[0].T + rig.t_cam_world[0]
    R_ref_cam[0], t_ref_cam[0] = np.eye(3), 0.0
    return tuple(
        CameraCalibration(
            name=name,
            frame_id=f"{name}_optical_frame",
            intrinsics=rig.intrinsics[c],
            R_ref_cam=R_ref_cam[c],
            t_ref_cam=t_ref_cam[c],
            covariance=np.zeros((6, 6)),
            time_offset_s=clocks[c].offset_s,
            time_offset_stddev_s=0.0,
            clock_skew=clocks[c].skew,
            clock_skew_stddev=0.0,
            line_time_s=line_s,
        )
        for (c, name), line_s in zip(enumerate(rig.names), lines, strict=True)
    )


def _associations(seen: Sequence[CameraObservation]) -> tuple[PersonAssociation, ...]:
    """List tracks by person; one with exchanged ids belongs to all whom it shows for long."""
    tracks: dict[int, dict[str, tuple[int, ...]]] = {}
    for one in seen:
        for track_id, persons in one.track_persons.items():
            frames_of = np.bincount(persons)
            for person in np.flatnonzero(frames_of >= _MIN_OWNED_FRACTION * len(persons)):
                own = tracks.setdefault(int(person), {})
                name = one.camera.name
                own[name] = (*own.get(name, ()), track_id)
    return tuple(PersonAssociation(p, tracks[p], float("nan")) for p in sorted(tracks))
