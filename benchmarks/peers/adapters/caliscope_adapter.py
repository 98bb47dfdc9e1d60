"""Runs in caliscope's environment: ``python caliscope_adapter.py SCENE.npz RESULT.npz``.

Given: true synchronisation and true association. It bootstraps from essential matrices and
adjusts (``CaptureVolume.bootstrap(...).optimize()``).
"""

import sys

import numpy as np
import pandas as pd
from caliscope.api import CameraArray, CameraData, CaptureVolume, ImagePoints


def main(source: str, result: str) -> None:
    """Calibrate a scene."""
    scene = np.load(source)
    keypoints = scene["keypoints"]
    cameras = {
        c: CameraData.from_intrinsics(
            c,
            tuple(int(n) for n in scene["image_size"][c]),
            fx=float(K[0, 0]),
            fy=float(K[1, 1]),
            cx=float(K[0, 2]),
            cy=float(K[1, 2]),
        )
        for c, K in enumerate(scene["K"])
    }
    c, p, f, j = np.nonzero(np.isfinite(keypoints).all(-1))
    points = pd.DataFrame(
        {
            "sync_index": f,
            "cam_id": c,
            "frame_index": f,
            "object_id": p,
            "keypoint_id": j,
            "img_loc_x": keypoints[c, p, f, j, 0],
            "img_loc_y": keypoints[c, p, f, j, 1],
        }
    )
    volume = CaptureVolume.bootstrap(ImagePoints(points), CameraArray(cameras)).optimize()
    found = [volume.camera_array.cameras[k] for k in sorted(cameras)]
    np.savez(
        result,
        R_cam_world=np.stack([camera.rotation for camera in found]),
        t_cam_world=np.stack([np.ravel(camera.translation) for camera in found]),
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
