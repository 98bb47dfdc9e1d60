"""The pose estimator over real DDS: images in from one process, poses out of another."""

from __future__ import annotations

import re
import time
from pathlib import Path

import numpy as np
import pytest
import yaml

pytest.importorskip("rclpy", reason="needs ROS 2: make env")
pytest.importorskip("stcalib_ros.msg", reason="the messages are not built: make env")

import cv2
from live import LATCHED, RELIABLE, Client, LiveNode
from painted_poses import HEIGHT, LAYOUT, WIDTH, painted
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from stcalib_ros.msg import PersonPose3DArray
from std_msgs.msg import Header

import stcalib_ros as st
from stcalib_ros.core.errors import InputError
from stcalib_ros.ros.convert import time_message
from stcalib_ros.ros.parameter_specs import CAMERAS
from stcalib_ros.ros.pose_estimator_parameters import estimator_settings, estimator_specs

ROOT = Path(__file__).parents[2]
T0_S = 1_760_000_000.0
PARAMETERS = {"estimator": "painted_poses:PaintedPoses"}
NAMES = ("cam0", "cam1")


@pytest.fixture(autouse=True)
def stand_in(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "test/helpers")
    monkeypatch.setenv("PYTHONPATH", str(ROOT / "test/helpers"), prepend=":")


class Cameras(Client):
    """Sends images, and listens to poses."""

    def __init__(self) -> None:
        super().__init__("pose_estimator")
        self.received: dict[str, list[PersonPose3DArray]] = {name: [] for name in NAMES}
        for name, messages in self.received.items():
            topic = f"/{name}/person_poses"
            self.node.create_subscription(PersonPose3DArray, topic, messages.append, RELIABLE)

    def send(self, name: str, stamp_s: float, pixels: np.ndarray, encoding: str = "bgr8") -> Header:
        header = Header(stamp=time_message(stamp_s), frame_id=f"{name}_optical")
        message = Image(header=header, height=len(pixels), width=pixels.shape[1])
        message.encoding, message.step = encoding, pixels.nbytes // len(pixels)
        message.data = pixels.tobytes()
        self.publisher(Image, f"/{name}/image_raw").publish(message)
        return header

    def counts(self, name: str) -> dict[str, str]:
        return self.status(f"camera {name}")


def run(folder: Path, **parameters: str) -> LiveNode:
    given = {"cameras": "[cam0, cam1]", **PARAMETERS, **parameters}
    return LiveNode(folder, given, "pose_estimator", executable="pose_estimator")


@pytest.fixture
def cameras():
    client = Cameras()
    yield client
    client.close()


def standing(x: float) -> np.ndarray:
    return np.random.default_rng(3).uniform(0, 100, (17, 2)) + np.array([x, 0.0])


def test_poses_come_with_the_header_of_their_image_and_ids_that_last(tmp_path, cameras):
    node = run(tmp_path, rate_hz="0.0")
    try:
        sent = []
        for k in range(5):
            people = [standing(10.0 * k), standing(500.0)][:: 1 if k % 2 else -1]
            sent.append(cameras.send("cam0", T0_S + k / 10, painted(people)))
            cameras.wait(lambda: len(cameras.received["cam0"]) == len(sent), "poses")
        cameras.send("cam1", T0_S, painted([]))
        cameras.wait(lambda: len(cameras.received["cam1"]) == 1, "poses of an empty image")
        status, took_s = node.stop()
    finally:
        node.kill()
    got = cameras.received["cam0"]
    assert [message.header for message in got] == sent
    assert {(m.layout, m.metric, m.rectified) for m in got} == {("h36m_17", False, False)}
    walker = [next(p.track_id for p in m.persons if min(p.keypoints[::2]) < 400) for m in got]
    assert len(set(walker)) == 1
    np.testing.assert_array_equal(
        np.reshape(got[1].persons[0].keypoints, (17, 2)), np.float32(standing(10.0))
    )
    assert [len(p.joints) for p in got[0].persons] == [0, 0]
    assert list(cameras.received["cam1"][0].persons) == []
    assert (status, took_s < 5.0) == (0, True), node.log.read_text()


def test_images_are_dropped_rather_than_late_and_counted(tmp_path, cameras):
    node = run(tmp_path, estimator="painted_poses:slow", rate_hz="20.0", workers="1")
    try:
        for k in range(60):
            for name in NAMES:
                cameras.send(name, T0_S + k / 30, painted([standing(0.0)]))
            time.sleep(1 / 30)
        cameras.wait(lambda: all(int(cameras.counts(n).get("received", 0)) > 50 for n in NAMES), "")
        quiet = time.monotonic() + 1.0
        cameras.wait(lambda: time.monotonic() > quiet, "the last images")
        cameras.next_diagnostics()
        cameras.next_diagnostics()
        said = node.log.read_text()
        counts = {
            n: {k: int(v) for k, v in cameras.counts(n).items() if v.isdigit()} for n in NAMES
        }
    finally:
        node.kill()
    for name, count in counts.items():
        assert count["received"] == count["not_needed"] + count["dropped"] + count["estimated"]
        assert count["not_needed"] >= 15
        assert count["dropped"] >= 10
        assert count["estimated"] == len(cameras.received[name])
    assert abs(counts["cam0"]["estimated"] - counts["cam1"]["estimated"]) <= 2
    assert re.search(
        r"images dropped for newer ones: .*lower rate_hz or size, or raise workers", said
    )


