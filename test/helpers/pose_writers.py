"""The small scene in the files of other programs, each as the program itself writes them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from pose_files import Seen, scene, seen_by

from stcalib_ros.core.model.keypoint_layouts import LAYOUTS

N = 8
"""Images of each camera that are written, if nothing else is said."""

FIRST_S = 47389.9
LATE_S = 0.001
"""By how much the clock of each of Caliscope's cameras is ahead of that of the one before."""
FREEMOCAP_ARRAY = "mediapipe_2dData_numCams_numFrames_numTrackedPoints_pixelXY.npy"


def openpose_person(one: Seen, track: int = -1) -> dict[str, Any]:
    flat = one.points.ravel().tolist()
    return {"person_id": [track], "pose_keypoints_2d": flat, "face_keypoints_2d": []}


def write_openpose_image(path: Path, people: list[dict[str, Any]]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({"version": 1.3, "people": people}))


def openpose(folder: Path, n_images: int, layout: str = "body_25") -> Path:
    """As ``--write_json`` writes: a folder for each camera, a file for each image."""
    for camera in scene().cameras:
        for k, people in enumerate(seen_by(camera, layout, n_images)):
            name = f"walk_{k:012d}_keypoints.json"
            write_openpose_image(
                folder / f"{camera.name}_json" / name, [openpose_person(one) for one in people]
            )
    return folder


def coco_results(c: int, layout: str, n: int = N, **extra: Any) -> list[dict[str, Any]]:
    """As detectors write: only images with people; numbers begin with 0."""
    return [
        {
            "image_id": f"{k}.jpg",
            "category_id": 1,
            "keypoints": one.points.ravel().tolist(),
            "score": 2.5,
            **{key: value(one.track) for key, value in extra.items()},
        }
        for k, people in enumerate(seen_by(scene().cameras[c], layout, n))
        for one in people
    ]


def alphapose(root: Path, n: int = N, *, tracked: bool) -> Path:
    extra = {"box": lambda _: [0, 0, 1, 1]} | ({"idx": lambda i: [i]} if tracked else {})
    for c, camera in enumerate(scene().cameras):
        folder = root / camera.name
        folder.mkdir(parents=True)
        content = json.dumps(coco_results(c, "halpe_26", n, **extra))
        (folder / "alphapose-results.json").write_text(content)
        (folder / "notes.json").write_text("{}")
    return root


def coco_annotations(path: Path, n: int = N) -> Path:
    """Of all cameras in a file; the size of images is known."""
    images, people_in = [], []
    for camera in scene().cameras:
        for k, people in enumerate(seen_by(camera, "coco_17", n)):
            image = {"id": len(images), "file_name": f"{camera.name}/{k:06d}.jpg"}
            images.append(image | {"width": 1920, "height": 1080})
            people_in += [
                {"image_id": image["id"], "track_id": i, "keypoints": points}
                for i, points in (
                    *((one.track, one.points.ravel().tolist()) for one in people),
                    (99, [0] * 51),
                )
            ]
    path.write_text(json.dumps({"info": {}, "images": images, "annotations": people_in}))
    return path


def mmpose_instance(one: Seen) -> dict[str, Any]:
    return {
        "keypoints": one.points[:, :2].tolist(),
        "keypoint_scores": (3 * one.points[:, 2]).tolist(),
        "bbox": [[0, 0, 9, 9]],
        "bbox_score": 0.9,
    }


def mmpose_videos(root: Path, n: int = N, *, described: bool) -> Path:
    """A file for each camera, with a description of the data set, as demos write, or without."""
    root.mkdir()
    for camera in scene().cameras:
        frames: Any = [
            {"frame_id": k, "instances": [mmpose_instance(one) for one in people]}
            for k, people in enumerate(seen_by(camera, "coco_17", n))
        ]
        content = {"meta_info": {"name": "coco"}, "instance_info": frames} if described else frames
        (root / f"results_{camera.name}.json").write_text(json.dumps(content))
    return root


def ultralytics(root: Path, more: str, n: int = N) -> Path:
    """Numbers have six digits, images begin with 1; that without people has no file."""
    for camera in scene().cameras:
        folder = root / camera.name / "labels"
        folder.mkdir(parents=True)
        for k, people in enumerate(seen_by(camera, "coco_17", n)):
            lines = []
            for one in people:
                points = one.points / (1920, 1080, 1)
                numbers = [0, 0.5, 0.5, 0.1, 0.2, *points.ravel()]
                numbers += [{"conf": 0.875, "id": one.track}[word] for word in more.split()]
                lines.append(" ".join(f"{n:g}" for n in numbers))
            if lines and k != 4:
                (folder / f"walk_{k + 1}.txt").write_text("\n".join(lines) + "\n")
    return root


