"""The clock relay over real DDS: a process that relays, and another one that sends and listens."""

from __future__ import annotations

import re
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

pytest.importorskip("rclpy", reason="needs ROS 2: make env")
pytest.importorskip("stcalib_ros.msg", reason="the messages are not built: make env")

from live import LATCHED, RELIABLE, Client, LiveNode
from rclpy.qos import qos_profile_sensor_data
from rosgraph_msgs.msg import Clock
from samples import calibration, poses_message
from sensor_msgs.msg import CameraInfo, Image
from stcalib_ros.msg import CalibrationResult, PersonPose3DArray, TimeOffset
from std_msgs.msg import Header

from stcalib_ros.core.errors import InputError
from stcalib_ros.io.messages import NS
from stcalib_ros.io.results import write_result
from stcalib_ros.ros.convert import clock_corrections, time_message
from stcalib_ros.ros.parameter_specs import CAMERAS
from stcalib_ros.ros.restamp import message_class_with_header
from stcalib_ros.ros.restamp_parameters import (
    RELAY_SPECS,
    RelayedTopic,
    relay_settings,
    relay_specs,
)

ROOT = Path(__file__).parents[2]
T0_S = 1_760_000_000.0
APART_S = 0.3
"""The clock of cam1 is that much ahead of the clock of cam0."""

PARAMETERS = {
    "cameras": "[cam0, cam1, cam2]",
    "camera.cam0.topics": "[/cam0/image, /cam0/person_poses]",
    "camera.cam0.latched_topics": "[/cam0/camera_info]",
    "camera.cam1.topics": "['/cam1/image:sensor_msgs/msg/Image', /cam1/clock]",
    "camera.cam2.topics": "[/cam2/image]",
    "result_topic": "/result",
    "queue_depth": "100",
}


class Sender(Client):
    """Sends and listens; all that the relay sends is in `received` by topic."""

    def __init__(self) -> None:
        super().__init__("relay")
        self.received: dict[str, list[Any]] = {}

    def listen(self, kind: Any, topic: str, qos: Any = RELIABLE) -> None:
        messages = self.received.setdefault(topic, [])
        self.node.create_subscription(kind, f"/restamped{topic}", messages.append, qos)

    def topic(self, topic: str) -> dict[str, str]:
        return self.status(topic)

    def send_images(self, count: int, first: int = 0) -> None:
        """Of both cameras, taken at the same moments, each stamped by its own clock."""
        for k in range(first, first + count):
            for name, ahead_s in (("cam0", 0.0), ("cam1", APART_S)):
                stamp = time_message(T0_S + k / 30.0 + ahead_s)
                image = Image(header=Header(stamp=stamp, frame_id=name), width=k, height=1)
                self.publisher(Image, f"/{name}/image").publish(image)

    def publish_result(self, offsets_s: dict[str, float], **fields: Any) -> None:
        self._latched_publisher(CalibrationResult, "/result").publish(
            CalibrationResult(
                time_offsets=[TimeOffset(camera=n, offset_s=s) for n, s in offsets_s.items()],
                **fields,
            )
        )

    def publish_info(self) -> None:
        stamp = time_message(T0_S)
        self._latched_publisher(CameraInfo, "/cam0/camera_info").publish(
            CameraInfo(header=Header(stamp=stamp, frame_id="cam0"), width=640)
        )

    def _latched_publisher(self, kind: Any, topic: str) -> Any:
        if topic not in self._publishers:
            self._publishers[topic] = self.node.create_publisher(kind, topic, LATCHED)
        return self._publishers[topic]


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LiveNode]:
    folder = tmp_path_factory.mktemp("relay")
    live = LiveNode(folder, PARAMETERS, "relay", executable="restamp")
    yield live
    live.kill()


@pytest.fixture(scope="module")
def sender(live: LiveNode) -> Iterator[Sender]:
    sender = Sender()
    sender.listen(Image, "/cam0/image")
    sender.listen(Image, "/cam1/image")
    sender.listen(PersonPose3DArray, "/cam0/person_poses")
    sender.listen(CameraInfo, "/cam0/camera_info", LATCHED)
    yield sender
    sender.close()


def pairs(first: list[Any], second: list[Any], *, within_s: float) -> list[tuple[int, int]]:
    """Images with the nearest one of the other camera, if it is near enough, by their numbers."""
    found = []
    for a in first:
        b = min(second, key=lambda m: abs(stamp_s(m) - stamp_s(a)), default=None)
        if b is not None and abs(stamp_s(b) - stamp_s(a)) <= within_s:
            found.append((a.width, b.width))
    return found


def stamp_s(message: Any) -> float:
    stamp = message.header.stamp
    return stamp.sec - T0_S + stamp.nanosec / NS


