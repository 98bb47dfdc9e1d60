"""Whether a camera that fits nowhere shows a mirror image of the people whom the others see."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.lifting.lift import as_precise
from stcalib_ros.core.model.arrays import Float64Array, IntArray
from stcalib_ros.core.model.lifted import LiftedCamera, LiftedTrack
from stcalib_ros.core.model.rejection import Rejection, RejectionReason
from stcalib_ros.core.model.skeleton import Skeleton, mirrored_joints
from stcalib_ros.core.options import Options
from stcalib_ros.core.reconstruction.limits import MIN_MIRRORED_FIT
from stcalib_ros.core.reconstruction.resection import resect


def mirrored_view(
    cameras: Sequence[LiftedCamera],
    index: int,
    skeleton: Skeleton,
    last: Iteration,
    options: Options,
) -> Rejection | None:
    """Return the rejection of a camera whose keypoints fit if its image is mirrored.

    Joints are tried as they are named, and with left and right of the body exchanged: estimators
    name the sides of a mirror image as they see them. Exchanged coordinates are a mirror image,
    too.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
        All cameras.
    index : int
        Index of the camera.
    skeleton : Skeleton
    last : Iteration
        Adjustment of the other cameras.
    options : Options
    """
    tried = [*cameras]
    for what, mirror_image in _readings(cameras[index], skeleton):
        tried[index] = mirror_image
        found = resect(tried, index, skeleton, last, options)
        if found is not None and found.explained >= MIN_MIRRORED_FIT:
            return Rejection(
                RejectionReason.MIRRORED_VIEW,
                (cameras[index].name,),
                found.explained,
                MIN_MIRRORED_FIT,
                detail=what,
            )
    return None


def _readings(camera: LiftedCamera, skeleton: Skeleton) -> Iterator[tuple[str, LiftedCamera]]:
    """Yield mirror images of what a camera sees, with what they exchange."""
    sides = mirrored_joints(skeleton.layout)
    own = np.arange(len(sides))
    turned = np.array([-1.0, 1.0])
    yield "left and right of it, and of the body,", _read(camera, sides, turned)
    yield "left and right of it", _read(camera, own, turned)
    if camera.intrinsics is not None:
        cx, cy = camera.intrinsics.K[:2, 2]
        yield "x and y", _read(camera, own, np.ones(2), swapped_px=float(cy - cx))


def _read(
    camera: LiftedCamera, columns: IntArray, signs: Float64Array, *, swapped_px: float | None = None
) -> LiftedCamera:
    """Return a camera with other joints and coordinates, without 3D poses."""
    return replace(
        camera, tracks=tuple(_track(t, columns, signs, swapped_px) for t in camera.tracks)
    )


def _track(
    track: LiftedTrack, columns: IntArray, signs: Float64Array, swapped_px: float | None
) -> LiftedTrack:
    x = track.x[:, columns].astype(np.float64)
    focal = track.focal[:, columns]
    root = track.root_cam.astype(np.float64) * np.append(signs, 1.0)
    if swapped_px is not None:
        shift = swapped_px / focal[..., None]
        x = x[..., ::-1] + shift * np.array([1.0, -1.0])
        root = root[:, [1, 0, 2]]
    return replace(
        track,
        x=as_precise(signs * x, track.x),
        focal=focal,
        joints_cam=np.full_like(track.joints_cam, np.nan),
        root_cam=as_precise(root, track.root_cam),
        rows=None if track.rows is None else track.rows[:, columns],
    )
