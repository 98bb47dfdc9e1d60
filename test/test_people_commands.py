"""``stcalib people``, ``calibrate --people`` and ``clocks``: files, messages, exit status."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from core_helpers import SMALL, changed, clock_shifted
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from stcalib_ros.cli import main
from stcalib_ros.core.model.calibration import Status
from stcalib_ros.core.synthetic import Scene, simulate
from stcalib_ros.io.bag_writer import write_bag
from stcalib_ros.io.results import write_result


@pytest.fixture(scope="module")
def scene() -> Scene:
    return simulate(replace(SMALL, n_frames=120, flip_rate=0.0))


@pytest.fixture
def walk(scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    write_bag(scene.recording, tmp_path / "walk.mcap")
    write_result(scene.truth, tmp_path / "walk.yaml")
    return tmp_path


def read_trc(path: Path) -> tuple[list[str], list[str], np.ndarray, np.ndarray]:
    """Header values, markers, times and markers (K, M, 3), as readers of the format take them."""
    lines = path.read_text().splitlines()
    assert lines[0].split("\t") == ["PathFileType", "4", "(X/Y/Z)", path.name]
    values = dict(zip(lines[1].split("\t"), lines[2].split("\t"), strict=True))
    markers = lines[3].split("\t")[2::3]
    assert lines[3].startswith("Frame#\tTime\t")
    assert lines[4].split("\t")[2:5] == ["X1", "Y1", "Z1"]
    rows = [line.split("\t") for line in lines[5:]]
    assert {len(row) for row in rows} == {2 + 3 * len(markers)}
    numbers = np.array([[float(cell or "nan") for cell in row] for row in rows])
    assert len(numbers) == int(values["NumFrames"])
    assert len(markers) == int(values["NumMarkers"])
    assert np.array_equal(np.diff(numbers[:, 0]), np.ones(len(numbers) - 1))
    assert int(values["OrigDataStartFrame"]) == numbers[0, 0]
    return (
        [values["DataRate"], values["Units"]],
        markers,
        numbers[:, 1],
        numbers[:, 2:].reshape(len(numbers), -1, 3),
    )


def limb_m(markers: list[str], joints: np.ndarray) -> float:
    knee, ankle = (joints[:, markers.index(f"left_{name}")] for name in ("knee", "ankle"))
    return float(np.nanmedian(np.linalg.norm(knee - ankle, axis=-1)))


def test_people_for_opensim(walk: Path, scene: Scene, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["people", "walk.yaml", "walk.mcap", "--output", "people.trc"]) == 0
    out = capsys.readouterr().out
    assert "People are in people_P0.trc, people_P1.trc" in out
    assert "Keypoints that agree with the others: cam0 " in out
    assert "y is up only if cam0 is level" in out
    assert "size of an adult" not in out
    for path in (walk / "people_P0.trc", walk / "people_P1.trc"):
        (rate, unit), markers, times, joints = read_trc(path)
        assert (float(rate), unit) == (pytest.approx(30.0, rel=0.01), "m")
        assert markers == list(scene.recording.cameras[0].layout.joint_names)
        assert np.diff(times) == pytest.approx(1 / 30, rel=0.01)
        height = joints[:, markers.index("head"), 1] - joints[:, markers.index("left_ankle"), 1]
        assert np.nanmedian(height) > 1.0  # y is up


def test_a_vertical_and_a_unit_that_are_known_are_kept(
    walk: Path, scene: Scene, capsys: pytest.CaptureFixture[str]
) -> None:
    optical_in_world = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    cameras = tuple(
        replace(
            camera,
            R_ref_cam=optical_in_world @ camera.R_ref_cam,
            t_ref_cam=optical_in_world @ camera.t_ref_cam / 3.0,
        )
        for camera in scene.truth.cameras
    )
    upright = replace(scene.truth, cameras=cameras, metric=False, frame_id="map")
    write_result(upright, walk / "upright.yaml")
    assert main(["people", "walk.yaml", "walk.mcap", "--output", "optical.trc"]) == 0
    capsys.readouterr()
    assert main(["people", "upright.yaml", "walk.mcap", "--output", "upright.trc"]) == 0
    out = capsys.readouterr().out
    assert "is level" not in out
    assert "metres are estimated from the size of people" in out
    _, markers, _, optical = read_trc(walk / "optical_P0.trc")
    _, _, _, world = read_trc(walk / "upright_P0.trc")
    scale = limb_m(markers, optical) / limb_m(markers, world)
    assert scale == pytest.approx(1.0, rel=0.15)
    turned = scale * world * [-1.0, 1.0, -1.0]  # x of the world, ahead, is z of the file
    assert np.nanmedian(np.linalg.norm(turned - optical, axis=-1)) < 0.02


def test_arrays_are_in_the_frame_of_the_result(walk: Path, scene: Scene) -> None:
    assert main(["people", "walk.yaml", "walk.mcap", "--output", "people.npz"]) == 0
    with np.load(walk / "people.npz") as arrays:
        joints, stddev, time_s = arrays["joints"], arrays["stddev"], arrays["time_s"]
        assert joints.shape == (2, len(time_s), 17, 3)
        assert stddev.shape == joints.shape[:3]
        assert int(arrays["epoch_ns"]) == scene.recording.epoch_ns
        assert str(arrays["frame_id"]) == "cam0_optical_frame"
        assert bool(arrays["metric"])
    true = scene.joints_ref(time_s)
    for person in joints:
        off = np.linalg.norm(person - true, axis=-1)
        assert min(np.nanmedian(one) for one in off) < 0.02


def test_messages_are_the_arrays(walk: Path) -> None:
    """Read by a decoder that is not ours."""
    for name in ("people.npz", "people.mcap"):
        assert main(["people", "walk.yaml", "walk.mcap", "--output", name]) == 0
    found = np.load(walk / "people.npz")
    with (walk / "people.mcap").open("rb") as stream:
        read = list(
            make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages()
        )
    schema, _, _, names = read[0]
    assert (schema.name, names.data.split()) == ("std_msgs/msg/String", [*found["joint_names"]])
    assert {schema.name for schema, *_ in read[1:]} == {"geometry_msgs/msg/PoseArray"}
    for person, joints in zip(found["person_id"], found["joints"], strict=True):
        sent = [message for _, c, _, message in read if c.topic == f"/people/P{person}"]
        assert {message.header.frame_id for message in sent} == {str(found["frame_id"])}
        stamps = np.array([m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in sent])
        rows = np.searchsorted(found["time_s"], (stamps - found["epoch_ns"]) * 1e-9 - 1e-4)
        points = [[[p.position.x, p.position.y, p.position.z] for p in m.poses] for m in sent]
        np.testing.assert_array_equal(points, joints[rows])


def test_unsynchronised_cameras_give_motion_capture_in_one_command(
    walk: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["walk.mcap", "--output", "found.yaml", "--people", "found.trc"]
    assert main(["calibrate", *words, "--offset-range", "0.5"]) == 0
    assert "found_P0.trc" in capsys.readouterr().out
    assert main(["people", "walk.yaml", "walk.mcap", "--output", "true.trc"]) == 0
    for i in range(2):
        _, markers, _, found = read_trc(walk / f"found_P{i}.trc")
        _, _, _, true = read_trc(walk / f"true_P{i}.trc")
        assert limb_m(markers, found) == pytest.approx(limb_m(markers, true), rel=0.05)


def refused(words: Sequence[str], capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    capsys.readouterr()
    status = main(list(words))
    return status, capsys.readouterr().err


def test_a_bag_that_does_not_fit_the_calibration_is_refused(
    walk: Path, scene: Scene, capsys: pytest.CaptureFixture[str]
) -> None:
    late = changed(scene.recording, "cam1", clock_shifted(0.7))
    late = changed(late, "cam2", clock_shifted(1.9))
    write_bag(late, walk / "late.mcap")
    words = ["people", "walk.yaml", "late.mcap", "--output", "people.trc"]
    status, said = refused(words, capsys)
    assert status == 3
    assert "does not agree with walk.yaml" in said
    assert not list(walk.glob("people*"))


def test_a_result_that_was_refused_is_not_used(
    walk: Path, scene: Scene, capsys: pytest.CaptureFixture[str]
) -> None:
    bad = replace(scene.truth, status=Status.DEGENERATE, message="no parallax")
    write_result(bad, walk / "bad.yaml")
    for words in (["people", "bad.yaml", "walk.mcap", "-o", "p.npz"], ["clocks", "bad.yaml", "w"]):
        status, said = refused(words, capsys)
        assert status == 3
        assert "bad.yaml is not to be used (DEGENERATE): no parallax" in said


@pytest.mark.parametrize("command", [["people", "walk.yaml"], ["calibrate"]])
def test_another_ending_is_refused_before_anything_is_read(
    command: list[str], walk: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    option = ["--output"] if command[0] == "people" else ["--output", "o.yaml", "--people"]
    status, said = refused([*command, "nothing.mcap", *option, "walk.c3d"], capsys)
    assert status == 2
    assert "walk.c3d: people are written as .trc or .npz" in said


def test_videos_are_cut_by_one_command_each(
    walk: Path, scene: Scene, capsys: pytest.CaptureFixture[str]
) -> None:
    videos = ["cam1=my right.mov", "cam0=left.mp4"]
    assert main(["clocks", "walk.yaml", "walk.mcap", "--videos", *videos]) == 0
    lines = capsys.readouterr().out.splitlines()
    commands = [shlex.split(line) for line in lines if line.startswith("ffmpeg")]
    assert [words[2] for words in commands] == ["left.mp4", "my right.mov", "cam2.mp4"]
    assert commands[1][-1] == "my right_sync.mov"
    firsts = [int(words[4].partition("=")[2].partition("=")[2].split(":")[0]) for words in commands]
    begin_s = {
        camera.name: camera.stamps[first] + truth.time_offset_s
        for camera, truth, first in zip(
            scene.recording.cameras, scene.truth.cameras, firsts, strict=True
        )
    }
    assert max(begin_s.values()) - min(begin_s.values()) < 1.01 / 30
    assert min(firsts) == 0


def test_a_video_of_no_camera_is_refused(walk: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["clocks", "walk.yaml", "walk.mcap", "--videos", "cam7=a.mp4"]
    status, said = refused(words, capsys)
    assert (status, "no such camera in walk.yaml; there are cam0, cam1, cam2" in said) == (2, True)
