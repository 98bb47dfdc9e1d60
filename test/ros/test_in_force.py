"""What is in force after a start, a full disk, a rollback, whatever lies in the folder."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2: make env")
pytest.importorskip("stcalib_ros.msg", reason="the messages are not built: make env")

from builtin_interfaces.msg import Time

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.calibration import Calibration, CameraCalibration, Status
from stcalib_ros.core.model.recording import Intrinsics, LensModel
from stcalib_ros.io import history as history_module
from stcalib_ros.io.exports import EXPORTS
from stcalib_ros.io.history import History
from stcalib_ros.io.results import write_result
from stcalib_ros.ros.convert import calibration_result
from stcalib_ros.ros.in_force import InForce
from stcalib_ros.ros.limits import SAVE_AGAIN_S

LENS = Intrinsics(640, 480, LensModel.PLUMB_BOB, np.diag([600.0, 600.0, 1.0]), np.zeros(5))


def calibration(n_inliers: int, **changes: Any) -> Calibration:
    cameras = tuple(
        CameraCalibration(name, name, LENS, np.eye(3), np.zeros(3), np.eye(6), 0.0, 0.0)
        for name in ("cam0", "cam1")
    )
    made = Calibration(
        Status.OK, "", "cam0", True, 1.0, (1.0, 2.0), cameras, (), (), (), 1.0, 100, n_inliers
    )
    return replace(made, **changes)


class Log:
    def __init__(self) -> None:
        self.lines: list[str] = []

    def info(self, line: str) -> None:
        self.lines.append(line)

    warning = error = info


class Published:
    def __init__(self) -> None:
        self.run_ids: list[str] = []

    def publish(self, _: Calibration, message: Any) -> None:
        self.run_ids.append(message.run_id)


class Node:
    """What the node has of it: log, publishers, clock."""

    def __init__(self, folder: Path, initial: Path | None = None) -> None:
        self.log, self.published, self.now_s = Log(), Published(), 0.0
        self.in_force = InForce(
            History(folder, keep=5),
            ["cam0", "cam1"],
            self.published,  # type: ignore[arg-type]
            lambda one, run_id: calibration_result(one, run_id=run_id, stamp=Time()),
            self.log,
            clock=lambda: self.now_s,
        )
        self.in_force.load(initial)


def saved(folder: Path, *calibrations: Calibration) -> None:
    for k, one in enumerate(calibrations):
        write_result(one, folder / f"calibration.{k + 1:06d}.yaml")


OTHERS = tuple(
    CameraCalibration(name, name, LENS, np.eye(3), np.zeros(3), np.eye(6), 0.0, 0.0)
    for name in ("cam0", "cam9")
)
UNUSABLE = {
    "its status is NOT_CONVERGED": {"status": Status.NOT_CONVERGED},
    "the cameras cam9, which are not configured": {"cameras": OTHERS},
    "it has 1 cameras": {"cameras": OTHERS[:1]},
}


@pytest.mark.parametrize("said", UNUSABLE)
def test_after_a_start_the_newest_that_can_be_used_is_in_force(tmp_path, said):
    saved(tmp_path, calibration(10), calibration(20), calibration(30, **UNUSABLE[said]))
    node = Node(tmp_path)
    assert node.published.run_ids == ["saved-000002"]
    assert said in node.log.lines[0]
    assert "calibration.000003.yaml" in node.log.lines[0]
    assert "the newest that can be used, is in force" in node.log.lines[1]
    assert node.in_force.rollback() == "calibration 1 is in force again"
    assert node.in_force.calibration.n_inliers == 10
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "calibration.000001.yaml",
        "calibration.000002.withdrawn.yaml",
        "calibration.000003.withdrawn.yaml",
    ]
    with pytest.raises(InputError, match="no earlier calibration"):
        node.in_force.rollback()


def test_a_result_file_is_in_force_from_the_start(tmp_path):
    given, folder = tmp_path / "walk.yaml", tmp_path / "results"
    write_result(calibration(10), given)
    node = Node(folder, given)
    assert node.published.run_ids == ["file-walk"]
    assert node.log.lines[-1] == f"{given} is in force"
    assert [p.name for p in folder.iterdir()] == ["calibration.000001.yaml"]
    again = Node(folder, given)
    assert again.published.run_ids == ["saved-000001"]
    assert "is from later data" in again.log.lines[-1]
    again.in_force.replace(calibration(20, window_s=(1.0, 5.0)), "run-1")
    assert Node(folder, given).published.run_ids == ["saved-000002"]
    write_result(calibration(30, window_s=(4.0, 6.0)), given)
    node = Node(folder, given)
    assert node.published.run_ids == ["saved-000002", "file-walk"]
    assert node.in_force.rollback() == "calibration 2 is in force again"


REFUSED = {
    r"not to be used \(NOT_CONVERGED\)": {"status": Status.NOT_CONVERGED},
    "the cameras cam9, which are not configured": {"cameras": OTHERS},
}


@pytest.mark.parametrize("said", REFUSED)
def test_a_result_file_that_cannot_be_used_is_an_error(tmp_path, said):
    given = tmp_path / "walk.yaml"
    write_result(calibration(10, **REFUSED[said]), given)
    with pytest.raises(InputError, match=f"^initial_calibration: .*walk.yaml.*{said}"):
        Node(tmp_path / "results", given)
    with pytest.raises(InputError, match="initial_calibration: no such file"):
        Node(tmp_path / "results", tmp_path / "absent.yaml")
    assert not (tmp_path / "results").exists()


def test_a_rollback_says_what_it_passed_over(tmp_path):
    saved(tmp_path, calibration(10), calibration(20, status=Status.DEGENERATE), calibration(30))
    node = Node(tmp_path)
    assert node.in_force.rollback() == (
        "calibration 1 is in force again; not used: calibration.000002.yaml: its status is "
        "DEGENERATE"
    )


def test_what_no_message_can_hold_is_not_used(tmp_path, monkeypatch):
    """Beyond what reading checks: some field that a later version adds."""
    saved(tmp_path, calibration(10), calibration(20))
    read = history_module.read_result

    def odd(path: Path) -> Calibration:
        one = read(path)
        return replace(one, n_inliers=-1) if one.n_inliers == 20 else one

    monkeypatch.setattr(history_module, "read_result", odd)
    node = Node(tmp_path)
    assert node.published.run_ids == ["saved-000001"]
    assert "no message can hold it" in node.log.lines[0]


def test_what_could_not_be_saved_is_saved_when_that_is_possible(tmp_path):
    saved(tmp_path, calibration(10))
    node = Node(tmp_path)
    folder = node.in_force._history.folder
    hidden = folder.with_name("hidden")
    folder.rename(hidden)
    folder.touch()
    problem = node.in_force.replace(calibration(20), "run-1")
    assert "but not saved: cannot make" in problem
    assert node.in_force.problem in problem
    node.in_force.save_again()
    folder.unlink()
    hidden.rename(folder)
    node.in_force.save_again()
    assert node.in_force.problem, "tried again too soon"
    node.now_s += SAVE_AGAIN_S
    node.in_force.save_again()
    assert node.in_force.problem == ""
    assert node.log.lines[-1] == "run run-1 is saved now, as calibration 2"
    assert Node(tmp_path).published.run_ids == ["saved-000002"]
    assert node.in_force.rollback() == "calibration 1 is in force again"
    node.now_s += SAVE_AGAIN_S
    node.in_force.save_again()
    assert len(list(tmp_path.iterdir())) == 2


def test_a_folder_that_cannot_be_listed_ends_nothing(tmp_path, monkeypatch):
    def refuse(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    saved(tmp_path, calibration(10))
    with monkeypatch.context() as patch:
        patch.setattr(Path, "iterdir", refuse)
        node = Node(tmp_path)
        assert node.in_force.calibration is None
        assert "Permission denied" in node.log.lines[-1]
        assert "Permission denied" in node.in_force.replace(calibration(20), "run-1")
        for ask in (node.in_force.rollback, lambda: node.in_force.export("a.yaml", "stcalib")):
            with pytest.raises(InputError, match="Permission denied"):
                ask()
        assert node.in_force.calibration.n_inliers == 20
    node.now_s += SAVE_AGAIN_S
    node.in_force.save_again()
    assert node.in_force.problem == ""


def test_it_is_saved_in_the_formats_that_there_are(tmp_path):
    node = Node(tmp_path)
    with pytest.raises(InputError, match="no calibration to save"):
        node.in_force.export("a.yaml", "stcalib")
    saved(tmp_path, calibration(10))
    node = Node(tmp_path)
    assert node.in_force.export("a.yaml", "stcalib").is_file()
    folder = node.in_force.export("lenses", "camera_info")
    assert sorted(p.name for p in folder.iterdir()) == ["cam0.yaml", "cam1.yaml"]
    for form in EXPORTS.values():
        name = f"of_{form.name}{form.endings[0] if form.endings else ''}"
        assert node.in_force.export(name, form.name) == tmp_path / name
    with pytest.raises(InputError, match="'freemocap' is unknown; there is stcalib, camera_info,"):
        node.in_force.export("a.toml", "freemocap")


def test_a_second_node_with_the_same_folder_is_warned_of_once(tmp_path, monkeypatch):
    monkeypatch.setattr(History, "claim", lambda _: False)
    saved(tmp_path, calibration(10))
    node = Node(tmp_path)
    node.in_force.replace(calibration(20), "run-1")
    assert sum("another process keeps its calibrations there" in x for x in node.log.lines) == 1