def test_nothing_is_relayed_before_the_offsets_are_known(live, sender):
    sender.publish_info()
    sender.send_images(3)
    sender.wait(lambda: sender.topic("/cam1/image").get("dropped") == "3", "drops")
    said = sender.topic("/cam1/image")
    assert said["message"] == "the offset of its camera is not known"
    assert (said["relayed"], said["correction"]) == ("0", "")
    assert not any(sender.received.values())


def test_with_the_offsets_images_pair_by_their_stamps(live, sender):
    """What message_filters' ApproximateTimeSynchronizer needs."""
    sender.publish_result({"cam0": 0.0, "cam1": -APART_S}, run_id="first")
    sender.wait(lambda: "result first: clocks are corrected by" in live.log.read_text(), "them")
    sender.send_images(30)
    images = [sender.received[f"/cam{i}/image"] for i in (0, 1)]
    sender.wait(lambda: min(map(len, images)) == 30, "all images")
    assert pairs(*images, within_s=0.001) == [(k, k) for k in range(30)]
    assert {m.header.frame_id for m in images[1]} == {"cam1"}
    for message in images[1]:
        message.header.stamp = time_message(T0_S + stamp_s(message) + APART_S)
    assert not [p for p in pairs(*images, within_s=0.01) if p[0] == p[1]], "without the relay"


def test_the_body_stays_as_it_is(live, sender):
    sent = poses_message()
    publisher = sender.publisher(PersonPose3DArray, "/cam0/person_poses")
    arrived = sender.received["/cam0/person_poses"]
    publisher.publish(sent)
    sender.wait(lambda: bool(arrived), "poses")
    assert repr(arrived[0]) == repr(sent), "the reference camera's stamps are right already"


def test_a_latched_message_is_kept_and_sent_with_every_offset(live, sender):
    infos = sender.received["/cam0/camera_info"]
    sender.wait(lambda: len(infos) == 1, "the CameraInfo that came before the offsets")
    sender.publish_result({"cam0": 0.05, "cam1": -0.25}, run_id="second")
    sender.wait(lambda: len(infos) == 2, "it again")
    assert [round(stamp_s(m), 6) for m in infos] == [0.0, 0.05]
    assert infos[1].width == 640


def test_new_offsets_hold_at_once_and_are_told(live, sender):
    log = live.log.read_text()
    assert "second: clocks are corrected by: cam0 +50.000 ms, cam1 -250.000 ms" in log
    assert "second has no offset of cam2, only of cam0, cam1: its messages are dropped" in log
    images = sender.received["/cam1/image"]
    images.clear()
    sender.send_images(1, first=40)
    sender.wait(lambda: bool(images), "an image")
    assert stamp_s(images[0]) == pytest.approx(40 / 30.0 + 0.05, abs=1e-6)


@pytest.mark.parametrize(
    ("offsets_s", "fields", "why"),
    [
        ({"cam0": float("nan")}, {}, "no clock: offset nan s"),
        ({"cam0": 1e300}, {}, "no clock: offset 1e+300 s"),
        (
            {"cam0": 0.0},
            {"status": CalibrationResult.DEGENERATE, "message": "too flat"},
            "too flat",
        ),
        ({f"cam{i}": 0.0 for i in range(65)}, {}, "it has 65 cameras; there can be 64"),
        ({"c" * 257: 0.0}, {}, "the name of a camera is longer than 256"),
    ],
)
def test_results_that_cannot_be_used_change_nothing(live, sender, offsets_s, fields, why):
    sender.publish_result(offsets_s, run_id="bad", **fields)
    sender.wait(lambda: f"result bad is not used: {why}" in live.log.read_text(), why)
    sender.next_diagnostics()
    assert sender.topic("/cam1/image")["correction"] == "-250.000 ms"


def test_what_has_no_header_is_refused_in_one_line(live, sender):
    sender.publisher_without_subscription = sender.node.create_publisher(Clock, "/cam1/clock", 10)
    sender.wait(lambda: "not relayed" in live.log.read_text(), "a refusal")
    (line,) = [s for s in live.log.read_text().splitlines() if "not relayed" in s]
    assert "rosgraph_msgs/msg/Clock begins with 'builtin_interfaces/Time clock'" in line
    sender.wait(lambda: "begins with" in sender.topic("/cam1/clock")["message"], "diagnostics")


def test_the_subscription_follows_the_publishers_reliability(live, sender):
    assert sender.topic("/cam0/image")["reliable"] == "true"
    other = sender.node.create_publisher(Image, "/cam0/image", qos_profile_sensor_data)
    sender.wait(lambda: sender.topic("/cam0/image")["reliable"] == "false", "best effort")
    sender.wait(lambda: other.get_subscription_count() == 1, "the subscription")
    images = sender.received["/cam0/image"]
    images.clear()
    deadline = time.monotonic() + 30.0
    k = 100
    while not images and time.monotonic() < deadline:
        other.publish(Image(header=Header(stamp=time_message(T0_S + k)), width=7))
        sender.executor.spin_once(timeout_sec=0.1)
        k += 1
    assert images[0].width == 7


