"""Parameters of the live node: what there is, its range, and what may change at run time."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.monitoring.alarms import Thresholds
from stcalib_ros.core.options import Options, option_ranges, options_from_mapping
from stcalib_ros.io.topics import SelectedCamera
from stcalib_ros.io.yaml_files import parse_yaml
from stcalib_ros.ros.limits import (
    MAX_CAMERAS,
    MAX_PARAMETER_TEXT,
    MAX_PARAMETER_VALUES,
    MAX_TEXT,
    MIN_CAMERAS,
)
from stcalib_ros.ros.streams import Limits

_NAME = re.compile(r"[A-Za-z]\w*(/[A-Za-z]\w*)*", re.ASCII)


@dataclass(frozen=True, slots=True)
class Spec:
    """One parameter; `low` and `high` are its range, `fixed` ones hold from the start."""

    name: str
    default: Any
    text: str
    low: float | None = None
    high: float | None = None
    fixed: bool = False


CAMERAS = Spec(
    "cameras",
    ["cam0", "cam1"],
    "Names of the cameras; the first is the reference unless another is named.",
    fixed=True,
)

TF_SPECS = (
    Spec("publish_tf", True, "Publish the cameras on /tf_static.", fixed=True),
    Spec("tf_not_metric", False, "Also if lengths are not metres.", fixed=True),
    Spec(
        "tf_suffix",
        "",
        "Added to child frames on /tf_static, for optical frames that have a parent already.",
        fixed=True,
    ),
)

NODE_SPECS = (
    Spec("window_s", 30.0, "Time span of images kept per camera, seconds.", 2.0, 600.0),
    Spec("max_images", 6000, "Number of images kept per camera, whatever the span.", 100, 100_000),
    Spec("max_mb", 100.0, "Memory for the images of each camera, megabytes.", 1.0, 10_000.0),
    Spec("max_persons", 50, "Largest number of persons in an image.", 1, 1000),
    Spec("max_joints", 150, "Largest number of joints of a person.", 3, 1000),
    Spec("queue_depth", 50, "Messages that wait for the node, per topic.", 1, 1000, fixed=True),
    Spec("auto_calibrate", True, "Calibrate as soon as enough motion has been observed."),
    Spec(
        "min_motion_s",
        10.0,
        "Seconds of motion that each camera must share with another one.",
        1.0,
        600.0,
    ),
    Spec(
        "period_s",
        0.0,
        "Period of further calibrations, seconds of stamps; 0: none.",
        0.0,
        86_400.0,
    ),
    Spec("watch", True, "Keep checking observations against the calibration in force."),
    Spec(
        "watch_rotation_deg",
        1.0,
        "Smallest rotation of a camera that is reported, degrees.",
        0.1,
        45.0,
    ),
    Spec(
        "watch_clock_ms",
        50.0,
        "Smallest jump of a clock that is reported, milliseconds.",
        1.0,
        5000.0,
    ),
    Spec("auto_recalibrate", False, "Calibrate again when the calibration does not hold any more."),
    Spec(
        "results_folder",
        "",
        "Where calibrations are kept; empty: in ROS_HOME, by the node's name.",
        fixed=True,
    ),
    Spec("keep_results", 50, "Number of calibrations kept on disk.", 2, 1000, fixed=True),
    *TF_SPECS,
)

_OPTIONS = (
    Spec("reference", "", "Camera that gives the reference frame and clock; empty: the first."),
    Spec("offset_range_s", 2.0, "Clocks are searched within +- this; 0: they agree."),
    Spec("min_score", 0.3, "Joints with a lower score are not used."),
    Spec("min_common_frames", 12, "Number of images that two cameras must share in time."),
    Spec(
        "world_frame",
        "",
        "Frame with z up and the floor at 0 for the poses; empty: that of the reference camera.",
    ),
    Spec("estimate_line_time", False, "Estimate the line delays of rolling shutters."),
    Spec("scale.poses_sigma", 0.1, "Relative standard deviation of the size of metric 3D poses."),
    Spec("scale.body_height_m", 0.0, "Mean height of the people; 0: not known."),
    Spec("scale.body_height_sigma_m", 0.09, "Standard deviation of one person's height, metres."),
    Spec(
        "scale.distances",
        "",
        "Known distances, a list in YAML's short form as in calibrate.yaml; empty: none.",
    ),
    Spec("seed", 0, "Seed of the random numbers: same seed, same result."),
    Spec("registration.method", "correlation", "Or vmf: the paper's own method."),
    Spec("registration.min_overlap", 12, "Number of samples that two tracks must share."),
    Spec("registration.n_candidates", 16, "Number of candidates (track pair and lag) that grow."),
    Spec("registration.n_hypotheses", 12, "Number of hypotheses kept per pair of cameras."),
    Spec("registration.n_refined", 6, "Number of candidates that are refined."),
    Spec("vmf.window", 15, "Length of a window in frames, T."),
    Spec("vmf.n_windows", 20, "Largest number of windows."),
    Spec("vmf.n_hypothesised", 2, "Number of persons that RANSAC assumes visible; 0: no RANSAC."),
    Spec("vmf.initial", "random", "Initial rotations: random or candidates."),
    Spec("vmf.n_starts", 10, "Number of random initial rotations."),
    Spec(
        "vmf.search_offsets",
        True,
        "Search offsets in pairs; else estimate them in the adjustment only.",
    ),
    Spec("vmf.no_match_rad", 0.5, "Largest mean bone angle of a match, rad."),
    Spec("vmf.turn_poses", False, "Rotate poses onto their keypoints first."),
    Spec("integration.n_trees", 300, "Number of random spanning trees."),
    Spec("bundle.rounds", 5, "Number of rounds of association and adjustment."),
    Spec("bundle.max_iterations", 12, "Largest number of Levenberg-Marquardt steps per round."),
    Spec("bundle.outlier_factor", 3.0, "Outliers are beyond this multiple of the median error."),
    Spec("bundle.outlier_floor_px", 12.0, "But never within this, px."),
)

_RANGES = option_ranges()
OPTION_SPECS = tuple(
    replace(spec, **_RANGES[spec.name]._asdict()) if spec.name in _RANGES else spec
    for spec in _OPTIONS
)


@dataclass(frozen=True, slots=True)
class Settings:
    """What the parameters say; attributes as in `NODE_SPECS`."""

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
    keep_results: int
    publish_tf: bool
    tf_not_metric: bool
    tf_suffix: str


def camera_specs(name: str) -> tuple[Spec, ...]:
    """Parameters of one camera.

    Examples
    --------
    >>> [spec.default for spec in camera_specs("cam0")]
    ['/cam0/person_poses', '/cam0/camera_info', '', 0.0]
    """
    return (
        Spec(
            f"camera.{name}.pose_topic", f"/{name}/person_poses", "Topic of its poses.", fixed=True
        ),
        Spec(
            f"camera.{name}.info_topic",
            f"/{name}/camera_info",
            "Topic of its CameraInfo.",
            fixed=True,
        ),
        Spec(
            f"camera.{name}.frame",
            "",
            "Its optical frame; empty: the frame_id of the poses.",
            fixed=True,
        ),
        Spec(
            f"camera.{name}.line_time_s",
            0.0,
            "Line delay of a rolling shutter, seconds per row; 0: global shutter.",
            0.0,
            1e-3,
            fixed=True,
        ),
    )


def all_specs(cameras: Iterable[str]) -> tuple[Spec, ...]:
    """All parameters but `CAMERAS`."""
    own = [spec for name in cameras for spec in camera_specs(name)]
    return (*own, *NODE_SPECS, *OPTION_SPECS)


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
    tf = ("publish_tf", "tf_not_metric", "tf_suffix")
    return Settings(
        cameras=tuple(_camera(name, values) for name in names),
        limits=limits,
        options=options,
        thresholds=Thresholds(values["watch_rotation_deg"], 1e-3 * values["watch_clock_ms"]),
        results_folder=_folder(values["results_folder"], node_name),
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


def _camera(name: str, values: Mapping[str, Any]) -> SelectedCamera:
    pose_topic, info_topic, frame, line_s = (values[spec.name] for spec in camera_specs(name))
    return SelectedCamera(name, pose_topic, info_topic, frame or None, line_s)


def _folder(given: str, node_name: str) -> Path:
    home = Path(os.environ.get("ROS_HOME") or "~/.ros")
    folder = Path(given) if given else home / "stcalib_ros" / node_name.strip("/").replace("/", ".")
    try:
        return folder.expanduser()
    except RuntimeError as error:
        raise InputError(f"results_folder: {error}: give a path without ~") from error


def declare(node: Any) -> dict[str, Any]:
    """Declare all parameters on a node and return their values.

    Raises
    ------
    InputError
        A value that was given has the wrong type or is out of its range.
    """
    values = {CAMERAS.name: declared(node, CAMERAS)}
    names = require_camera_names(values[CAMERAS.name])
    return values | {spec.name: declared(node, spec) for spec in all_specs(names)}


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
