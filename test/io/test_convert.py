from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stcalib_ros.cli import main
from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.keypoint_layouts import LAYOUTS
from stcalib_ros.io.bag import read_bag
from stcalib_ros.io.convert import convert_npz
from stcalib_ros.io.convert_options import ConvertOptions
from stcalib_ros.io.results import read_result

JOINTS = LAYOUTS["h36m_17"].joint_names


def source(**changes: Any) -> dict[str, Any]:
    """Two cameras, four frames, three detections a frame; camera b has one row less."""
    rng = np.random.default_rng(0)
    frame, camera, track = (a.ravel() for a in np.meshgrid(range(4), [0, 1], [4, 6], indexing="ij"))
    keep = (frame > 0) | (camera == 0) | (track == 4)
    frame, camera, track = frame[keep], camera[keep], track[keep]
    person = np.where(track == 4, camera, -1)
    kp2d = rng.uniform(1, 400, (len(frame), 17, 3)).astype(np.float32)
    kp2d[0, 2] = 0.0
    return {
        "camera_names": np.array(["a", "b"]),
        "image_size": np.array([[640, 480], [320, 240]]),
        "K": np.tile([[500.0, 0, 320], [0, 510, 240], [0, 0, 1]], (2, 1, 1)),
        "dist": np.zeros((2, 5)),
        "R": Rotation.from_rotvec([[0.1, 0.2, 0.3], [0.5, -0.4, 1.0]]).as_matrix(),
        "t": np.array([[0.1, 0.2, 3.0], [-0.5, 0.3, 4.0]]),
        "fps": np.array(20.0),
        "frame_number": np.array([10, 11, 12, 14]),
        "det_frame": frame,
        "det_camera": camera,
        "det_track": track,
        "det_person": person,
        "det_kp2d": kp2d,
        "kp_names": np.array(JOINTS),
        "det_kp3d": rng.normal(size=(len(frame), 17, 3)).astype(np.float32),
        "kp3d_names": np.array(JOINTS),
    } | changes


def save(path: Path, arrays: dict[str, Any]) -> Path:
    np.savez(path, **{k: v for k, v in arrays.items() if v is not None})
    return path


def test_recording(tmp_path: Path) -> None:
    arrays = source()
    recording, _ = convert_npz(save(tmp_path / "s.npz", arrays), ConvertOptions({"b": -0.25}))
    a, b = recording.cameras
    assert recording.epoch_ns == 1_759_999_999 * 10**9
    np.testing.assert_allclose(a.stamps, 1.0 + np.array([0, 0.05, 0.1, 0.2]))
    np.testing.assert_allclose(b.stamps, 0.75 + np.array([0, 0.05, 0.1, 0.2]))
    assert a.layout is LAYOUTS["h36m_17"]
    assert a.metric
    assert (b.intrinsics.width, b.intrinsics.height) == (320, 240)
    assert [t.track_id for t in b.tracks] == [4, 6]
    assert b.tracks[1].frames.tolist() == [1, 2, 3]
    rows = np.flatnonzero((arrays["det_camera"] == 1) & (arrays["det_track"] == 6))
    np.testing.assert_array_equal(b.tracks[1].joints, arrays["det_kp3d"][rows])
    np.testing.assert_array_equal(b.tracks[1].scores, arrays["det_kp2d"][rows, :, 2])


def test_without_3d_poses_the_keypoints_are_converted_alone(tmp_path: Path) -> None:
    arrays = source()
    whole, _ = convert_npz(save(tmp_path / "s.npz", arrays))
    flat, _ = convert_npz(save(tmp_path / "f.npz", source(det_kp3d=None, kp3d_names=None)))
    for camera, other in zip(whole.cameras, flat.cameras, strict=True):
        assert (camera.has_3d_poses, camera.metric) == (True, True)
        assert (other.has_3d_poses, other.metric) == (False, False)
        for track, without in zip(camera.tracks, other.tracks, strict=True):
            np.testing.assert_array_equal(without.keypoints, track.keypoints)
            assert without.joints.shape == track.joints.shape


def test_unknown_3d_poses_are_nan(tmp_path: Path) -> None:
    joints = source()["det_kp3d"]
    joints[::2] = np.nan
    recording, _ = convert_npz(save(tmp_path / "s.npz", source(det_kp3d=joints)))
    tracks = [track for camera in recording.cameras for track in camera.tracks]
    known = np.concatenate([np.isfinite(t.joints).all((1, 2)) for t in tracks])
    assert (len(known), known.sum()) == (15, 7)


