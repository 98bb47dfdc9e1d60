"""The SROS 2 policy grants the running node exactly what it has."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2: make env")
pytest.importorskip("stcalib_ros.msg", reason="the messages are not built: make env")

from live import Client, LiveNode
from rclpy.action import get_action_server_names_and_types_by_node

POLICY = Path(__file__).parents[2] / "config" / "sros2" / "policy.xml"
TF = "/tf_static"


def granted(node: str, kind: str, right: str) -> set[str]:
    """Names below ``<topics publish="ALLOW">`` and the like, of one node."""
    tree = ElementTree.parse(POLICY)
    (profile,) = tree.iterfind(f".//profile[@node='{node}']")
    groups = profile.iterfind(f"{kind}[@{right}='ALLOW']")
    return {name.text.replace("~", f"/{node}") for group in groups for name in group}  # type: ignore[union-attr]


def names(pairs: list[tuple[str, list[str]]]) -> set[str]:
    return {name for name, _ in pairs if "/_action/" not in name}


def test_the_calibrator_has_what_is_granted_and_nothing_else(tmp_path):
    live = LiveNode(tmp_path, {"results_folder": str(tmp_path / "results")}, "calibrator")
    client = Client("calibrator")
    try:
        client.next_diagnostics()
        node = client.node
        publishes = names(node.get_publisher_names_and_types_by_node("calibrator", "/"))
        hears = names(node.get_subscriber_names_and_types_by_node("calibrator", "/"))
        answers = names(node.get_service_names_and_types_by_node("calibrator", "/"))
        actions = get_action_server_names_and_types_by_node(node, "calibrator", "/")
        # Without the package tf2_msgs nothing is published there.
        assert publishes | {TF} == granted("calibrator", "topics", "publish")
        assert hears == granted("calibrator", "topics", "subscribe")
        assert answers == granted("calibrator", "services", "reply")
        assert names(actions) == granted("calibrator", "actions", "execute")
        assert live.stop()[0] == 0
    finally:
        live.kill()
        client.close()


def test_an_operator_may_ask_for_what_the_calibrator_offers():
    offered = granted("calibrator", "topics", "publish")
    assert granted("operator", "topics", "subscribe") <= offered
    answered = granted("calibrator", "services", "reply")
    assert granted("operator", "services", "request") <= answered
    executed = granted("calibrator", "actions", "execute")
    assert granted("operator", "actions", "call") == executed
