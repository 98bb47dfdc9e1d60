"""The live node over real DDS: a process that calibrates, and another one that plays and asks."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2: make env")
pytest.importorskip("stcalib_ros.msg", reason="the messages are not built: make env")

from action_msgs.msg import GoalStatus
from builtin_interfaces.msg import Time
from live import Client, LiveNode
from rclpy.action import ActionClient
from samples import poses_message
from stcalib_ros.action import Calibrate
from stcalib_ros.msg import CalibrationResult, CameraExtrinsics, PersonPose3DArray, TimeOffset
from stcalib_ros.srv import Recalibrate, SaveCalibration
from std_msgs.msg import String
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from stcalib_ros.core.model.calibration import Calibration, Status
from stcalib_ros.core.model.recording import Recording
from stcalib_ros.core.pipeline import calibrate
from stcalib_ros.core.synthetic import SceneOptions, simulate
from stcalib_ros.io.bag import read_bag
from stcalib_ros.io.bag_writer import write_bag
from stcalib_ros.io.mocap import shipped_clips
from stcalib_ros.io.results import read_result
from stcalib_ros.ros.parameter_specs import CAMERAS as CAMERAS_SPEC
from stcalib_ros.ros.parameter_specs import all_specs

CAMERAS = ["cam0", "cam1", "cam2", "cam3"]
PARAMETERS = {"cameras": f"[{', '.join(CAMERAS)}]", "queue_depth": "1000"}


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bag") / "walk.mcap"
    options = SceneOptions(n_cameras=4, n_people=2, n_frames=300, seed=1)
    write_bag(simulate(options, clips=shipped_clips()).recording, path)
    return path


@pytest.fixture(scope="module")
def recording(bag: Path) -> Recording:
    return read_bag(bag)


@pytest.fixture(scope="module")
def offline(recording: Recording) -> Calibration:
    return calibrate(recording)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("live")


@pytest.fixture(scope="module")
def client(folder: Path, bag: Path, recording: Recording) -> Iterator[Client]:
    """Client of a node that has received all of the bag and calibrates on request only."""
    given = PARAMETERS | {"auto_calibrate": "false", "results_folder": str(folder / "results")}
    live = LiveNode(folder, given, "asked")
    client = Client("asked")
    try:
        client.play_completely(bag, {c.name: len(c.stamps) for c in recording.cameras})
        yield client
        status, _ = live.stop()
        assert status == 0
        assert "Traceback" not in live.log.read_text()
    finally:
        live.kill()
        client.close()


@pytest.fixture(scope="module")
def answer(client: Client) -> Recalibrate.Response:
    """Answer of a request that waited; meanwhile, others were answered."""
    future = client.ask(Recalibrate, "recalibrate", wait=True)
    client.wait(lambda: client.status("solver").get("state") == "running", "a run")
    refused = client.answer(Trigger, "recalibrate_now")
    also = client.answer(Recalibrate, "recalibrate", wait=True)
    assert not future.done()
    assert not refused.success
    assert not also.accepted
    run_id = client.status("solver")["run_id"]
    assert refused.message == also.result.message == f"not started: run {run_id} is under way"
    assert also.result.status == CalibrationResult.CANCELLED
    return client.result_of(future, "the end of the run")


def test_live_gives_the_numbers_of_the_bag(answer, offline):
    result = answer.result
    assert answer.accepted
    assert answer.run_id == result.run_id != ""
    assert (result.status, result.message) == (int(offline.status), offline.message)
    assert offline.status is Status.OK
    assert [e.camera for e in result.extrinsics] == CAMERAS
    for camera, extrinsics in zip(offline.cameras, result.extrinsics, strict=True):
        p = extrinsics.pose.pose.position
        np.testing.assert_allclose([p.x, p.y, p.z], camera.t_ref_cam, atol=1e-9)
    offsets = [offset.offset_s for offset in result.time_offsets]
    np.testing.assert_allclose(offsets, [c.time_offset_s for c in offline.cameras], atol=1e-9)
    assert (result.n_observations, result.n_inliers) == (offline.n_observations, offline.n_inliers)
    frames = [offset.offset_frames for offset in result.time_offsets]
    np.testing.assert_allclose(frames, np.array(offsets) * 30.0, rtol=0.02)


def test_who_comes_late_gets_everything(client, answer):
    (result,) = client.latched(CalibrationResult, "result", 1)
    assert result.run_id == answer.run_id
    assert [e.pose for e in result.extrinsics] == [e.pose for e in answer.result.extrinsics]
    extrinsics = client.latched(CameraExtrinsics, "extrinsics", 4)
    assert [(e.camera, e.pose) for e in extrinsics] == [
        (e.camera, e.pose) for e in result.extrinsics
    ]
    offsets = client.latched(TimeOffset, "time_offsets", 4)
    assert [(o.camera, o.offset_s, o.header) for o in offsets] == [
        (o.camera, o.offset_s, answer.result.header) for o in result.time_offsets
    ]
    (markers,) = client.latched(MarkerArray, "markers", 1)
    assert [m.text for m in markers.markers if m.ns == "names"] == CAMERAS


def test_it_is_saved_and_in_force(client, answer, folder, offline):
    saved = read_result(folder / "results" / "calibration.000001.yaml")
    np.testing.assert_allclose(
        [c.t_ref_cam for c in saved.cameras], [c.t_ref_cam for c in offline.cameras], atol=1e-9
    )
    client.next_diagnostics()
    assert client.status("solver")["in_force"] == answer.run_id


@pytest.mark.parametrize("path", ["../out.yaml", "/tmp/out.yaml", "a/../../out.yaml", ""])
def test_nothing_is_saved_elsewhere(client, answer, folder, path):
    said = client.answer(SaveCalibration, "save", path=path)
    assert not said.success
    assert "results folder" in said.message
    assert not list(folder.glob("**/out.yaml"))


def test_what_is_saved_is_the_calibration_in_force(client, answer, folder):
    said = client.answer(SaveCalibration, "save", path="mine.yaml", format="stcalib")
    assert said.success, said.message
    saved = (folder / "results" / "mine.yaml").read_text()
    assert saved == (folder / "results" / "calibration.000001.yaml").read_text()
    other = client.answer(SaveCalibration, "save", path="mine.yaml", format="sfm")
    assert (other.success, "kalibr" in other.message) == (False, True)


def test_a_rollback_needs_an_earlier_calibration(client, answer):
    said = client.answer(Trigger, "rollback")
    assert not said.success
    assert "no earlier calibration" in said.message


def test_from_one_that_was_not_saved_the_way_back_is_to_the_last_file(client, answer, folder):
    results, away = folder / "results", folder / "away"
    results.rename(away)
    results.touch()
    try:
        new = client.answer(Recalibrate, "recalibrate", wait=True)
        assert new.result.status == CalibrationResult.OK, new.result.message
        client.wait(lambda: client.status("solver")["in_force"] == new.run_id, "the new one")
        assert "but not saved: cannot make" in client.status("solver")["last_message"]
    finally:
        results.unlink()
        away.rename(results)
    said = client.answer(Trigger, "rollback")
    assert (said.success, said.message) == (True, "calibration 1 is in force again")
    assert sorted(path.name for path in results.glob("calibration.*")) == [
        "calibration.000001.yaml"
    ]
    (result,) = client.latched(CalibrationResult, "result", 1)
    assert result.run_id == "saved-000001"
    assert not client.answer(Trigger, "rollback").success, "there is none before it"


def test_an_unknown_camera_is_refused(client):
    said = client.answer(Recalibrate, "recalibrate", cameras=["cam0", "cam9"])
    assert not said.accepted
    assert said.result.message.endswith("no camera cam9; there are cam0, cam1, cam2, cam3")


def test_a_goal_that_cannot_start_is_rejected(client):
    action = ActionClient(client.node, Calibrate, "/asked/calibrate")
    client.wait(action.server_is_ready, "the action")
    sent = action.send_goal_async(Calibrate.Goal(cameras=["cam0", "cam9"]))
    assert not client.result_of(sent, "the goal's answer").accepted
    action.destroy()


def test_the_action_tells_its_progress_and_is_cancelled(client):
    action = ActionClient(client.node, Calibrate, "/asked/calibrate")
    client.wait(action.server_is_ready, "the action")
    steps = []
    sent = action.send_goal_async(
        Calibrate.Goal(), feedback_callback=lambda m: steps.append(m.feedback)
    )
    goal = client.result_of(sent, "the goal's answer")
    client.wait(lambda: any(s.stage == "matching camera pairs" for s in steps), "feedback")
    client.result_of(goal.cancel_goal_async(), "the answer to the cancelling")
    ended = client.result_of(goal.get_result_async(), "the goal's result")
    assert ended.status == GoalStatus.STATUS_CANCELED
    assert ended.result.result.status == CalibrationResult.CANCELLED
    assert all(0.0 <= s.progress <= 1.0 for s in steps)
    assert all(np.isnan(s.reprojection_rms_px) for s in steps), "there is no adjustment yet"
    action.destroy()


def test_parameters_that_are_fixed_say_so(client):
    specs = (CAMERAS_SPEC, *all_specs(CAMERAS))
    for spec in specs:
        if spec.fixed:
            ((successful, reason),) = client.change(**{spec.name: spec.default})
            assert (successful, "read-only" in reason) == (False, True), spec.name
    (said,) = client.change(reference="cam9")
    assert said == (False, "reference: 'cam9' is none of the cameras cam0, cam1, cam2, cam3")


def test_all_others_change_within_their_range(client):
    free = [spec for spec in all_specs(CAMERAS) if not spec.fixed]
    kept = {spec.name: spec.default for spec in free} | {"auto_calibrate": False}
    assert client.change(**kept) == [(True, "")] * len(free)
    for spec in free:
        if spec.high is not None:
            above = type(spec.default)(spec.high + 1)
            ((successful, reason),) = client.change(**{spec.name: above})
            assert (successful, "range" in reason) == (False, True), spec.name
    for value in ("text", [1.0]):
        ((successful, reason),) = client.change(window_s=value)
        assert (successful, "type" in reason) == (False, True)


def test_malformed_messages_are_counted_and_dropped(client):
    client.next_diagnostics()
    before = client.status("camera cam0")
    good = poses_message()
    unknown, short, unstamped, crowd = (poses_message() for _ in range(4))
    unknown.layout = "no_such_layout"
    short.persons[0].keypoints = good.persons[0].keypoints[:-2]
    unstamped.header.stamp = Time()
    crowd.persons = good.persons * 51
    publisher = client.publisher(PersonPose3DArray, "/cam0/person_poses")
    for message in (unknown, short, unstamped, crowd):
        publisher.publish(message)
    dropped = int(before["dropped"]) + 4
    client.wait(lambda: client.status("camera cam0")["dropped"] == str(dropped), "drops")
    after = client.status("camera cam0")
    assert "51 persons in one image" in after["message"]
    assert {k: after[k] for k in ("images", "flushes")} == {
        k: before[k] for k in ("images", "flushes")
    }


def test_a_restart_has_the_last_one_calibrates_unasked_and_stops_at_once(
    client, answer, folder, bag
):
    given = PARAMETERS | {"results_folder": str(folder / "results"), "min_motion_s": "5.0"}
    live = LiveNode(folder, given, "unasked")
    other = Client("unasked")
    try:
        (result,) = other.latched(CalibrationResult, "result", 1)
        assert result.run_id == "saved-000001"
        assert [e.camera for e in result.extrinsics] == CAMERAS
        other.next_diagnostics()
        assert "camera cam0 waits" not in live.log.read_text()
        other.play(bag)
        other.wait(lambda: other.status("solver").get("last_status") == "OK", "an unasked run")
        steps, action = [], ActionClient(other.node, Calibrate, "/unasked/calibrate")
        other.wait(action.server_is_ready, "the action")
        action.send_goal_async(Calibrate.Goal(), feedback_callback=steps.append)
        other.wait(lambda: len(steps) > 2, "the solver")
        status, seconds = live.stop(signal.SIGINT)
        assert (status, seconds < 5.0) == (0, True)
        assert "Traceback" not in live.log.read_text()
    finally:
        live.kill()
        other.close()


def test_a_starved_node_says_what_it_waits_for(folder):
    given = {"cameras": "[left, right]", "results_folder": str(folder / "none")}
    live = LiveNode(folder, given, "starved")
    client = Client("starved")
    try:
        publisher = client.publisher(PersonPose3DArray, "/left/person_poses")
        client.wait(
            lambda: "by /client_of_starved" in client.status("camera left").get("message", ""),
            "the publisher's name",
        )
        said = client.status("camera left")["message"]
        assert "waits for poses, none has come: /left/person_poses is published by" in said
        assert "(stcalib_ros/msg/PersonPose3DArray, RELIABLE, VOLATILE)" in said
        assert "nobody publishes on /right/camera_info" in client.status("camera right")["message"]
        assert "but nobody publishes" not in said
        client.node.create_publisher(String, "/right/person_poses", 10)
        client.wait(
            lambda: "std_msgs" in client.status("camera right")["message"], "that it is noticed"
        )
        said = client.status("camera right")["message"]
        assert (
            "(std_msgs/msg/String, RELIABLE, VOLATILE), "
            "but nobody publishes a stcalib_ros/msg/PersonPose3DArray" in said
        )
        assert publisher.get_subscription_count() == 1
        refused = client.answer(Trigger, "recalibrate_now")
        assert not refused.success
        assert "two cameras with poses and CameraInfo are needed" in refused.message
        assert not client.answer(SaveCalibration, "save", path="a.yaml").success
        assert live.stop(signal.SIGINT)[0] == 0
    finally:
        live.kill()
        client.close()


def test_unusable_parameters_are_one_line(folder):
    live = LiveNode(folder, {"window_s": "-1.0"}, "refused")
    assert live.process.wait(timeout=60) == 2
    said = live.log.read_text()
    assert "parameter window_s" in said
    assert "Traceback" not in said