def test_it_names_what_it_waits_for_and_stops_at_once(live, sender):
    sender.next_diagnostics()
    said = "nothing received: nobody publishes on /cam2/image"
    assert sender.topic("/cam2/image")["message"] == said
    sender.wait(lambda: said in live.log.read_text(), "a warning")
    status, seconds = live.stop(signal.SIGINT)
    assert (status, seconds < 5.0) == (0, True)
    assert "Traceback" not in live.log.read_text()


def test_a_saved_result_will_do(tmp_path):
    """And remapping changes the source and with it the target."""
    write_result(calibration(), tmp_path / "out.yaml")
    given = {"cameras": "[cam2]", "camera.cam2.topics": "[image]", "result_topic": "''"}
    given |= {"result_file": str(tmp_path / "out.yaml")}
    remapped = ["--ros-args", "-r", "image:=/hall/image"]
    live = LiveNode(tmp_path, given, "relay", executable="restamp", arguments=remapped)
    sender = Sender()
    try:
        sender.listen(Image, "/hall/image")
        stamp = time_message(T0_S + 10.0)
        publisher = sender.publisher(Image, "/hall/image")
        sender.wait(lambda: sender.topic("/hall/image").get("reliable") == "true", "the relay")
        arrived = sender.received["/hall/image"]
        publisher.publish(Image(header=Header(stamp=stamp)))
        sender.wait(lambda: bool(arrived), "an image")
        camera = calibration().cameras[2]
        expected = camera.time_offset_s + camera.clock_skew * (10.0 - 0.25)
        assert stamp_s(arrived[0]) - 10.0 == pytest.approx(expected, abs=1e-8)
    finally:
        live.kill()
        sender.close()


def test_unusable_parameters_are_one_line(tmp_path):
    given = {"cameras": "[cam0]", "result_file": str(tmp_path / "absent.yaml")}
    live = LiveNode(tmp_path, given, "relay", executable="restamp")
    assert live.process.wait(timeout=60) == 2
    (line,) = live.log.read_text().splitlines()
    assert line.startswith("restamp: ")
    assert "absent.yaml" in line


def test_corrections_of_a_message_are_those_of_the_interface():
    offset = TimeOffset(camera="a", offset_s=0.5, skew=1e-6, epoch=time_message(T0_S))
    (correction,) = clock_corrections(CalibrationResult(time_offsets=[offset])).values()
    stamp_ns = round((T0_S + 100.0) * NS)
    assert correction.apply(stamp_ns) - stamp_ns == NS // 2 + 100_000


@pytest.mark.parametrize(
    ("type_name", "why"),
    [
        ("std_msgs/msg/String", "begins with 'string data'"),
        ("std_msgs/msg/Empty", "begins with"),
        ("std_msgs/msg/Nothing", "no message 'std_msgs/msg/Nothing' here"),
        ("no_such_package/msg/Image", "install and source the package 'no_such_package'"),
    ],
)
def test_types_that_cannot_be_relayed_say_why(type_name, why):
    with pytest.raises(InputError, match=why):
        message_class_with_header("/topic", type_name)


DEFAULTS = {spec.name: spec.default for spec in RELAY_SPECS}
TOPIC = RelayedTopic("cam0", "/cam0/image", "", False)


@pytest.mark.parametrize(
    ("topics", "changes", "why"),
    [
        ([], {}, "no topics"),
        ([TOPIC, TOPIC], {}, "/cam0/image is given twice"),
        ([TOPIC], {"input_reliability": "often"}, "'often' is none of auto, best_effort, reliable"),
        ([TOPIC], {"output_reliability": "auto"}, "'auto' is none of best_effort, reliable"),
        ([TOPIC], {"output_prefix": "/"}, "relayed to themselves"),
        ([TOPIC], {"result_topic": ""}, "are both empty"),
    ],
)
def test_unusable_settings_say_why(topics, changes, why):
    with pytest.raises(InputError, match=why):
        relay_settings(topics, **(DEFAULTS | changes))


def test_the_parameter_file_has_every_parameter_with_its_default():
    content = yaml.safe_load((ROOT / "config" / "restamp.yaml").read_text())
    found = content["/**"]["ros__parameters"]
    for name, own in found.pop("camera").items():
        found |= {f"camera.{name}.{key}": value for key, value in own.items()}
    specs = relay_specs(["cam0", "cam1"])
    assert found == {CAMERAS.name: CAMERAS.default} | {s.name: s.default for s in specs}


def test_all_parameters_are_fixed_as_the_file_says():
    text = (ROOT / "config" / "restamp.yaml").read_text()
    assert re.search("All hold from the start", text)
    assert all(spec.fixed for spec in (CAMERAS, *relay_specs(["cam0"])))