def test_undetected_is_nan(tmp_path: Path) -> None:
    recording, _ = convert_npz(save(tmp_path / "s.npz", source()))
    track = recording.cameras[0].tracks[0]
    assert np.isnan(track.keypoints[0, 2]).all()
    assert track.scores[0, 2] == 0.0
    assert np.isnan(track.keypoints).sum() == 2


def test_truth_maps_cameras_and_clocks_to_the_first_camera(tmp_path: Path) -> None:
    arrays = source()
    shifts = {"a": 0.1, "b": 0.4}
    recording, truth = convert_npz(save(tmp_path / "s.npz", arrays), ConvertOptions(shifts))
    assert truth.reference == "a"
    x_world = np.array([0.3, -0.2, 0.7])
    x_a, x_b = (arrays["R"][c] @ x_world + arrays["t"][c] for c in (0, 1))
    b = truth.cameras[1]
    np.testing.assert_allclose(b.R_ref_cam @ x_b + b.t_ref_cam, x_a)
    t_ref, t_cam = (c.stamps for c in recording.cameras)
    np.testing.assert_allclose(t_cam + b.time_offset_s, t_ref)
    assert b.time_offset_s == -0.3
    assert [(p.person_id, dict(p.tracks)) for p in truth.persons] == [
        (0, {"a": (4,)}),
        (1, {"b": (4,)}),
    ]


