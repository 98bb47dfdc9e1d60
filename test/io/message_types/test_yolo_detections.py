"""Detections of yolo_ros: sparse keypoints numbered from 1, ids that are text or missing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from bag_helpers import (
    CAMERA_INFO,
    START_NS,
    header,
    info,
    schema_text,
    small_recording,
    write_bag,
    write_raw,
)
from foreign_messages import assert_read, detection, untracked_yolo, write_foreign, yolo

from stcalib_ros.cli import main
from stcalib_ros.core.errors import InputError
from stcalib_ros.core.evaluation.metrics import evaluate
from stcalib_ros.core.lifting.track_checks import with_tracks
from stcalib_ros.core.model.keypoint_layouts import LAYOUTS
from stcalib_ros.core.synthetic import SceneOptions, simulate
from stcalib_ros.io.bag import read_bag
from stcalib_ros.io.mocap import shipped_clips
from stcalib_ros.io.results import read_result

KIND = "yolo_msgs/msg/DetectionArray"
TOPICS = {"topic": "/{}/yolo/tracking", "info_topic": "/{}/color/camera_info"}
COCO = LAYOUTS["coco_17"]


def one_image(tmp_path: Path, detections: list[dict], *, kind: str = KIND, **changes) -> Path:
    message = {"header": header(START_NS), "detections": detections} | changes
    lens = ("/cam0/camera_info", CAMERA_INFO, info(), START_NS)
    return write_bag(tmp_path / "a.mcap", [lens, ("/cam0/tracking", kind, message, START_NS)])


@pytest.mark.parametrize("kind", [KIND, "yolov8_msgs/msg/DetectionArray"])
def test_what_is_published_is_read(tmp_path, kind):
    given = small_recording()
    bag = write_foreign(tmp_path / "a.mcap", given, kind=kind, make=yolo, **TOPICS)
    found = assert_read(bag, given, joint_names=COCO.joint_names, has_3d_poses=False)
    for camera in found.cameras:
        assert camera.layout is COCO
        for track in camera.tracks:
            seen = np.isfinite(track.keypoints).all(-1)
            np.testing.assert_array_equal(track.scores, np.where(seen, 0.5, 0.0))


def test_ids_that_are_no_numbers_and_none_at_all(tmp_path):
    points = {"left_hip": np.array([10.0, 20.0])}
    given = [detection(text, points) for text in ("7", "", "person-b", "", "99999999999")]
    tracks = read_bag(one_image(tmp_path, given)).cameras[0].tracks
    ids = {t.track_id for t in tracks}
    assert len(ids) == 5
    assert ids >= {7, 0, 1}
    assert max(ids) < 2**32


@pytest.mark.parametrize("number", [0, 18])
def test_keypoints_of_something_else_are_refused(tmp_path, number):
    odd = detection("1", {"left_hip": np.array([10.0, 20.0])})
    odd["keypoints"]["data"][0]["id"] = number
    with pytest.raises(InputError, match=rf"keypoint {number}: a model of people has 1 to 17"):
        read_bag(one_image(tmp_path, [odd]))


def test_another_definition_is_refused(tmp_path):
    lens = ("/a/camera_info", CAMERA_INFO, schema_text(CAMERA_INFO), None)
    text = schema_text(KIND).replace("int32 class_id\n", "")
    bag = write_raw(tmp_path / "a.mcap", [lens, ("/a/tracking", KIND, text, None)])
    with pytest.raises(InputError, match=r"definition of yolo_msgs/.*: \+ int32 class_id; record"):
        read_bag(bag)


def test_people_whom_nobody_tracks_are_linked_and_calibrated(tmp_path, capsys):
    options = SceneOptions(n_cameras=3, n_people=2, n_frames=150, max_offset_frames=5, seed=2)
    scene = simulate(options, clips=shipped_clips())
    bag = write_foreign(
        tmp_path / "a.mcap", scene.recording, kind=KIND, make=untracked_yolo, **TOPICS
    )
    cameras = read_bag(bag).cameras
    assert all(len(t.frames) == 1 for camera in cameras for t in camera.tracks)
    assert all(len(with_tracks(camera).camera.tracks) < 10 for camera in cameras)
    output = tmp_path / "a.yaml"
    assert main(["calibrate", str(bag), "-o", str(output)]) == 0, capsys.readouterr().err
    errors = evaluate(read_result(output), scene.truth)
    assert errors.E_R < 0.02
