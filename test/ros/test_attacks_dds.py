"""What a peer sets or calls, and what lies in the results folder, ends and stalls no node."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2: make env")
pytest.importorskip("stcalib_ros.msg", reason="the messages are not built: make env")

from live import Client, LiveNode
from samples import calibration
from stcalib_ros.srv import Recalibrate, SaveCalibration
from std_srvs.srv import Trigger

from stcalib_ros.core.model.calibration import Status
from stcalib_ros.io.history import History

MAX_NODE_MB = 400
NINEFOLD = "".join(f", &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 9))
VALUES = {
    "!!bool x": "with the tag",
    "!!float ''": "with the tag",
    "!!timestamp x": "with the tag",
    f"[&a0 [x, x, x, x, x, x, x, x, x]{NINEFOLD}]": "more than 1000 values",
    "{" + ", ".join(f"k{i}: 1" for i in range(30_000)) + "}": "at most 10000 characters",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two good calibrations, and newer ones that are cut, a bomb, not OK, and a pipe."""
    path = tmp_path_factory.mktemp("attacks") / "results"
    history = History(path, keep=20)
    for _ in range(3):
        history.add(calibration())
    history.add(replace(calibration(), status=Status.NOT_CONVERGED))
    text = (path / "calibration.000003.yaml").read_text()
    (path / "calibration.000003.yaml").write_text(text[: len(text) // 2])
    (path / "calibration.000005.yaml").write_text(f"a: [&a0 [x, x, x]{NINEFOLD}]\n{text}")
    os.mkfifo(path / "calibration.000006.yaml")
    (path / f".stcalib-{os.getpid()}-00000000.tmp").write_text("of a process that lives")
    (path / ".stcalib-999999999-00000000.tmp").write_text("of a process that is gone")
    return path


@pytest.fixture(scope="module")
def started(folder: Path) -> Iterator[tuple[LiveNode, Client]]:
    given = {"cameras": "[cam0, cam1, cam2]", "results_folder": str(folder)}
    live = LiveNode(folder.parent, given, "attacked")
    client = Client("attacked")
    try:
        client.next_diagnostics()
        yield live, client
        assert live.stop()[0] == 0
        assert "Traceback" not in live.log.read_text()
    finally:
        live.kill()
        client.close()


def test_the_newest_calibration_that_can_be_used_is_in_force(started, folder):
    live, client = started
    assert client.status("solver")["in_force"] == "saved-000002"
    log = live.log.read_text()
    for said in ("000006.yaml is not a regular file", "values", "NOT_CONVERGED", "000003.yaml"):
        assert said in log
    assert sorted(p.name for p in folder.glob(".*")) == [f".stcalib-{os.getpid()}-00000000.tmp"]


def test_values_of_parameters_are_refused_at_once(started):
    live, client = started
    for value, message in VALUES.items():
        ((done, reason),) = client.change(**{"scale.distances": value})
        assert not done
        assert message in reason
        assert len(reason) <= 400
    assert live.process.poll() is None
    assert client.change(seed=2) == [(True, "")]


def test_names_to_save_to_are_taken_or_refused(started, folder):
    _, client = started
    for length in (230, 245, 250, 255, 256, 5000):
        name = f"{'n' * (length - 5)}.yaml"
        answer = client.answer(SaveCalibration, "save", path=name)
        assert answer.success == (length <= 255), answer.message
        assert (folder / name).exists() if length <= 255 else len(answer.message) <= 400
    for name in ("a\nb.yaml", "\x1b[31m.yaml", "x" * 100_000):
        answer = client.answer(SaveCalibration, "save", path=name)
        assert not answer.success
        assert answer.message.isprintable()
    answer = client.answer(SaveCalibration, "save", path="a.yaml", format="x" * 100_000)
    assert not answer.success
    assert len(answer.message) <= 400


def test_cameras_that_are_asked_for_are_refused_in_a_line(started):
    _, client = started
    answer = client.answer(Recalibrate, "recalibrate", cameras=["c" * 1000] * 1000)
    assert not answer.accepted
    assert len(answer.result.message) < 600


def test_a_second_node_with_the_folder_says_so(started, folder):
    live, _ = started
    other = LiveNode(folder.parent, live.given, "second")
    client = Client("second")
    try:
        client.next_diagnostics()
        assert "another process keeps its calibrations there" in other.log.read_text()
    finally:
        other.kill()
        client.close()


def test_a_rollback_passes_over_what_cannot_be_used(started, folder):
    live, client = started
    answer = client.answer(Trigger, "rollback")
    assert (answer.success, answer.message) == (True, "calibration 1 is in force again")
    assert not client.answer(Trigger, "rollback").success
    assert sorted(p.name for p in folder.glob("calibration*")) == [
        "calibration.000001.yaml",
        *(f"calibration.{n:06d}.withdrawn.yaml" for n in range(2, 7)),
    ]
    pages = int(Path(f"/proc/{live.process.pid}/statm").read_text().split()[1])
    assert pages * os.sysconf("SC_PAGE_SIZE") / 1e6 < MAX_NODE_MB
