"""Every parameter of the live node: its name, default, range and meaning."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from stcalib_ros.core.options import option_ranges
from stcalib_ros.io.limits import MAX_VIEW_DEG
from stcalib_ros.io.message_types import PERSON_POSES


@dataclass(frozen=True, slots=True)
class Spec:
    """One parameter; `low` and `high` are its range, `fixed` ones hold from the start."""

    name: str
    default: Any
    text: str
    low: float | None = None
    high: float | None = None
    fixed: bool = False


DEFAULT_POSES = "person_poses"
"""Last part of the topic with the poses of a camera, unless another is given."""

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
    Spec(
        "queue_depth",
        50,
        "Messages that may wait for the node, of each topic.",
        1,
        1000,
        fixed=True,
    ),
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
    Spec(
        "initial_calibration",
        "",
        "Result file to start with, unless results_folder has one of later data; empty: none.",
        fixed=True,
    ),
    Spec("keep_results", 50, "Number of calibrations kept on disk.", 2, 1000, fixed=True),
    *TF_SPECS,
    Spec(
        "view_frame",
        "stcalib_view",
        "Frame on /tf_static to look at markers from, z up; empty: none.",
        fixed=True,
    ),
)

_OPTIONS = (
    Spec("reference", "", "Camera that gives the reference frame and clock; empty: the first."),
    Spec("offset_range_s", 2.0, "Clocks are searched within +- this; 0: they agree."),
    Spec(
        "align",
        "auto",
        "Added to stamps first: auto, starts, stamps, seconds (not of the reference), CAM=S,...",
    ),
    Spec("min_score", 0.3, "Joints with a lower score are not used."),
    Spec("min_common_frames", 12, "Number of images that two cameras must share in time."),
    Spec(
        "world_frame",
        "",
        "Frame with z up and the floor at 0 for the poses; empty: that of the reference camera.",
    ),
    Spec("estimate_line_time", False, "Estimate the line delays of rolling shutters."),
    Spec(
        "intrinsics",
        "given",
        "What CameraInfo is worth: given; refine, estimated from there on; unknown, only the size.",
    ),
    Spec("lens.focal_stddev", 0.1, "Relative standard deviation of a focal length to refine."),
    Spec(
        "lens.principal_point_stddev",
        0.005,
        "Standard deviation of a principal point, fraction of the width of the image.",
    ),
    Spec("lens.radial_terms", 1, "Coefficients of radial distortion that are estimated."),
    Spec("lens.shared", False, "All cameras have one lens: cameras of one model."),
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


def camera_specs(name: str) -> tuple[Spec, ...]:
    """Parameters of one camera.

    Examples
    --------
    >>> [spec.default for spec in camera_specs("cam0")][:4]
    ['/cam0/person_poses', '/cam0/camera_info', '', 0.0]
    """
    specs = (
        Spec("pose_topic", f"/{name}/{DEFAULT_POSES}", "Topic of its poses."),
        Spec("info_topic", f"/{name}/camera_info", "Topic of its CameraInfo."),
        Spec("frame", "", "Its optical frame; empty: the frame_id of the poses."),
        Spec(
            "line_time_s",
            0.0,
            "Line delay of a rolling shutter, seconds per row; 0: global shutter.",
            0.0,
            1e-3,
        ),
        Spec("pose_type", PERSON_POSES.name, "Type of pose_topic, of those that are read."),
        Spec("intrinsics", "", "Of this camera; empty: as the parameter intrinsics has it."),
        Spec("lens_group", "", "Cameras of one group have one lens; empty: a lens of its own."),
        Spec(
            "field_of_view_deg",
            0.0,
            "Horizontal, by a data sheet, degrees: refine starts from it without K; 0: not known.",
            0.0,
            MAX_VIEW_DEG,
        ),
        Spec("image_size", [0, 0], "Width and height, px, where there is no CameraInfo."),
        Spec(
            "set_camera_info",
            "",
            "Service by which its driver takes the lens that was estimated; empty: not called.",
        ),
    )
    return tuple(replace(spec, name=f"camera.{name}.{spec.name}", fixed=True) for spec in specs)


def all_specs(cameras: Iterable[str]) -> tuple[Spec, ...]:
    """All parameters but `CAMERAS`."""
    own = [spec for name in cameras for spec in camera_specs(name)]
    return (*own, *NODE_SPECS, *OPTION_SPECS)


def help_asked(words: Sequence[str]) -> bool:
    """Whether a node is only asked what it does; what follows ``--ros-args`` is for ROS."""
    own = itertools.takewhile(lambda word: word != "--ros-args", words)
    return not {"-h", "--help"}.isdisjoint(own)


def node_help(node: str, what: str, specs: Iterable[Spec]) -> str:
    """Return what a node does, how it is configured, and all its parameters.

    Parameters
    ----------
    node : str
        Name of the executable, and of the node.
    what : str
        One sentence.
    specs : iterable of Spec
    """
    rows = [
        f"  {spec.name} ({spec.default!r}{', fixed' if spec.fixed else ''})\n      {spec.text}"
        for spec in specs
    ]
    return "\n".join(
        [
            f"usage: ros2 run stcalib_ros {node} --ros-args --params-file {node}.yaml",
            "",
            what,
            "",
            f"Write parameters to {node}.yaml, under `{node}: ros__parameters:`.",
            f"config/{node}.yaml of the package has all of them, with their defaults. Those that",
            f"are not fixed can be changed while the node runs: ros2 param set /{node} NAME VALUE.",
            "",
            *rows,
        ]
    )


def calibrator_help() -> str:
    """Return what the live node prints if it is asked for help."""
    what = "Calibrates cameras from live topics, and watches whether the result still holds."
    return node_help("calibrator", what, (CAMERAS, *all_specs(["CAMERA"])))
