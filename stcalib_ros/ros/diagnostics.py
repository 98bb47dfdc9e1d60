"""State of the cameras and of the solver as ``diagnostic_msgs``."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from stcalib_ros.core.model.rejection import Rejection
from stcalib_ros.core.model.rejection_text import sentence
from stcalib_ros.core.monitoring.alarms import State, Verdict
from stcalib_ros.io.message_types import TYPES, Content, types_of
from stcalib_ros.io.topics import SelectedCamera
from stcalib_ros.ros.camera_buffer import Counts
from stcalib_ros.ros.coverage import CameraCoverage
from stcalib_ros.ros.driver_lenses import OFF, DriverState
from stcalib_ros.ros.limits import PROBLEM_S, REPEAT_STARVED_S, STARVED_S
from stcalib_ros.ros.load import Load
from stcalib_ros.ros.people_topics import topics_of_people
from stcalib_ros.ros.worker import Step


@dataclass(frozen=True, slots=True)
class SolverState:
    """What the solver does and did.

    Attributes
    ----------
    step : Step or None
        Where the run in progress stands; None if there is none.
    in_force : str
        Id of the run of the calibration in force; empty if there is none.
    last_run, last_status, last_message : str
        Id, status and message of the last run that ended; empty if none has.
    last_took_s : float
        Time that its solver took; NaN if none has ended.
    last_ended_s : float
        When its solver was done, Unix seconds by this machine's clock; NaN if none has ended.
    last_reasons : tuple of Rejection
        Why the last run, or cameras in it, were rejected.
    unsaved : str
        Why the calibration in force is not on the disk; empty if it is, or there is none.
    """

    step: Step | None = None
    in_force: str = ""
    last_run: str = ""
    last_status: str = ""
    last_message: str = ""
    last_took_s: float = math.nan
    last_ended_s: float = math.nan
    last_reasons: tuple[Rejection, ...] = ()
    unsaved: str = ""


def starvation(camera: SelectedCamera, counts: Counts, node: Any) -> str:
    """Return what a camera waits for, with the publishers of that topic; empty if nothing."""
    lacking = []
    if counts.age_s > STARVED_S:
        ago = "none has come" if counts.received == 0 else f"the last came {counts.age_s:.0f} s ago"
        publishers = _publishers_of_poses(node, camera)
        lacking.append(f"waits for poses, {ago}: {publishers}")
    elif counts.dropped and not counts.images:
        lacking.append(f"sends nothing that can be used: {counts.last_problem}")
    elif counts.no_keypoints:
        lacking.append(
            f"sends people without keypoints on {camera.pose_topic}; check the output of the "
            "pose estimator"
        )
    elif counts.fault is not None:
        lacking.append(f"sends on {camera.pose_topic}: {sentence(counts.fault)}")
    if counts.no_lens is not None:
        lacking.append(f"sends on {camera.info_topic}: {sentence(counts.no_lens)}")
    elif not counts.has_info:
        publishers = publishers_of(node, camera.info_topic, camera.info_type)
        lacking.append(f"waits for CameraInfo: {publishers}")
    return "; ".join(lacking)


class Complaint(NamedTuple):
    """A warning for the log: its subject, a line, and how often it is repeated, seconds."""

    subject: str
    line: str
    every_s: float


def complaints(lacks: Mapping[str, str], counts: Mapping[str, Counts]) -> tuple[Complaint, ...]:
    """Return what to say of what cameras lack: of a lens that is not known once.

    Parameters
    ----------
    lacks : mapping of str to str
        See `starvation`, by the name of the camera.
    counts : mapping of str to Counts
    """
    said = {name: f"camera {name} {lack}" for name, lack in lacks.items() if lack}
    once = [name for name in said if counts[name].no_lens is not None]
    starved = "; ".join(line for name, line in said.items() if name not in once)
    return (
        *((Complaint("starved", starved, REPEAT_STARVED_S),) if starved else ()),
        *(Complaint(f"no lens of {name}", said[name], math.inf) for name in once),
    )


def _publishers_of_poses(node: Any, camera: SelectedCamera) -> str:
    if not TYPES[camera.pose_type].topic_per_person:
        return publishers_of(node, camera.pose_topic, camera.pose_type)
    topics = ", ".join(topics_of_people(node, camera))
    return f"there is {topics}" if topics else f"nobody publishes on {camera.pose_topic}"


def publishers_of(node: Any, topic: str, wanted: str = "") -> str:
    """Describe the publishers of a topic: names, types and QoS.

    Parameters
    ----------
    node : rclpy.node.Node
    topic : str
    wanted : str
        Type that is expected; the text says so if nobody publishes it. Empty: any.
    """
    name = node.resolve_topic_name(topic)
    infos = node.get_publishers_info_by_topic(name)
    if not infos:
        return f"nobody publishes on {name}"
    described = [
        f"{i.node_namespace.rstrip('/')}/{i.node_name} ({i.topic_type}, "
        f"{i.qos_profile.reliability.name}, {i.qos_profile.durability.name})"
        for i in infos
    ]
    mismatch = wanted and all(i.topic_type != wanted for i in infos)
    not_wanted = f", but nobody publishes a {wanted}" if mismatch else ""
    others = {i.topic_type for i in infos}.intersection(types_of(Content.POSES))
    if mismatch and wanted in types_of(Content.POSES) and others:
        not_wanted += f"; set pose_type of this camera to {' or '.join(sorted(others))}"
    return f"{name} is published by {', '.join(described)}{not_wanted}"


def camera_status(
    prefix: str,
    camera: SelectedCamera,
    counts: Counts,
    lack: str,
    verdict: Verdict | None,
    driver: DriverState = OFF,
    coverage: CameraCoverage | None = None,
) -> Any:
    """Return the status of one camera.

    An error if it is starved, sends nothing usable, or the calibration does not hold for it any
    more; a warning if messages were dropped in the last minute, or its driver has not taken the
    lens that was found.
    """
    level, message = DiagnosticStatus.OK, "receiving"
    if lack:
        level, message = DiagnosticStatus.ERROR, lack
    elif verdict is not None and verdict.state.alarm:
        level = DiagnosticStatus.ERROR if verdict.state.changed else DiagnosticStatus.WARN
        message = verdict.sentence()
    elif counts.dropped_age_s <= PROBLEM_S:
        level, message = DiagnosticStatus.WARN, f"dropped messages: {counts.last_problem}"
    elif driver.failed:
        level, message = DiagnosticStatus.WARN, driver.text
    values = {
        "rate_hz": f"{counts.rate_hz:.2f}",
        "age_s": f"{counts.age_s:.2f}",
        "camera_info": str(counts.has_info).lower(),
        "images": counts.images,
        "images_3d": counts.images_3d,
        "persons": counts.persons,
        "moving_s": counts.moving_s,
        "received": counts.received,
        "dropped": counts.dropped,
        "flushes": counts.flushes,
        "set_aside": counts.set_aside,
        "last_problem": counts.last_problem,
        "set_camera_info": driver.text,
        **_coverage_values(coverage),
        **_watch_values(verdict),
    }
    return _status(f"{prefix}: camera {camera.name}", level, message, values)


def _coverage_values(coverage: CameraCoverage | None) -> dict[str, str]:
    """Values of what the window has seen; None: it has not been looked at yet."""
    if coverage is None:
        return {}
    shared = (f"{name}: {seconds} s" for name, seconds in coverage.shared_s.items())
    return {
        "image_covered": f"{coverage.share:.2f}",
        "shared_with": ", ".join(shared),
        "needs": coverage.missing,
    }


def changed_line(verdict: Verdict, *, again: bool) -> str:
    """Say that a calibration does not hold any more, and what to do.

    Parameters
    ----------
    verdict : Verdict
    again : bool
        The node will calibrate again by itself.
    """
    if again:
        return f"{verdict.sentence()}; calibrating again as soon as people have moved"
    undo = "" if verdict.state is State.DRIFTED else "undo the change, or "
    return f"{verdict.sentence()}; {undo}let people walk and call ~/recalibrate_now"


def _watch_values(verdict: Verdict | None) -> dict[str, str]:
    """Values of the watch; None: the camera is not watched."""
    if verdict is None:
        return {"watch": "off"}
    return {
        "watch": verdict.state.value,
        "watch_rotation_deg": f"{verdict.rotation_deg:.2f}",
        "watch_shift_m": f"{verdict.shift_m:.3f}",
        "watch_clock_ms": f"{1e3 * verdict.clock_jump_s:.0f}",
        "watch_residual_px": f"{verdict.residual_px:.1f}",
        "watch_promised_px": f"{verdict.expected_px:.1f}",
    }


def solver_status(prefix: str, solver: SolverState) -> Any:
    """Return the solver's status: an error while nothing is in force and the last run failed.

    A warning while the calibration in force is not on the disk.
    """
    level = DiagnosticStatus.OK
    if not solver.in_force:
        failed = bool(solver.last_status)
        level = DiagnosticStatus.ERROR if failed else DiagnosticStatus.WARN
    step = solver.step
    message = f"running {step.run_id}: {step.stage}" if step else "idle"
    if solver.unsaved:
        level = max(level, DiagnosticStatus.WARN)
        message += f"; the calibration in force is not saved: {solver.unsaved}"
    values = {
        "state": "running" if step else "idle",
        "run_id": step.run_id if step else "",
        "stage": step.stage if step else "",
        "progress": f"{step.fraction:.2f}" if step else "",
        "in_force": solver.in_force,
        "unsaved": solver.unsaved,
        "last_run": solver.last_run,
        "last_status": solver.last_status,
        "last_message": solver.last_message,
        "last_took_s": f"{solver.last_took_s:.2f}",
        "last_ended_s": f"{solver.last_ended_s:.3f}",
        "last_reasons": ", ".join(map(_code, solver.last_reasons)),
    }
    return _status(f"{prefix}: solver", level, message, values)


def _code(rejection: Rejection) -> str:
    """Return the code of a rejection, and the cameras that it is about."""
    about = f" ({' '.join(rejection.cameras)})" if rejection.cameras else ""
    return rejection.reason.value + about


def load_status(prefix: str, load: Load, lost: Mapping[str, int], *, newly_lost: bool) -> Any:
    """Return the status of the intake: a warning while messages are being lost.

    Parameters
    ----------
    prefix : str
    load : Load
    lost : mapping of str to int
        Pose messages that never came, by camera, since the start.
    newly_lost : bool
        Some of them were lost since the last status.
    """
    level, message = DiagnosticStatus.OK, "keeping up"
    if newly_lost:
        level = DiagnosticStatus.WARN
        losing = ", ".join(f"{name}: {n}" for name, n in lost.items() if n)
        message = f"messages are lost in the network or in the queue (queue_depth), {losing}"
    values = {
        "messages_per_minute": load.messages,
        "lost": sum(lost.values()),
        **{
            name: f"{1e3 * getattr(load, name.replace('_ms', '_s')):.2f}"
            for name in (
                "delay_p50_ms",
                "delay_p99_ms",
                "delay_max_ms",
                "hold_p99_ms",
                "hold_max_ms",
            )
        },
    }
    return _status(f"{prefix}: load", level, message, values)


def _status(name: str, level: bytes, message: str, values: Mapping[str, object]) -> Any:
    pairs = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
    return DiagnosticStatus(level=level, name=name, message=message, hardware_id="", values=pairs)
