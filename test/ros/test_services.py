"""What the action reports of a run that somebody cancels too late, or that is not its own."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2: make env")
pytest.importorskip("stcalib_ros.msg", reason="the messages are not built: make env")

from action_msgs.msg import GoalStatus
from live import Client
from rclpy.action import ActionClient
from rclpy.task import Future
from stcalib_ros.action import Calibrate
from stcalib_ros.msg import CalibrationResult

from stcalib_ros import cli
from stcalib_ros.core.model.calibration import Calibration, Status
from stcalib_ros.io.exports import EXPORTS
from stcalib_ros.ros.convert import calibration_result, time_message
from stcalib_ros.ros.services import Run, Services
from stcalib_ros.ros.worker import failure


class OneRun:
    """A calibrator whose run ends when the test says so."""

    def __init__(self) -> None:
        self.run: Run | None = None
        self.cancelled = 0

    def refusal(self, **_given: Any) -> Calibration | None:
        if self.run is not None:
            return failure(Status.CANCELLED, "not started: a run is in progress")
        return None

    def start(self, **_given: Any) -> Run | Calibration:
        if (refused := self.refusal()) is not None:
            return refused
        self.run = Run("first", Future(), None)
        return self.run

    def cancel(self) -> None:
        self.cancelled += 1

    def end(self, status: Status) -> None:
        assert self.run is not None
        result = replace(failure(Status.CANCELLED, "ended"), status=status)
        self.run.result.set_result(self.message(result, "first"))

    def rollback(self) -> str:
        raise NotImplementedError

    def save(self, path: str, form: str) -> Path:
        raise NotImplementedError

    def message(self, calibration: Calibration, run_id: str) -> CalibrationResult:
        return calibration_result(calibration, run_id=run_id, stamp=time_message(math.nan))


@pytest.fixture
def client() -> Iterator[Client]:
    """A node that has the services and asks itself."""
    made = Client("services")
    yield made
    made.close()


@pytest.fixture
def calibrator(client: Client) -> Iterator[OneRun]:
    made = OneRun()
    services = Services(client.node, made)
    yield made
    services.destroy()


@pytest.fixture
def send(client: Client, calibrator: OneRun) -> Iterator[Callable[[], Any]]:
    """Sends a goal; returns its handle when the goal is accepted."""
    action = ActionClient(client.node, Calibrate, f"{client.node.get_name()}/calibrate")
    client.wait(action.server_is_ready, "the action")
    yield lambda: client.result_of(action.send_goal_async(Calibrate.Goal()), "the goal's answer")
    action.destroy()


def ended(client: Client, goal: Any) -> tuple[int, int]:
    """Status of a goal and of its result."""
    answer = client.result_of(goal.get_result_async(), "the goal's result")
    return answer.status, answer.result.result.status


@pytest.mark.parametrize(
    ("status", "goal_status"),
    [
        (Status.OK, GoalStatus.STATUS_SUCCEEDED),
        (Status.DEGENERATE, GoalStatus.STATUS_ABORTED),
        (Status.CANCELLED, GoalStatus.STATUS_CANCELED),
    ],
)
def test_a_goal_that_is_cancelled_reports_what_came_of_its_run(
    client, calibrator, send, status, goal_status
):
    goal = send()
    client.wait(lambda: calibrator.run is not None, "the run")
    client.result_of(goal.cancel_goal_async(), "the answer to the cancelling")
    assert calibrator.cancelled == 1
    calibrator.end(status)
    assert ended(client, goal) == (goal_status, int(status))


def test_a_goal_that_cannot_start_is_rejected(client, calibrator, send):
    first = send()
    assert first.accepted
    client.wait(lambda: calibrator.run is not None, "the run")
    assert not send().accepted
    calibrator.end(Status.OK)
    assert ended(client, first)[0] == GoalStatus.STATUS_SUCCEEDED


class Server:
    """Takes the place of rclpy's action server: the test calls back, in an order of its own."""

    def __init__(self, _node: Any, _kind: Any, _name: str, execute: Any, **given: Any) -> None:
        self.execute, self.cancel = execute, given["cancel_callback"]

    def destroy(self) -> None:
        pass


class Goal:
    """A goal that was accepted and not executed yet."""

    request = Calibrate.Goal()

    def __init__(self) -> None:
        self.is_cancel_requested = False
        self.ended = ""

    def abort(self) -> None:
        self.ended = "aborted"

    def canceled(self) -> None:
        self.ended = "canceled"


@pytest.fixture
def server(client: Client, monkeypatch: pytest.MonkeyPatch) -> tuple[OneRun, Server]:
    servers: list[Server] = []

    def made(*args: Any, **given: Any) -> Server:
        servers.append(Server(*args, **given))
        return servers[-1]

    monkeypatch.setattr("stcalib_ros.ros.services.ActionServer", made)
    calibrator = OneRun()
    Services(client.node, calibrator)
    return calibrator, servers[0]


def executed(server: Server, goal: Goal) -> Any:
    """Result of a goal that does not have to wait."""
    with pytest.raises(StopIteration) as stopped:
        server.execute(goal).send(None)
    return stopped.value.value.result


def test_a_goal_that_waits_for_its_turn_does_not_cancel_the_run_of_somebody_else(server):
    calibrator, server = server
    calibrator.start()
    server.cancel(Goal())
    assert calibrator.cancelled == 0


def test_a_goal_that_is_cancelled_before_its_turn_starts_no_run(server):
    calibrator, server = server
    goal = Goal()
    server.cancel(goal)
    goal.is_cancel_requested = True
    assert executed(server, goal).status == int(Status.CANCELLED)
    assert goal.ended == "canceled"
    assert calibrator.run is None


def test_a_goal_that_could_start_when_it_was_accepted_and_no_longer_is_aborted(server):
    calibrator, server = server
    calibrator.start()
    goal = Goal()
    assert executed(server, goal).status == int(Status.CANCELLED)
    assert goal.ended == "aborted"


def test_the_formats_that_are_documented_are_those_that_there_are():
    text = (Path(__file__).parents[2] / "srv" / "SaveCalibration.srv").read_text()
    request = text.partition("---")[0]
    assert tuple(re.findall(r'"(\w+)"', request)) == tuple(EXPORTS)
    commands = re.findall(r"`stcalib (\w+)", text)
    assert commands
    assert all((Path(cli.__file__).parent / "commands" / f"{c}.py").exists() for c in commands)
