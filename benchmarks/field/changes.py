"""Changes of the recording of one camera."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from benchmarks.field.case import Case
from stcalib_ros.core.geometry.so3 import exp_so3
from stcalib_ros.core.model.arrays import BoolArray, Float64Array
from stcalib_ros.core.model.recording import CameraRecording, Intrinsics, Track, only_images

Change = Callable[[CameraRecording], CameraRecording]


def change_tracks(camera: CameraRecording, change: Callable[[Track], Track]) -> CameraRecording:
    """Change every track of a camera."""
    return replace(camera, tracks=tuple(map(change, camera.tracks)))


def change_keypoints(
    camera: CameraRecording, change: Callable[[Float64Array], Float64Array]
) -> CameraRecording:
    """Change all keypoints (F, J, 2) of a camera, px."""
    return change_tracks(camera, lambda t: replace(t, keypoints=change(t.keypoints)))


def change_joints(
    camera: CameraRecording, change: Callable[[Float64Array], Float64Array]
) -> CameraRecording:
    """Change all 3D poses (F, J, 3) of a camera."""
    return change_tracks(camera, lambda t: replace(t, joints=change(t.joints)))


def change_info(camera: CameraRecording, change: Callable[[Intrinsics], None]) -> CameraRecording:
    """Change the lens of a camera: `change` is given a copy to write to."""
    own = camera.intrinsics
    K, D = own.K.copy(), own.D.copy()
    lens = replace(own, K=K, D=D)
    change(lens)
    return replace(camera, intrinsics=lens)


def with_stamps(case: Case, name: str, stamps: Float64Array) -> Case:
    """Give the images of a camera other stamps, strictly increasing."""
    return case.with_camera(replace(case.camera(name), stamps=stamps))


def keep_images(case: Case, name: str, kept: BoolArray, stamps: Float64Array) -> Case:
    """Keep some images (N,) of a camera, with other stamps (K,)."""
    camera = case.camera(name)
    changed = replace(only_images(camera, kept), stamps=stamps)
    return case.with_camera(changed, times_s=case.times_s[name][kept])


def each(case: Case, names: tuple[str, ...], change: Change) -> Case:
    """Change the recordings of some cameras, of all if none is named."""
    for name in names or tuple(camera.name for camera in case.recording.cameras):
        case = case.with_camera(change(case.camera(name)))
    return case


def turned(case: Case, name: str, from_row: int, turn_rad: Float64Array) -> Case:
    """Turn a camera from an image on by a rotation vector in its frame, or by (N, 3) of all.

    What it then has outside of its image is not observed.
    """
    camera = case.camera(name)
    K, size = camera.intrinsics.K, (camera.intrinsics.width, camera.intrinsics.height)
    turn = np.zeros((len(camera.stamps), 3))
    turn[from_row:] = turn_rad if turn_rad.ndim == 1 else turn_rad[from_row:]
    R_new_old = exp_so3(-turn)

    def change(track: Track) -> Track:
        R = R_new_old[track.frames]
        H = K @ R @ np.linalg.inv(K)
        x = np.concatenate([track.keypoints, np.ones((*track.keypoints.shape[:2], 1))], -1)
        x = np.einsum("fab,fjb->fja", H, x)
        joints = np.einsum("fab,fjb->fja", R, track.joints)
        pixels = x[..., :2] / x[..., 2:]
        inside = ((pixels > 0.0) & (pixels < size)).all(-1, keepdims=True)
        return replace(track, keypoints=np.where(inside, pixels, np.nan), joints=joints)

    after = exp_so3(turn[-1])
    moved = tuple(
        replace(c, R_ref_cam=c.R_ref_cam @ after) if c.name == name else c
        for c in case.truths[0].cameras
    )
    if name == case.truths[0].reference:
        # in the frame of the reference camera as it is afterwards, all others have moved
        moved = tuple(
            c
            if c.name == name
            else replace(c, R_ref_cam=after.T @ c.R_ref_cam, t_ref_cam=after.T @ c.t_ref_cam)
            for c in case.truths[0].cameras
        )
    case = case.with_camera(change_tracks(camera, change))
    return replace(case, truths=(*case.truths, replace(case.truths[0], cameras=moved)))
