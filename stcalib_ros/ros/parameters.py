"""Parameters of the live node: what there is, its range, and what may change at run time."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from stcalib_ros.core.errors import InputError, did_you_mean
from stcalib_ros.core.monitoring.alarms import Thresholds
from stcalib_ros.core.options import Options, options_from_mapping
from stcalib_ros.io.lens_settings import LENS_KEYS, lens_settings, require_lens_groups
from stcalib_ros.io.message_types import TYPES, Content, types_of
from stcalib_ros.io.topics import SelectedCamera
from stcalib_ros.io.yaml_files import parse_yaml
from stcalib_ros.ros.limits import (
    MAX_CAMERAS,
    MAX_PARAMETER_TEXT,
    MAX_PARAMETER_VALUES,
    MAX_TEXT,
    MIN_CAMERAS,
)
from stcalib_ros.ros.parameter_specs import (
    CAMERAS,
    DEFAULT_POSES,
    OPTION_SPECS,
    Spec,
    all_specs,
)
from stcalib_ros.ros.streams import Limits

_QOS_OVERRIDES = "qos_overrides."
"""Begin of parameters that are declared with the topics that they are of."""
_NAME = re.compile(r"[A-Za-z]\w*(/[A-Za-z]\w*)*", re.ASCII)


@dataclass(frozen=True, slots=True)
class Settings:
    """What the parameters say; attributes as in `NODE_SPECS`.

    Attributes
    ----------
    initial_calibration : Path or None
    set_camera_info : mapping of str to str
        Service of the driver by camera; empty: it is not called.
    """

    cameras: tuple[SelectedCamera, ...]
    limits: Limits
    options: Options
    queue_depth: int
    auto_calibrate: bool
    min_motion_s: float
    period_s: float
    watch: bool
    thresholds: Thresholds
    auto_recalibrate: bool
    results_folder: Path
    initial_calibration: Path | None
    keep_results: int
    publish_tf: bool
    tf_not_metric: bool
    tf_suffix: str
    view_frame: str
    set_camera_info: Mapping[str, str]


def require_camera_names(names: Iterable[str], *, at_least: int = MIN_CAMERAS) -> tuple[str, ...]:
    """Camera names that can be part of topics and parameters.

    Raises
    ------
    InputError
        There are too few or too many, one is given twice, or one is not a name.
    """
    names = tuple(names)
    if bad := [n for n in names if not _NAME.fullmatch(n) or len(n) > MAX_TEXT]:
        raise InputError(
            f"cameras: {bad[0][:MAX_TEXT]!r} is not a name: at most {MAX_TEXT} letters, digits and "
            "_, a letter first"
        )
    if len(set(names)) < len(names):
        raise InputError(f"cameras: a name is given twice: {', '.join(names)}")
    if not at_least <= len(names) <= MAX_CAMERAS:
        raise InputError(f"cameras: {len(names)} given, there must be {at_least} to {MAX_CAMERAS}")
    return names


def settings_from(values: Mapping[str, Any], *, node_name: str) -> Settings:
    """Settings from the values of all parameters by name.

    Parameters
    ----------
    values : mapping
    node_name : str
        Fully qualified; gives the results folder its name.

    Raises
    ------
    InputError
        A value cannot be used.
    """
    names = require_camera_names(values[CAMERAS.name])
    for name, value in values.items():
        if not isinstance(value, str):
            continue
        if len(value) > MAX_PARAMETER_TEXT:
            raise InputError(
                f"{name}: expected at most {MAX_PARAMETER_TEXT} characters, got {len(value)}"
            )
        if not value.replace("\n", " ").isprintable():
            raise InputError(f"{name}: expected printable characters, got {value!r}")
    options = _options(values)
    if options.reference is not None and options.reference not in names:
        raise InputError(
            f"reference: {options.reference!r} is none of the cameras {', '.join(names)}"
        )
    limits = Limits(
        **{f: values[f] for f in ("window_s", "max_images", "max_mb", "max_persons", "max_joints")}
    )
    watch = ("watch", "auto_recalibrate")
    own = ("queue_depth", "auto_calibrate", "min_motion_s", "period_s", "keep_results")
    initial = values["initial_calibration"]
    tf = ("publish_tf", "tf_not_metric", "tf_suffix", "view_frame")
    return Settings(
        cameras=_cameras(names, values),
        limits=limits,
        options=options,
        thresholds=Thresholds(values["watch_rotation_deg"], 1e-3 * values["watch_clock_ms"]),
        results_folder=_folder(values["results_folder"], node_name),
        initial_calibration=_path(initial, "initial_calibration") if initial else None,
        set_camera_info={name: values[f"camera.{name}.set_camera_info"] for name in names},
        **{name: values[name] for name in (*own, *watch, *tf)},
    )


def _options(values: Mapping[str, Any]) -> Options:
    nested: dict[str, Any] = {}
    for spec in OPTION_SPECS:
        group, _, name = spec.name.rpartition(".")
        (nested.setdefault(group, {}) if group else nested)[name] = values[spec.name]
    distances = parse_yaml(
        nested["scale"]["distances"], "scale.distances", max_nodes=MAX_PARAMETER_VALUES
    )
    nested["scale"]["distances"] = () if distances is None else distances
    return options_from_mapping(nested | {"reference": nested["reference"] or None})


def _cameras(names: Iterable[str], values: Mapping[str, Any]) -> tuple[SelectedCamera, ...]:
    cameras = tuple(_camera(name, values) for name in names)
    require_lens_groups({camera.name: camera.lens for camera in cameras})
    kinds: dict[str, str] = {}
    for camera in cameras:
        if (other := kinds.setdefault(camera.pose_topic, camera.pose_type)) != camera.pose_type:
            raise InputError(
                f"camera.{camera.name}.pose_type: {camera.pose_topic} cannot be both {other} and "
                f"{camera.pose_type}"
            )
    return cameras


def _camera(name: str, values: Mapping[str, Any]) -> SelectedCamera:
    path = f"camera.{name}"
    keys = ("pose_topic", "info_topic", "frame", "line_time_s")
    pose_topic, info_topic, frame, line_s = (values[f"{path}.{key}"] for key in keys)
    said = {key: values[f"{path}.{key}"] or None for key in LENS_KEYS}
    size = list(values[f"{path}.image_size"])
    said["image_size"] = size if any(size) else None
    lens = lens_settings(said, path)
    pose_type, known = values[f"{path}.pose_type"], types_of(Content.POSES)
    if pose_type not in known:
        raise InputError(f"{path}.pose_type: expected {' or '.join(known)}, got {pose_type!r}")
    if TYPES[pose_type].topic_per_person:
        pose_topic = _topic_of_people(f"{path}.pose_topic", name, pose_topic, pose_type)
    return SelectedCamera(name, pose_topic, info_topic, frame or None, line_s, lens, pose_type)


def _topic_of_people(path: str, name: str, given: str, pose_type: str) -> str:
    """Topic with a ``*`` in place of the person's id; by convention if it was not given."""
    known = TYPES[pose_type]
    usual = "/".join(("", name, *known.node, "*", known.topics[0]))
    if given == f"/{name}/{DEFAULT_POSES}":
        return usual
    if given.count("*") != 1 or given.split("/")[-2:-1] != ["*"]:
        raise InputError(
            f"{path}: every person of {pose_type} has a topic of their own; expected * in place of "
            f"the id, as in {usual}, got {given!r}"
        )
    return given


