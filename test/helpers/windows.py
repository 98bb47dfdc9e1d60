"""What the buffers hold after the images of a recording have arrived, without ROS."""

from __future__ import annotations

import numpy as np

from stcalib_ros.core.model.recording import CameraRecording
from stcalib_ros.io.assemble import CameraImages
from stcalib_ros.io.messages import NS, CameraInfoFields, PoseImage


def images_of(camera: CameraRecording, epoch_ns: int) -> CameraImages:
    """The messages that a recording was made of."""
    rows: list[list[tuple[int, np.ndarray, np.ndarray, np.ndarray]]] = [[] for _ in camera.stamps]
    for track in camera.tracks:
        for k, frame in enumerate(track.frames):
            row = (track.track_id, track.keypoints[k], track.joints[k], track.scores[k])
            rows[frame].append(row)
    J = camera.layout.n_joints
    images = [
        PoseImage(
            stamp_ns=epoch_ns + round(stamp * NS),
            frame_id=camera.frame_id,
            layout=camera.layout,
            rectified=False,
            metric=camera.metric,
            track_ids=np.array([r[0] for r in row], dtype=np.int64),
            scores=np.ones(len(row)),
            keypoints=np.array([r[1] for r in row]).reshape(-1, J, 2),
            joints=np.array([r[2] for r in row]).reshape(-1, J, 3),
            joint_scores=np.array([r[3] for r in row]).reshape(-1, J),
        )
        for stamp, row in zip(camera.stamps, rows, strict=True)
    ]
    lens = camera.intrinsics
    info = CameraInfoFields(
        lens.width,
        lens.height,
        "plumb_bob",
        (0.0,) * 5,
        tuple(lens.K.ravel().tolist()),
        (0.0,) * 9,
        (0.0,) * 12,
        0,
        0,
        (0, 0, 0, 0),
    )
    return CameraImages(camera.name, images, info, "poses", "info")
