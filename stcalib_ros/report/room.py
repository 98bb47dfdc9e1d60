"""The room that a calibration describes: floor down, people in the middle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.geometry.alignment import umeyama
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.calibration import Calibration, CameraCalibration
from stcalib_ros.core.model.keypoint_layouts import Layout
from stcalib_ros.core.output.gravity import find_upright
from stcalib_ros.core.reconstruction.trajectories import PersonTrajectory

FACE = {
    *(f"{side}_{part}" for side in ("left", "right") for part in ("eye", "ear")),
    *(f"{side}_eye_{part}" for side in ("left", "right") for part in ("inner", "outer")),
    *("nose", "mouth_left", "mouth_right"),
}
"""Joints that a figure does without: the head stands for them."""
_BLOCK_S = 1.0
"""Seconds. Upright directions of people are averaged over blocks of about a stride, as in core."""
_MIN_ALIGNED = 3
"""Cameras. Fewer centres do not determine a similarity transform (Umeyama 1991)."""


@dataclass(frozen=True, slots=True, eq=False)
class PlacedCamera:
    """A camera in the room.

    Attributes
    ----------
    name : str
    R_room_cam : (3, 3) ndarray
    centre : (3,) ndarray
    tangent : (2,) ndarray
        Tangents of half the horizontal and half the vertical field of view.
    """

    name: str
    R_room_cam: Float64Array
    centre: Float64Array
    tangent: Float64Array

    def frustum(self, depth: float) -> Float64Array:
        """Corners (4, 3) of the image at a depth, clockwise from the top left."""
        signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        corners = np.concatenate([signs * self.tangent, np.ones((4, 1))], -1)
        return np.asarray(self.centre + depth * corners @ self.R_room_cam.T)


@dataclass(frozen=True, slots=True, eq=False)
class Person:
    """A person in the room.

    Attributes
    ----------
    person_id : int
    layout : Layout
    joints : (K, J, 3) ndarray
        At uniform times; NaN where unknown.
    """

    person_id: int
    layout: Layout
    joints: Float64Array

    def of(self, names: Sequence[str]) -> Float64Array:
        """Paths (K, N, 3) of those of the named joints that the layout has."""
        own = self.layout.joint_names
        return np.asarray(self.joints[:, [own.index(name) for name in names if name in own]])


@dataclass(frozen=True, slots=True, eq=False)
class Room:
    """Cameras and people with z up and the floor at z = 0.

    Attributes
    ----------
    cameras : tuple of PlacedCamera
    true_cameras : tuple of PlacedCamera
        True cameras after similarity alignment; empty without a truth.
    people : tuple of Person
    R_room_ref, t_room_ref : (3, 3), (3,) ndarray
        From the reference frame of the calibration.
    metric : bool
        Lengths are metres; else distances between the first two cameras.
    """

    cameras: tuple[PlacedCamera, ...]
    true_cameras: tuple[PlacedCamera, ...]
    people: tuple[Person, ...]
    R_room_ref: Float64Array
    t_room_ref: Float64Array
    metric: bool

    def placed(self, points: Float64Array) -> Float64Array:
        """Points (..., 3) of the calibration's frame in the room."""
        return np.asarray(points @ self.R_room_ref.T + self.t_room_ref)


def make_room(
    calibration: Calibration,
    people: Sequence[PersonTrajectory],
    truth: Calibration | None = None,
) -> Room:
    """Rotate a calibration upright.

    By people, as `stcalib_ros.core.output.gravity` does it; where they do not determine the
    vertical, by the cameras.

    Parameters
    ----------
    calibration : Calibration
        With at least one camera.
    people : sequence of PersonTrajectory
        As `reconstruct` gives them.
    truth : Calibration, optional
    """
    centres = np.array([camera.t_ref_cam for camera in calibration.cameras])
    R_up, height = _standing(calibration, people)
    R = _along_walls(R_up, centres)
    turned = [Person(p.person_id, p.layout, p.joints_ref @ R.T) for p in people]
    t = -np.median(np.concatenate([centres @ R.T, *(_known(p.joints) for p in turned)]), axis=0)
    t[2] = height
    return Room(
        cameras=tuple(_placed(c, R, t) for c in calibration.cameras),
        true_cameras=tuple(_placed(c, R, t) for c in _aligned(truth, calibration)),
        people=tuple(replace(p, joints=p.joints + t) for p in turned),
        R_room_ref=R,
        t_room_ref=t,
        metric=calibration.metric,
    )


def _known(joints: Float64Array) -> Float64Array:
    """Those positions (N, 3) that are finite."""
    return np.asarray(joints[np.isfinite(joints).all(-1)])


def _standing(
    calibration: Calibration, people: Sequence[PersonTrajectory]
) -> tuple[Float64Array, float]:
    """Rotation from the frame of the calibration to one with z up, and what to add to z."""
    if calibration.frame_id:
        return np.eye(3), 0.0
    if people:
        step_s = float(np.median(np.concatenate([np.diff(p.times_s) for p in people])))
        paths = [p.joints_ref for p in people]
        upright, _ = find_upright(people[0].layout, paths, block=max(1, round(_BLOCK_S / step_s)))
        if upright is not None:
            return upright.R_world_ref, upright.height
    # Without people: cameras are rarely upside down.
    z = -np.mean([camera.R_ref_cam[:, 1] for camera in calibration.cameras], axis=0)
    z = z / np.linalg.norm(z)
    x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
    x /= np.linalg.norm(x)
    points = [np.array([camera.t_ref_cam for camera in calibration.cameras])]
    points += [_known(p.joints_ref) for p in people]
    return np.stack([x, np.cross(z, x), z]), -float((np.concatenate(points) @ z).min())


def _along_walls(R: Float64Array, centres: Float64Array) -> Float64Array:
    """The same rotation turned about z, with x along the longest extent of the cameras."""
    xy = (centres - centres.mean(0)) @ R[:2].T
    cosine, sine = np.linalg.svd(xy)[2][0]
    return np.asarray(np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]]) @ R)


def _placed(camera: CameraCalibration, R: Float64Array, t: Float64Array) -> PlacedCamera:
    lens = camera.intrinsics
    return PlacedCamera(
        camera.name,
        R @ camera.R_ref_cam,
        R @ camera.t_ref_cam + t,
        np.array([lens.width / lens.K[0, 0], lens.height / lens.K[1, 1]]) / 2.0,
    )


def _aligned(truth: Calibration | None, calibration: Calibration) -> list[CameraCalibration]:
    """True cameras after the similarity that brings their centres nearest to the estimate."""
    ours = {camera.name: camera.t_ref_cam for camera in calibration.cameras}
    common = [camera for camera in truth.cameras if camera.name in ours] if truth else []
    if len(common) < _MIN_ALIGNED:
        return []
    s, R, t = umeyama(
        np.array([camera.t_ref_cam for camera in common]),
        np.array([ours[camera.name] for camera in common]),
    )
    return [
        replace(c, R_ref_cam=R @ c.R_ref_cam, t_ref_cam=s * R @ c.t_ref_cam + t) for c in common
    ]
