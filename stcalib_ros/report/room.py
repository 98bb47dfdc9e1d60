"""The room that a calibration describes: floor down, people in the middle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.geometry import umeyama
from stcalib_ros.core.reconstruction import PersonTrajectory
from stcalib_ros.core.types import Calibration, CameraCalibration, FloatArray

_HEAD = ("head_top", "head", "nose", "left_ear", "right_ear", "neck")
_SHOULDERS = ("left_shoulder", "right_shoulder")
_ANKLES = ("left_ankle", "right_ankle")
_HIPS = ("left_hip", "right_hip", "pelvis")
_FEET = ("ankle", "heel", "toe", "foot")


@dataclass(frozen=True, slots=True, eq=False)
class PlacedCamera:
    """A camera in the room.

    Attributes
    ----------
    name : str
    R_room_cam : (3, 3) ndarray
    centre : (3,) ndarray
    tangent : (2,) ndarray
        Of half the width and half the height of the image.
    """

    name: str
    R_room_cam: FloatArray
    centre: FloatArray
    tangent: FloatArray

    def frustum(self, depth: float) -> FloatArray:
        """Corners (4, 3) of the image at a depth, clockwise from the top left."""
        signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        corners = np.concatenate([signs * self.tangent, np.ones((4, 1))], -1)
        return np.asarray(self.centre + depth * corners @ self.R_room_cam.T)


@dataclass(frozen=True, slots=True, eq=False)
class Person:
    """A person in the room: joints (K, J, 3), and which joints are his feet."""

    trajectory: PersonTrajectory
    joints: FloatArray
    feet: tuple[int, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Room:
    """Cameras and people with z up and the floor at z = 0.

    Attributes
    ----------
    cameras : tuple of PlacedCamera
    true_cameras : tuple of PlacedCamera
        Where they truly are, after similarity alignment; empty where no truth is given.
    people : tuple of Person
    R_room_ref, t_room_ref : (3, 3), (3,) ndarray
        From the reference frame of the calibration.
    metric : bool
        Lengths are metres; else distances between the first two cameras.
    """

    cameras: tuple[PlacedCamera, ...]
    true_cameras: tuple[PlacedCamera, ...]
    people: tuple[Person, ...]
    R_room_ref: FloatArray
    t_room_ref: FloatArray
    metric: bool


def make_room(
    calibration: Calibration,
    people: Sequence[PersonTrajectory],
    truth: Calibration | None = None,
) -> Room:
    """Stand a calibration upright.

    Up is the mean direction from the ankles (else the hips) to the heads of the people, the floor
    is where their feet are lowest.

    Parameters
    ----------
    calibration : Calibration
        With at least one camera.
    people : sequence of PersonTrajectory
        As `reconstruct` gives them.
    truth : Calibration, optional
    """
    R = _upright(calibration, people)
    centres = np.array([camera.t_ref_cam for camera in calibration.cameras])
    joints = [person.joints_ref @ R.T for person in people]
    everything = np.concatenate([j.reshape(-1, 3) for j in joints] or [centres @ R.T])
    t = -np.nanmedian(everything, axis=0)
    t[2] = -_floor(people, joints, centres @ R.T)
    true_cameras: tuple[PlacedCamera, ...] = ()
    if truth is not None:
        true_cameras = tuple(_placed(c, R, t) for c in _aligned(truth, calibration))
    return Room(
        cameras=tuple(_placed(c, R, t) for c in calibration.cameras),
        true_cameras=true_cameras,
        people=tuple(
            Person(person, j + t, feet_of(person)) for person, j in zip(people, joints, strict=True)
        ),
        R_room_ref=R,
        t_room_ref=t,
        metric=calibration.metric,
    )


def feet_of(person: PersonTrajectory) -> tuple[int, ...]:
    """Indices of the joints of the feet."""
    names = person.layout.joint_names
    return tuple(i for i, name in enumerate(names) if any(part in name for part in _FEET))


def _upright(calibration: Calibration, people: Sequence[PersonTrajectory]) -> FloatArray:
    """Rotation from the reference frame to one with z up."""
    ups = [up for up in map(_up, people) if np.isfinite(up).all()]
    if ups:
        z = np.mean(ups, axis=0)
    else:  # nobody to tell: cameras are seldom upside down
        z = -np.mean([camera.R_ref_cam[:, 1] for camera in calibration.cameras], axis=0)
    z = z / np.linalg.norm(z)
    x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z])


def _up(person: PersonTrajectory) -> FloatArray:
    """Mean direction from feet to head; NaN if they were never seen together."""
    top = _middle(person, _HEAD, _SHOULDERS)
    bottom = _middle(person, _ANKLES, _HIPS)
    if top is None or bottom is None:
        return np.full(3, np.nan)
    up = (top - bottom)[np.isfinite(top - bottom).all(-1)]
    up = up / np.linalg.norm(up, axis=-1, keepdims=True)
    return np.asarray(up.mean(0)) if len(up) else np.full(3, np.nan)


def _middle(person: PersonTrajectory, *choices: Sequence[str]) -> FloatArray | None:
    """Middle (K, 3) of the joints of the first choice of which the layout has any."""
    own = person.layout.joint_names
    for names in choices:
        if columns := [own.index(name) for name in names if name in own]:
            return np.asarray(person.joints_ref[:, columns].mean(1))
    return None


def _floor(
    people: Sequence[PersonTrajectory], joints: Sequence[FloatArray], centres: FloatArray
) -> float:
    """Height of the floor: where feet, or whatever is seen, are lowest."""
    feet = [j[:, list(feet_of(p)) or slice(None), 2] for p, j in zip(people, joints, strict=True)]
    heights = np.concatenate([f[np.isfinite(f)] for f in feet] or [centres[:, 2]])
    return float(np.percentile(heights, 5)) if len(heights) else float(centres[:, 2].min())


def _placed(camera: CameraCalibration, R: FloatArray, t: FloatArray) -> PlacedCamera:
    lens = camera.intrinsics
    return PlacedCamera(
        camera.name,
        R @ camera.R_ref_cam,
        R @ camera.t_ref_cam + t,
        np.array([lens.width / lens.K[0, 0], lens.height / lens.K[1, 1]]) / 2.0,
    )


def _aligned(truth: Calibration, calibration: Calibration) -> list[CameraCalibration]:
    """True cameras after the similarity that brings their centres nearest to the estimate."""
    ours = {camera.name: camera.t_ref_cam for camera in calibration.cameras}
    common = [camera for camera in truth.cameras if camera.name in ours]
    if len(common) < 3:
        return []
    s, R, t = umeyama(
        np.array([camera.t_ref_cam for camera in common]),
        np.array([ours[camera.name] for camera in common]),
    )
    return [
        replace(c, R_ref_cam=R @ c.R_ref_cam, t_ref_cam=s * R @ c.t_ref_cam + t) for c in common
    ]
