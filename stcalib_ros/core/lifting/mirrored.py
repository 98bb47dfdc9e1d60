"""A camera as it would be if its image were not mirrored."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.skeleton import Skeleton, mirrored_joints


def unmirrored(camera: LiftedCamera, skeleton: Skeleton) -> LiftedCamera:
    """Return a camera with its image mirrored left to right, and the sides of people exchanged.

    Who looks into a mirror image sees people as likely as any: by itself it cannot be told.

    Parameters
    ----------
    camera : LiftedCamera
    skeleton : Skeleton
    """
    sides = mirrored_joints(skeleton.layout)
    flip = np.array([-1.0, 1.0, 1.0])
    tracks = tuple(
        replace(
            track,
            x=track.x[:, sides] * flip[:2].astype(track.x.dtype),
            focal=track.focal[:, sides],
            joints_cam=track.joints_cam[:, sides] * flip.astype(track.joints_cam.dtype),
            root_cam=track.root_cam * flip.astype(track.root_cam.dtype),
            rows=None if track.rows is None else track.rows[:, sides],
        )
        for track in camera.tracks
    )
    return replace(camera, tracks=tracks)
