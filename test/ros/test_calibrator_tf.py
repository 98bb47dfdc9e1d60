"""/tf_static over real DDS, and going back to an earlier calibration."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2: make env")
pytest.importorskip("stcalib_ros.msg", reason="the messages are not built: make env")

from live import Client, LiveNode
from samples import calibration
from stcalib_ros.msg import CalibrationResult
from std_srvs.srv import Trigger

from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.core.synthetic import SceneOptions, simulate
from stcalib_ros.io.bag_writer import write_bag
from stcalib_ros.io.history import History
from stcalib_ros.io.mocap import shipped_clips
from stcalib_ros.io.results import read_result, write_result

PARAMETERS = {"cameras": "[cam0, cam1, cam2]"}


def moved(record: Calibration) -> Calibration:
    cameras = tuple(replace(c, t_ref_cam=c.t_ref_cam + 1.0) for c in record.cameras)
    return replace(record, cameras=cameras)


def heard(setup_file: Path) -> dict[str, list]:
    """What one who comes late hears on /tf_static: parent and translation by child frame."""
    listener = Path(__file__).with_name("tf_listener.py")
    done = subprocess.run(
        ["bash", "-c", f'source "{setup_file}"; exec "$@"', "bash", sys.executable, listener],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def expected(record: Calibration, suffix: str) -> dict[str, list]:
    return {
        camera.frame_id + suffix: ["cam1_optical_frame", *camera.t_ref_cam.tolist()]
        for camera in record.cameras
        if camera.name != record.reference
    }


def test_all_cameras_are_in_one_message_and_a_rollback_replaces_it(setup_file, tmp_path):
    history = History(tmp_path / "results", keep=5)
    for record in (calibration(), moved(calibration())):
        history.add(record)
    given = PARAMETERS | {"results_folder": str(history.folder), "tf_suffix": "_found"}
    live = LiveNode(tmp_path, given, "with_tf", setup_file=setup_file)
    client = Client("with_tf")
    try:
        assert heard(setup_file) == expected(moved(calibration()), "_found")
        said = client.answer(Trigger, "rollback")
        assert (said.success, said.message) == (True, "calibration 1 is in force again")
        assert heard(setup_file) == expected(calibration(), "_found")
        (result,) = client.latched(CalibrationResult, "result", 1)
        assert result.run_id == "saved-000001"
        assert not client.answer(Trigger, "rollback").success
        assert live.stop()[0] == 0
    finally:
        live.kill()
        client.close()


def test_replay_publishes_there_too(setup_file, tmp_path):
    bag, output = tmp_path / "walk.mcap", tmp_path / "walk.yaml"
    scene = SceneOptions(n_cameras=2, n_people=2, n_frames=150, seed=1)
    write_bag(simulate(scene, clips=shipped_clips()).recording, bag)
    live = LiveNode(
        tmp_path,
        {"tf_suffix": "_found"},
        "replay",
        setup_file=setup_file,
        executable="replay",
        arguments=[bag, "--output", output, "--publish"],
    )
    try:
        (frame,) = (frames := heard(setup_file))
        camera = read_result(output).cameras[1]
        assert frame == f"{camera.frame_id}_found"
        assert frames[frame][1:] == pytest.approx(camera.t_ref_cam.tolist(), abs=1e-12)
        assert live.stop()[0] == 0
    finally:
        live.kill()


def test_a_finished_result_is_there_by_one_command(setup_file, tmp_path):
    write_result(calibration(), tmp_path / "walk.yaml")
    live = LiveNode(
        tmp_path,
        {"tf_suffix": "_found"},
        "publish",
        setup_file=setup_file,
        executable="publish",
        arguments=[tmp_path / "walk.yaml"],
    )
    try:
        frames, known = heard(setup_file), expected(calibration(), "_found")
        assert {name: frame[0] for name, frame in frames.items()} == {
            name: frame[0] for name, frame in known.items()
        }
        for name, frame in frames.items():
            assert frame[1:] == pytest.approx(known[name][1:], abs=1e-12)
        assert live.stop()[0] == 0
    finally:
        live.kill()


@pytest.mark.parametrize(
    ("changes", "parameters", "said"),
    [
        ({"metric": False}, {}, "since lengths are not metres"),
        ({}, {"cameras": "[cam0, cam1]"}, "the cameras cam2, which are not configured"),
    ],
)
def test_what_is_not_published_is_said(setup_file, tmp_path, changes, parameters, said):
    History(tmp_path, keep=5).add(replace(calibration(), **changes))
    given = PARAMETERS | {"results_folder": str(tmp_path)} | parameters
    live = LiveNode(tmp_path, given, "quiet", setup_file=setup_file)
    client = Client("quiet")
    try:
        client.next_diagnostics()
        assert said in live.log.read_text()
    finally:
        live.kill()
        client.close()


def test_without_tf2_msgs_everything_else_works(tmp_path):
    if importlib.util.find_spec("tf2_msgs") is not None:
        pytest.skip("tf2_msgs is installed")
    History(tmp_path, keep=5).add(calibration())
    live = LiveNode(tmp_path, PARAMETERS | {"results_folder": str(tmp_path)}, "without_tf")
    client = Client("without_tf")
    try:
        client.latched(CalibrationResult, "result", 1)
        assert live.log.read_text().count("tf2_msgs is not installed") == 1
    finally:
        live.kill()
        client.close()