def first_person(c: int, n: int = N) -> list[list[Seen]]:
    images = seen_by(scene().cameras[c], "blazepose_33", n)
    return [[] if k == 2 else [Seen(0, people[0].points)] for k, people in enumerate(images)]


def landmarks(c: int, n: int = N) -> np.ndarray:
    """Arrays (F, 33, 4) of x, y, z and visibility, 0 to 1 across the image."""
    out = np.full((n, 33, 4), np.nan)
    for k, people in enumerate(first_person(c, n)):
        for one in people:
            out[k, :, :2] = one.points[:, :2] / (1920, 1080)
            out[k, :, 2:] = np.c_[np.zeros(33), one.points[:, 2]]
    return out


def mediapipe_arrays(root: Path, n: int = N, **more: Any) -> Path:
    root.mkdir()
    for c in range(3):
        np.savez(root / f"cam{c}.npz", landmarks=landmarks(c, n), **more)
    return root


def pose2sim(root: Path, n: int = N, *, names: list[str], rate: str) -> Path:
    """A trial in a batch, whose calibration is in the folder above; cameras are cam01 and so on."""
    trial = root / "Trial_1"
    lenses = []
    for k, camera in enumerate(scene().cameras):
        folder = trial / "pose" / f"cam{k + 1:02d}_json"
        folder.mkdir(parents=True)
        for f, people in enumerate(seen_by(camera, "halpe_26", n)):
            found = [
                {"person_id": [-1], "pose_keypoints_2d": one.points.ravel().tolist()}
                for one in people
            ]
            content = json.dumps({"version": 1.3, "people": found})
            (folder / f"cam{k + 1:02d}_{f:06d}.json").write_text(content)
        lens = camera.intrinsics
        lenses.append(
            f'[{names[k]}]\nname = "{names[k]}"\nsize = [1920.0, 1080.0]\n'
            f"matrix = {lens.K.tolist()}\ndistortions = [0.0, 0.0, 0.0, 0.0]\n"
            "rotation = [0.0, 0.0, 0.0]\ntranslation = [0.0, 0.0, 0.0]\nfisheye = false\n"
        )
    (root / "calibration").mkdir()
    calibration = "\n".join([*lenses, "[metadata]\nadjusted = false\nerror = 0.0\n"])
    (root / "calibration" / "Calib_board.toml").write_text(calibration)
    (trial / "Config.toml").write_text("[project]\nmulti_person = true\n")
    (root / "Config.toml").write_text(f"[project]\nframe_rate = {rate}\n")
    return trial


def write_video(path: Path, size: tuple[int, int], fps: float) -> None:
    path.parent.mkdir(exist_ok=True)
    video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), fps, size)
    assert video.isOpened()
    for _ in range(3):
        video.write(np.zeros((size[1], size[0], 3), np.uint8))
    video.release()


def caliscope(root: Path, n: int = N, *, old: bool = False) -> Path:
    """Times are those of a counter; nobody is in the last image of any camera."""
    recording = root / "recordings" / "walk"
    tracker = recording / ("HOLISTIC" if old else "RTMPOSE_M_HALPE26")
    tracker.mkdir(parents=True)
    names = (
        "port,frame_index,frame_time,point_id"
        if old
        else "cam_id,frame_index,frame_time,object_id,keypoint_id"
    )
    rows, times, lenses = [], [], []
    for c, camera in enumerate(scene().cameras):
        images = seen_by(camera, "blazepose_33" if old else "halpe_26", n)
        for k, people in enumerate(images):
            stamp = FIRST_S + LATE_S * c + k / 30
            times.append(f"{k},{c},{stamp}")
            for one in (people[:1] if old else people) if k < n - 1 else []:
                for joint in np.flatnonzero(one.points.any(-1)):
                    person = "" if old else f"{one.track},"
                    x, y = one.points[joint, :2]
                    rows.append(f"{k},{c},{k},{stamp},{person}{joint},{x},{y}")
            if old and people:
                rows.append(f"{k},{c},{k},{stamp},105,7.0,7.0")
        lenses.append(
            f"[cameras.{c}]\ncam_id = {c}\nsize = [1920, 1080]\nignore = false\n"
            f"matrix = {camera.intrinsics.K.tolist()}\ndistortions = [0.0, 0.0, 0.0, 0.0, 0.0]\n"
        )
    table = "\n".join([f"sync_index,{names},img_loc_x,img_loc_y", *rows])
    (tracker / f"xy_{tracker.name}.csv").write_text(table + "\n")
    (recording / "timestamps.csv").write_text("\n".join(["sync_index,cam_id,frame_time", *times]))
    (root / "camera_array.toml").write_text("\n".join(lenses))
    board = root / "calibration" / "extrinsic" / "CHARUCO"
    board.mkdir(parents=True)
    (board / "xy_CHARUCO.csv").write_text(
        "sync_index,cam_id,keypoint_id,img_loc_x,img_loc_y\n0,0,0,1,1\n"
    )
    return root


