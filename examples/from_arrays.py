"""Calibrate cameras from arrays of poses, without a bag and without ROS.

    python examples/from_arrays.py

`detections` stands for your own 2D pose estimator and tracker. Monocular 3D poses, if you have
them, are one more array: ``joints`` (M, J, 3).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import stcalib_ros as st


def detections() -> dict[str, dict[str, NDArray[np.float64]]]:
    """Arrays of each camera, here of a simulated one; M poses of J = 17 joints.

    ``stamps`` (N,), ``frames`` (M,), ``track_ids`` (M,), ``keypoints`` (M, J, 2) and ``scores``
    (M, J), as `stcalib_ros.camera_from_arrays` wants them.
    """
    scene = st.simulate(st.SceneOptions(n_cameras=3, n_people=2, n_frames=300))
    arrays = {}
    for camera in scene.recording.cameras:
        tracks = camera.tracks
        arrays[camera.name] = {
            "stamps": camera.stamps,
            "track_ids": np.repeat([t.track_id for t in tracks], [len(t.frames) for t in tracks]),
            "frames": np.concatenate([t.frames for t in tracks]),
            "keypoints": np.concatenate([t.keypoints for t in tracks]),
            "scores": np.concatenate([t.scores for t in tracks]),
        }
    return arrays


def main() -> None:
    """Calibrate the cameras and print their poses and clocks."""
    K = [[1400.0, 0.0, 960.0], [0.0, 1400.0, 540.0], [0.0, 0.0, 1.0]]
    cameras = tuple(
        st.camera_from_arrays(
            name,
            K=K,
            image_size=(1920, 1080),
            layout="h36m_17",
            stamps=poses["stamps"],
            frames=poses["frames"],
            track_ids=poses["track_ids"],
            keypoints=poses["keypoints"],
            scores=poses["scores"],
        )
        for name, poses in detections().items()
    )
    calibration = st.calibrate(st.Recording(cameras))
    print(f"{calibration.status.name}: {calibration.message}")
    for camera in calibration.cameras:
        position = np.array2string(camera.t_ref_cam, precision=3, suppress_small=True)
        print(f"{camera.name}  at {position}, clock offset {1e3 * camera.time_offset_s:+.1f} ms")


if __name__ == "__main__":
    main()
