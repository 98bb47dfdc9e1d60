"""The SROS 2 policy grants what the running nodes have, and nothing else."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2: make env")
pytest.importorskip("stcalib_ros.msg", reason="the messages are not built: make env")

from live import Client, LiveNode
from rclpy.node import NodeNameNonExistentError
from sensor_msgs.msg import Image

ROOT = Path(__file__).parents[2]
POLICY = ROOT / "config" / "sros2" / "policy.xml"
ONLY_WITH_SIMULATED_TIME = {("subscribe", "/clock")}
ONLY_WITH_TF2_MSGS = {("publish", "/tf_static")}
ACTION = "/_action/"
ONLY_LIVE = {"/diagnostics", *(f"/calibrator/{seen}_markers" for seen in ("people", "coverage"))}
SENSOR_TYPES = {"image_raw": "Image", "camera_info": "CameraInfo"}

Grants = set[tuple[str, str]]


def enclaves() -> dict[str, ElementTree.Element]:
    root = ElementTree.parse(POLICY).getroot()
    return {e.attrib["path"]: e for e in root.findall("./enclaves/enclave")}


def granted(enclave: str) -> Grants:
    """Pairs of right and full name."""
    (profile,) = enclaves()[enclave].findall("./profiles/profile")
    own = f"{profile.attrib['ns'].rstrip('/')}/{profile.attrib['node']}"
    return {
        (right, str(item.text).replace("~", own, 1))
        for listing in profile
        for right in listing.attrib
        for item in listing
    }


def used(client: Client, node: str) -> Grants:
    """What a node has, by the graph, in the words of a policy."""
    asked = client.node
    kinds = {
        "publish": asked.get_publisher_names_and_types_by_node,
        "subscribe": asked.get_subscriber_names_and_types_by_node,
        "reply": asked.get_service_names_and_types_by_node,
        "request": asked.get_client_names_and_types_by_node,
    }
    try:
        found = {(right, name) for right, names in kinds.items() for name, _ in names(node, "/")}
    except NodeNameNonExistentError:
        return set()
    actions = {("execute", name.partition(ACTION)[0]) for _, name in found if ACTION in name}
    return {(right, name) for right, name in found if ACTION not in name} | actions


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Client]:
    """Somebody who looks at the nodes with the parameters that they have by default.

    Images are theirs, as of a camera driver: the pose estimator subscribes to what is published.
    """
    folder = tmp_path_factory.mktemp("secured")
    typed = {
        f"camera.{camera}.topics": str(
            [f"/{camera}/{topic}:sensor_msgs/msg/{kind}" for topic, kind in SENSOR_TYPES.items()]
        )
        for camera in ("cam0", "cam1")
    }
    patch = pytest.MonkeyPatch()
    patch.setenv("PYTHONPATH", str(ROOT / "test/helpers"), prepend=":")
    estimator = {"cameras": "[cam0, cam1]", "estimator": "painted_poses:PaintedPoses"}
    lives = [
        LiveNode(folder, estimator, "pose_estimator", executable="pose_estimator"),
        LiveNode(folder, {"results_folder": str(folder)}, "calibrator"),
        LiveNode(
            folder, typed | {"input_reliability": "best_effort"}, "restamp", executable="restamp"
        ),
    ]
    patch.undo()
    client = Client("calibrator")
    for camera in ("cam0", "cam1"):
        client.publisher(Image, f"/{camera}/image_raw")
    try:
        yield client
        assert [live.stop()[0] for live in lives] == [0, 0, 0]
    finally:
        for live in lives:
            live.kill()
        client.close()


@pytest.mark.parametrize("node", ["calibrator", "restamp", "pose_estimator"])
def test_a_node_is_granted_what_it_has_and_nothing_else(client, node):
    needed = granted(f"/stcalib/{node}") - ONLY_WITH_SIMULATED_TIME - ONLY_WITH_TF2_MSGS
    client.wait(lambda: used(client, node) >= needed, f"all of {node}")
    assert used(client, node) - ONLY_WITH_TF2_MSGS == needed


def test_who_plays_a_bag_may_publish_what_cameras_and_the_live_node_do():
    published = {name for right, name in granted("/stcalib/replay") if right == "publish"}
    live = {
        name.replace("/calibrator/", "/replay/")
        for right, name in granted("/stcalib/calibrator")
        if right == "publish" and name not in ONLY_LIVE
    }
    cameras = {
        name
        for camera in ("cam0", "cam1")
        for right, name in granted(f"/stcalib/{camera}")
        if right == "publish"
    }
    assert published == live | cameras | {"/clock"}


def test_who_publishes_a_finished_result_may_publish_what_the_live_node_does():
    published = {name for right, name in granted("/stcalib/publish") if right == "publish"}
    live = {name for right, name in granted("/stcalib/calibrator") if right == "publish"}
    assert published == {n.replace("/calibrator/", "/publish/") for n in live - ONLY_LIVE}


def test_an_operator_may_ask_for_what_the_live_node_answers():
    answered = {name for right, name in granted("/stcalib/calibrator") if right == "reply"}
    asked = {name for right, name in granted("/stcalib/operator") if right == "request"}
    assert asked <= answered
    assert {n for n in answered if "param" not in n and "type" not in n} <= asked
    assert ("call", "/calibrator/calibrate") in granted("/stcalib/operator")


def test_who_only_looks_can_ask_for_nothing_and_nobody_speaks_for_another():
    assert {right for right, _ in granted("/stcalib/viewer")} == {"subscribe", "publish"}
    common = {"/rosout", "/parameter_events"}
    speakers: dict[str, list[str]] = {}
    for enclave in enclaves():
        for right, name in granted(enclave):
            if right == "publish" and name not in common:
                speakers.setdefault(name, []).append(enclave)
    for name, who in speakers.items():
        others = set(who) - {"/stcalib/replay", "/stcalib/publish", "/stcalib/pose_estimator"}
        assert len(others) <= 1 or name == "/diagnostics", f"{name}: {others}"


def test_one_pose_estimator_publishes_the_poses_of_all_cameras_and_nothing_else_of_them():
    of_cameras = {
        (right, name)
        for camera in ("cam0", "cam1")
        for right, name in granted(f"/stcalib/{camera}")
        if name.endswith("/person_poses")
    }
    published = {one for one in granted("/stcalib/pose_estimator") if one[0] == "publish"}
    common = {"/rosout", "/parameter_events", "/diagnostics"}
    assert published == of_cameras | {("publish", name) for name in common}


def test_the_page_has_every_enclave():
    page = (ROOT / "docs" / "security.md").read_text()
    assert {f"`{enclave}`" for enclave in enclaves()} - set(
        re.findall(r"`/stcalib/\w+`", page)
    ) == set()


def test_the_policy_has_the_form_that_sros2_reads():
    """Its schema 0.2.0; and no comment among the enclaves, which `ros2 security` takes for one."""
    tree = ElementTree.parse(
        POLICY, ElementTree.XMLParser(target=ElementTree.TreeBuilder(insert_comments=True))
    )
    root = tree.getroot()
    assert (root.tag, root.attrib) == ("policy", {"version": "0.2.0"})
    listings = {
        "topics": ("topic", {"publish", "subscribe"}),
        "services": ("service", {"reply", "request"}),
        "actions": ("action", {"call", "execute"}),
    }
    (all_enclaves,) = root.findall("enclaves")
    for enclave in all_enclaves:
        assert (enclave.tag, set(enclave.attrib)) == ("enclave", {"path"})
        for profile in enclave.findall("./profiles/profile"):
            assert set(profile.attrib) == {"ns", "node"}
            for listing in profile:
                item, rights = listings[str(listing.tag)]
                assert set(listing.attrib) <= rights
                assert set(listing.attrib.values()) == {"ALLOW"}
                assert {str(i.tag) for i in listing} == {item}