def easymocap_2d(root: Path, n: int = N, *, lenses: bool) -> Path:
    """Cameras are called 1, 2 and 3; a box without keypoints is nobody."""
    for c, camera in enumerate(scene().cameras):
        folder = root / "annots" / f"{c + 1}"
        folder.mkdir(parents=True)
        for k, people in enumerate(seen_by(camera, "body_25", n)):
            annots = [
                {"personID": one.track, "bbox": [0, 0, 9, 9, 1], "keypoints": one.points.tolist()}
                for one in people
            ]
            content = {"filename": f"images/{c + 1}/{k:06d}.jpg", "height": 1080, "width": 1920}
            content |= {"annots": [*annots, {"personID": 99, "bbox": [0, 0, 9, 9, 1]}]}
            (folder / f"{k:06d}.json").write_text(json.dumps(content))
    if lenses:
        storage = cv2.FileStorage(str(root / "intri.yml"), cv2.FILE_STORAGE_WRITE)
        for c, camera in enumerate(scene().cameras):
            storage.write(f"K_{c + 1}", camera.intrinsics.K)
            storage.write(f"dist_{c + 1}", np.zeros((1, 5)))
        storage.release()
    return root


def freemocap(root: Path, n: int = N, *, n_lenses: int = 3) -> Path:
    """Points of a body and of a hand; nobody in the third image."""
    xy = np.full((3, n, 54, 2), np.nan)
    for c, camera in enumerate(scene().cameras):
        for k, people in enumerate(seen_by(camera, "blazepose_33", n)):
            points = people[0].points
            xy[c, k, :33] = np.where(points.any(-1, keepdims=True), points[:, :2], np.nan)
    xy[:, 2] = np.nan
    folder = root / "output_data" / "raw_data"
    folder.mkdir(parents=True)
    np.save(folder / FREEMOCAP_ARRAY, xy)
    lenses = [
        f'[cam_{c}]\nname = "cam_{c}"\nsize = [1920, 1080]\n'
        f"matrix = {camera.intrinsics.K.tolist()}\ndistortions = [0.0, 0.0, 0.0, 0.0, 0.0]\n"
        "rotation = [0.0, 0.0, 0.0]\ntranslation = [0.0, 0.0, 0.0]\n"
        for c, camera in enumerate(scene().cameras[:n_lenses])
    ]
    (root / "walk_camera_calibration.toml").write_text("\n".join([*lenses, "[metadata]\n"]))
    return root


def multi_view_npz(path: Path, n: int = N) -> Path:
    """Arrays of docs/bag.md without a truth, with lenses and the ids of a tracker."""
    cameras = scene().cameras
    rows = [
        (k, c, one.track, one.points)
        for c, camera in enumerate(cameras)
        for k, people in enumerate(seen_by(camera, "coco_17", n))
        for one in people
    ]
    frames, numbers, tracks, points = zip(*rows, strict=True)
    np.savez(
        path,
        camera_names=[camera.name for camera in cameras],
        image_size=[(1920, 1080)] * len(cameras),
        K=[camera.intrinsics.K for camera in cameras],
        dist=np.zeros((len(cameras), 5)),
        fps=30.0,
        frame_number=np.arange(n),
        det_frame=frames,
        det_camera=numbers,
        det_track=tracks,
        det_kp2d=points,
        kp_names=LAYOUTS["coco_17"].joint_names,
    )
    return path