def test_command_writes_bag_and_truth(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = save(tmp_path / "s.npz", source())
    bag, truth = tmp_path / "out.mcap", tmp_path / "truth.yaml"
    arguments = [str(path), str(bag), "--truth", str(truth), "--offset", "b=-0.25"]
    assert main(["convert", *arguments, "--fps", "40"]) == 0
    assert "2 cameras, 8 images" in capsys.readouterr().out
    recording = read_bag(bag)
    np.testing.assert_allclose(recording.cameras[1].stamps[1:] - 0.75, [0.025, 0.05, 0.1])
    assert read_result(truth).cameras[1].time_offset_s == 0.25


def test_nothing_of_the_truth_is_needed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Nor lenses or ids: an id for each pose, K of zeros."""
    unknown = dict.fromkeys(("R", "t", "det_person", "K", "dist", "det_track"))
    path, bag = save(tmp_path / "s.npz", source(**unknown)), tmp_path / "out.mcap"
    assert main(["convert", str(path), str(bag)]) == 0
    said = capsys.readouterr().out
    assert "320 x 240 px, lens unknown" in said
    assert said.endswith("--output out.yaml --intrinsics unknown\n")
    for camera in read_bag(bag).cameras:
        assert not camera.intrinsics.known
        assert all(len(track.frames) == 1 for track in camera.tracks)
    assert main(["convert", str(path), str(bag), "--truth", str(tmp_path / "t.yaml")]) == 2
    assert "has no true poses of its cameras; leave it out" in capsys.readouterr().err


def test_names_in_bytes_a_rate_in_a_list_and_ids_of_nobody(tmp_path: Path) -> None:
    changes = {"camera_names": np.array([b"a", b"b"]), "fps": np.array([40.0])}
    tracks = np.where(np.arange(15) % 2, -1, source()["det_track"])
    path = save(tmp_path / "s.npz", source(**changes, det_track=tracks))
    assert main(["convert", str(path), str(tmp_path / "out.mcap")]) == 0
    found = read_bag(tmp_path / "out.mcap").cameras
    assert [camera.name for camera in found] == ["a", "b"]
    new = [t for c in found for t in c.tracks if t.track_id > source()["det_track"].max()]
    assert sorted(len(track.frames) for track in new) == 7 * [1]


def test_nobody_is_no_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    unknown = dict.fromkeys(("R", "t", "det_person", "K", "dist", "det_track"))
    nobody = {name: array[:0] for name, array in source().items() if name.startswith("det_")}
    path = save(tmp_path / "s.npz", source(**(nobody | unknown)))
    assert main(["convert", str(path), str(tmp_path / "out.mcap")]) == 2
    assert "s.npz has nobody in any image: check that the pose estim" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("changes", "arguments", "message"),
    [
        ({"kp_names": None, "det_camera": None}, [], "it lacks kp_names, det_camera"),
        ({"R": None}, [], "not a multi-view file: it has t, but lacks R"),
        ({"K": None, "dist": None}, [], "not a multi-view file: it has R, but lacks K"),
        ({"fps": None}, [], "frame rate is nan; give one of"),
        ({"fps": np.array(np.nan)}, [], "frame rate is nan; give one of"),
        ({}, ["--fps", "0"], "frame rate is 0.0"),
        ({}, ["--fps", "1e-300"], "frame rate is 1e-300"),
        ({}, ["--offset", "b=3e9"], "within 2147483647, got 3000000000.0"),
        ({}, ["--offset", "b=-1.9e9"], "timestamps would be -1.4e+08 to"),
        ({}, ["--offset", "b=1e9"], "timestamps would be 1.76e+09 to 2.76e+09 s"),
        ({"K": np.full((2, 3, 3), np.nan)}, [], "camera a: K is not a pinhole matrix"),
        ({"R": np.tile(7 * np.eye(3), (2, 1, 1))}, [], "R of camera a is no rotation"),
        ({"R": np.tile(-np.eye(3), (2, 1, 1))}, [], "R of camera a is no rotation"),
        ({"t": np.full((2, 3), 1e9)}, [], "t of camera a: expected three numbers within 1e+06"),
        ({"image_size": np.zeros((2, 2), int)}, [], "expected an image of 1 to 100000 px, got 0"),
        ({"dist": np.full((2, 5), np.inf)}, [], "finite coefficients of plumb_bob"),
        ({"det_kp3d": np.full((15, 17, 3), 1e30)}, [], "det_kp3d has numbers beyond 1e+06"),
        ({"det_kp2d": np.full((15, 17, 3), 1e30)}, [], "det_kp2d has numbers beyond 1e+06"),
        ({"det_track": np.full(15, -2)}, [], "det_track must be indices from 0 to 4294967295"),
        (
            {"det_kp2d": np.full((15, 17, 3), 0.5)},
            [],
            "as if keypoints were fractions of it: write",
        ),
        ({"det_track": np.full(15, 2**40)}, [], "det_track must be whole numbers up to"),
        ({"det_frame": np.full(15, np.nan)}, [], "det_frame must be whole numbers up to"),
        ({"K": np.zeros((2, 3, 3), complex)}, [], "K must be numbers, got complex128"),
        ({"camera_names": np.array([1, 2])}, [], "camera_names must be text"),
        ({"camera_names": np.array("a")}, [], "camera_names has shape ()"),
        ({"camera_names": np.array(["a\x1b", "b"])}, [], "printable characters"),
        ({"frame_number": np.zeros(0, int)}, [], "frame_number or kp_names is empty"),
        ({"frame_number": np.array([3, 2, 1, 0])}, [], "frame_number must increase"),
        ({}, ["--offset", "c=1"], "offset of c: no such camera; "),
        ({}, ["--offset", "b=inf"], "offset of b must be a number of seconds"),
        ({}, ["--layout", "mine"], "unknown layout 'mine'"),
        ({}, ["--layout", "coco_19"], "'coco_19' has 19 joints, but the poses of"),
        ({"camera_names": np.array(["a", "a"])}, [], "two cameras have the same name: a"),
        ({"det_track": np.zeros(3)}, [], "det_track has shape (3,), expected (15,)"),
        ({"det_kp3d": np.zeros((15, 16, 3))}, [], "det_kp3d has shape (15, 16, 3), expected"),
        ({"det_camera": np.full(15, 2)}, [], "det_camera must be indices from 0 to 1"),
        ({"kp3d_names": np.array(JOINTS[::-1])}, [], "2D and 3D poses have different joints"),
    ],
)
def test_unusable_source(
    tmp_path: Path,
    changes: dict[str, Any],
    arguments: list[str],
    message: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = save(tmp_path / "s.npz", source(**changes))
    assert main(["convert", str(path), str(tmp_path / "out.mcap"), *arguments]) == 2
    assert message in capsys.readouterr().err
    assert [p.name for p in tmp_path.iterdir()] == ["s.npz"]


@pytest.mark.parametrize("text", ["b", "b=", "=1", "b=x"])
def test_unusable_offset(tmp_path: Path, text: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(["convert", "s.npz", str(tmp_path / "o.mcap"), "--offset", text])
    assert caught.value.code == 2
    assert "expected CAM=SECONDS" in capsys.readouterr().err


def test_no_archive(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        convert_npz(tmp_path / "s.npz")
    (tmp_path / "s.npz").write_text("no archive")
    with pytest.raises(InputError, match=r"not a readable \.npz file"):
        convert_npz(tmp_path / "s.npz")
    np.save(tmp_path / "s.npy", np.zeros(3))
    with pytest.raises(InputError, match="single array"):
        convert_npz(tmp_path / "s.npy")


def test_other_joints_come_in_by_name(tmp_path: Path) -> None:
    names = np.array([f"j{i}" for i in range(17)])
    path = save(tmp_path / "s.npz", source(kp_names=names, kp3d_names=names))
    recording, _ = convert_npz(path)
    assert recording.cameras[0].layout.joint_names == tuple(names)
