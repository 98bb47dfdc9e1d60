"""Keypoints that were lifted by one lens, as another lens has them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from stcalib_ros.core.geometry.lens import change_lens
from stcalib_ros.core.lifting.lift import as_precise
from stcalib_ros.core.model.arrays import Float64Array, FloatArray
from stcalib_ros.core.model.lifted import LiftedCamera, LiftedTrack
from stcalib_ros.core.model.recording import Intrinsics
from stcalib_ros.core.model.rig import Rig


def with_lens(camera: LiftedCamera, lens: Intrinsics) -> LiftedCamera:
    """Return a camera with its keypoints undistorted by another lens.

    People keep their size in the image: they stand nearer by a shorter lens.

    Parameters
    ----------
    camera : LiftedCamera
    lens : Intrinsics
    """
    before = camera.intrinsics
    if before is None or before is lens:
        return camera
    tracks = tuple(_changed(track, before, lens) for track in camera.tracks)
    return replace(camera, tracks=tracks, intrinsics=lens)


def _changed(track: LiftedTrack, before: Intrinsics, after: Intrinsics) -> LiftedTrack:
    x, focal = change_lens(track.x.astype(np.float64), before, after)
    root = _moved(track.root_cam[:, None], track, focal, before, after)[:, 0]
    joints = track.joints_cam + (root - track.root_cam)[:, None]
    values = (as_precise(value, track.x) for value in (x, focal, joints, root))
    x_used, focal_used, joints_used, root_used = values
    return replace(track, x=x_used, focal=focal_used, joints_cam=joints_used, root_cam=root_used)


def _moved(
    points: FloatArray,
    track: LiftedTrack,
    focal: Float64Array,
    before: Intrinsics,
    after: Intrinsics,
) -> Float64Array:
    """Points (F, K, 3) of the optical frame in the same direction of the image, at their size."""
    depth = points[..., 2:].astype(np.float64)
    on_plane, _ = change_lens(points[..., :2] / depth, before, after)
    longer = np.nanmean(focal / track.focal, axis=1)
    depth = depth * longer[:, None, None]
    return np.concatenate([on_plane * depth, depth], -1)


def at_rig(cameras: Sequence[LiftedCamera], rig: Rig) -> tuple[LiftedCamera, ...]:
    """Return all cameras, those of a rig with the lenses that were estimated.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
    rig : Rig
    """
    found = list(cameras)
    for c, lens in zip(rig.cameras.tolist(), rig.lenses or (), strict=bool(rig.lenses)):
        found[c] = with_lens(found[c], lens)
    return tuple(found)