def test_other_types_and_what_cannot_be_read(tmp_path, cameras):
    node = run(tmp_path, rate_hz="0.0", **{"camera.cam1.image_topic": "/cam1/compressed"})
    try:
        header = Header(stamp=time_message(T0_S), frame_id="cam1")
        png = cv2.imencode(".png", painted([standing(7.0)]))[1].tobytes()
        image = CompressedImage(header=header, format="bgr8; png compressed bgr8", data=png)
        cameras.publisher(CompressedImage, "/cam1/compressed").publish(image)
        cameras.wait(lambda: len(cameras.received["cam1"]) == 1, "poses of a PNG")
        for k in range(3):
            cameras.send("cam0", T0_S + k, np.zeros((HEIGHT, WIDTH), np.uint16), "16UC1")
            cameras.next_diagnostics()
        cameras.wait(lambda: cameras.counts("cam0").get("unreadable") == "3", "unreadable images")
        cameras.send("cam0", T0_S + 9, painted([standing(7.0)])[..., ::-1].copy(), "rgb8")
        cameras.wait(lambda: len(cameras.received["cam0"]) == 1, "poses after it")
    finally:
        node.kill()
    for name in NAMES:
        (person,) = cameras.received[name][0].persons
        np.testing.assert_array_equal(
            np.reshape(person.keypoints, (17, 2)), np.float32(standing(7.0))
        )
    assert node.log.read_text().count("encoding '16UC1' is not read: have the driver") == 1


def test_from_images_to_a_calibration(tmp_path, cameras):
    """The estimator and the calibrator, as the launch file starts them."""
    scene = st.simulate(
        st.SceneOptions(
            n_cameras=2, n_people=2, n_frames=200, fps=20.0, id_switches_per_10s=0.0, seed=3
        )
    )
    given = {
        "cameras": "[cam0, cam1]",
        "min_motion_s": "5.0",
        "results_folder": str(tmp_path / "results"),
    }
    estimator, calibrator = run(tmp_path, rate_hz="0.0"), LiveNode(tmp_path, given, "calibrator")
    try:
        first = {c.name: c for c in scene.recording.cameras}
        for name, camera in first.items():
            lens = camera.intrinsics
            info = CameraInfo(header=Header(frame_id=name), height=lens.height, width=lens.width)
            info.k, info.d = lens.K.ravel(), [0.0] * 5
            info.distortion_model = "plumb_bob"
            cameras.publisher(CameraInfo, f"/{name}/camera_info").publish(info)
        for frame in range(200):
            for name, camera in first.items():
                rows = [(t, np.flatnonzero(t.frames == frame)) for t in camera.tracks]
                poses = [t.keypoints[row[0]] for t, row in rows if len(row)]
                cameras.send(name, T0_S + camera.stamps[frame], painted(poses))
            cameras.executor.spin_once(timeout_sec=0.0)
            time.sleep(0.01)
        results = []
        cameras.node.create_subscription(
            st.msg.CalibrationResult, "/calibrator/result", results.append, LATCHED
        )
        cameras.wait(lambda: results, "a result")
    finally:
        estimator.kill()
        calibrator.kill()
    assert results[0].status == 0, results[0].message
    offsets = {o.camera: o.offset_s for o in results[0].time_offsets}
    assert offsets["cam1"] == pytest.approx(float(scene.offsets_s[1]), abs=0.5 / 20.0)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"estimator": "movnet"}, "no estimator of the name 'movnet': there are movenet"),
        ({"estimatr": "movenet"}, "unknown parameter estimatr: did you mean estimator"),
    ],
)
def test_what_cannot_be_used_ends_it_with_a_line(tmp_path, given, said):
    node = run(tmp_path, **given)
    try:
        assert node.process.wait(timeout=30) == 2
    finally:
        node.kill()
    text = node.log.read_text()
    assert said in text
    assert "Traceback" not in text


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        (
            "camera.cam1.image_topic",
            "/cam0/image_raw",
            "image_topic: /cam0/image_raw is given twice",
        ),
        ("camera.cam1.pose_topic", "/cam0/person_poses", "pose_topic: .* is given twice"),
        ("camera.cam0.image_type", "std_msgs/msg/String", "expected sensor_msgs/msg/Image or"),
        ("camera.cam0.image_topic", "my images", "'my images' is not the name of a topic"),
    ],
)
def test_values_that_cannot_be_used_are_named(name, value, said):
    values = {spec.name: spec.default for spec in estimator_specs(NAMES)}
    with pytest.raises(InputError, match=said):
        estimator_settings(NAMES, values | {name: value})


def test_the_file_in_config_has_every_parameter_with_its_default():
    content = yaml.safe_load((ROOT / "config" / "pose_estimator.yaml").read_text())
    flat = dict(_flat(content["/**"]["ros__parameters"]))
    assert flat == {spec.name: spec.default for spec in (CAMERAS, *estimator_specs(NAMES))}
    assert LAYOUT.n_joints == 17


def _flat(tree, prefix=""):
    for name, value in tree.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value