def _folder(given: str, node_name: str) -> Path:
    home = Path(os.environ.get("ROS_HOME") or "~/.ros")
    return _path(
        given or home / "stcalib_ros" / node_name.strip("/").replace("/", "."), "results_folder"
    )


def _path(given: str | Path, name: str) -> Path:
    try:
        return Path(given).expanduser()
    except RuntimeError as error:
        raise InputError(f"{name}: {error}: give a path without ~") from error


def declare(node: Any) -> dict[str, Any]:
    """Declare all parameters on a node and return their values.

    Raises
    ------
    InputError
        A value that was given has the wrong type or is out of its range, or there is no such
        parameter.
    """
    values = {CAMERAS.name: declared(node, CAMERAS)}
    names = require_camera_names(values[CAMERAS.name])
    values |= {spec.name: declared(node, spec) for spec in all_specs(names)}
    require_known(node)
    return values


def require_known(node: Any) -> None:
    """Demand that every parameter that was given is one that the node has declared.

    Raises
    ------
    InputError
        One is not, or a file of parameters has none of this node.
    """
    given = node._parameter_overrides  # there is no public list of them
    files = [file for word, file in pairwise(sys.argv) if word == "--params-file"]
    if files and not given:
        name = node.get_fully_qualified_name()
        raise InputError(
            f"{', '.join(files)} has no parameters of {name}: they stand under {name}: or /**:, "
            "and there under ros__parameters:"
        )
    unknown = [
        name
        for name in given
        if not node.has_parameter(name) and not name.startswith(_QOS_OVERRIDES)
    ]
    if unknown:
        near = did_you_mean(unknown[0], node.get_parameters_by_prefix(""))
        raise InputError(f"unknown parameter {unknown[0]}{near or ': see `ros2 param list`'}")


def declared(node: Any, spec: Spec) -> Any:
    """Declare one parameter on a node and return its value.

    Raises
    ------
    InputError
        The value that was given has the wrong type or is out of its range.
    """
    from rclpy.exceptions import ParameterException

    try:
        return node.declare_parameter(spec.name, spec.default, _descriptor(spec)).value
    except ParameterException as error:
        raise InputError(f"parameter {spec.name}: {error}") from None


def _descriptor(spec: Spec) -> Any:
    from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor

    descriptor = ParameterDescriptor(description=spec.text, read_only=spec.fixed)
    if isinstance(spec.default, float) and spec.low is not None:
        bounds = FloatingPointRange(from_value=spec.low, to_value=spec.high)
        descriptor.floating_point_range = [bounds]
    elif spec.low is not None:
        descriptor.integer_range = [IntegerRange(from_value=spec.low, to_value=spec.high)]
    return descriptor
