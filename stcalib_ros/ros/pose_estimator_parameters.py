"""Parameters of the pose estimator."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stcalib_ros.core.errors import InputError
from stcalib_ros.ros.parameter_specs import CAMERAS, Spec, node_help
from stcalib_ros.ros.parameters import declared, require_camera_names, require_known

IMAGE_TYPES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
"""Types of topics that are read."""

_TOPIC = re.compile(r"[/~\w{}]+", re.ASCII)

ESTIMATOR_SPECS = (
    Spec(
        "estimator",
        "movenet",
        "One of `stcalib models`, or module:function of your own.",
        fixed=True,
    ),
    Spec("size", 0, "Longer side of the network's input, px; 0: its own.", 0, 4096, fixed=True),
    Spec("workers", 2, "Images that are estimated at a time, a core each.", 1, 64, fixed=True),
    Spec("threads", 1, "Threads of one image.", 1, 64, fixed=True),
    Spec("models_folder", "", "Folder of the weights; empty: the usual one.", fixed=True),
    Spec(
        "rate_hz",
        10.0,
        "Images of each camera that are used, 1/s; 0: all.",
        0.0,
        1000.0,
        fixed=True,
    ),
    Spec("min_score", 0.3, "Joints with a lower score are not followed.", 0.0, 1.0, fixed=True),
    Spec("mend_sides", True, "Exchange left and right back where they jump.", fixed=True),
)


@dataclass(frozen=True, slots=True)
class ImageCamera:
    """A camera whose images are read; an empty `image_type` is that of the publisher."""

    name: str
    image_topic: str
    image_type: str
    pose_topic: str


@dataclass(frozen=True, slots=True)
class EstimatorSettings:
    """What the parameters say; attributes as in `ESTIMATOR_SPECS`.

    Attributes
    ----------
    size : int or None
    models_folder : Path or None
    """

    cameras: tuple[ImageCamera, ...]
    estimator: str
    size: int | None
    workers: int
    threads: int
    models_folder: Path | None
    rate_hz: float
    min_score: float
    mend_sides: bool


def image_camera_specs(name: str) -> tuple[Spec, ...]:
    """Parameters of one camera.

    Examples
    --------
    >>> [spec.default for spec in image_camera_specs("cam0")]
    ['/cam0/image_raw', '', '/cam0/person_poses']
    """
    return (
        Spec(f"camera.{name}.image_topic", f"/{name}/image_raw", "Its images.", fixed=True),
        Spec(
            f"camera.{name}.image_type",
            "",
            f"{' or '.join(IMAGE_TYPES)}; empty: that of the publisher.",
            fixed=True,
        ),
        Spec(f"camera.{name}.pose_topic", f"/{name}/person_poses", "Its poses.", fixed=True),
    )


def estimator_specs(cameras: Iterable[str]) -> tuple[Spec, ...]:
    """All parameters but `CAMERAS`."""
    return (*(spec for name in cameras for spec in image_camera_specs(name)), *ESTIMATOR_SPECS)


def estimator_help() -> str:
    """Return what the pose estimator prints if it is asked for help."""
    what = "Finds the people in the images of all cameras, and publishes their poses."
    return node_help("pose_estimator", what, (CAMERAS, *estimator_specs(["CAMERA"])))


def declare_estimator(node: Any) -> EstimatorSettings:
    """Declare all parameters on a node and return what they say.

    Raises
    ------
    InputError
        A value has the wrong type, is out of its range or cannot be used, or there is no such
        parameter.
    """
    names = require_camera_names(declared(node, CAMERAS), at_least=1)
    values = {spec.name: declared(node, spec) for spec in estimator_specs(names)}
    require_known(node)
    return estimator_settings(names, values)


def estimator_settings(names: Iterable[str], values: Mapping[str, Any]) -> EstimatorSettings:
    """Settings from the values of `estimator_specs`.

    Raises
    ------
    InputError
        A value cannot be used.
    """
    cameras = tuple(_camera(name, values) for name in names)
    for what in ("image_topic", "pose_topic"):
        topics = [getattr(camera, what) for camera in cameras]
        if twice := next((t for t in topics if topics.count(t) > 1), None):
            raise InputError(f"camera.*.{what}: {twice} is given twice; each camera has its own")
    folder = values["models_folder"]
    same = ("estimator", "workers", "threads", "rate_hz", "min_score", "mend_sides")
    return EstimatorSettings(
        cameras=cameras,
        size=values["size"] or None,
        models_folder=Path(folder).expanduser() if folder else None,
        **{name: values[name] for name in same},
    )


def _camera(name: str, values: Mapping[str, Any]) -> ImageCamera:
    path = f"camera.{name}"
    image, kind, poses = (
        values[f"{path}.{key}"] for key in ("image_topic", "image_type", "pose_topic")
    )
    if kind and kind not in IMAGE_TYPES:
        raise InputError(f"{path}.image_type: expected {' or '.join(IMAGE_TYPES)}, got {kind!r}")
    for key, topic in (("image_topic", image), ("pose_topic", poses)):
        if not _TOPIC.fullmatch(topic):
            raise InputError(f"{path}.{key}: {topic!r} is not the name of a topic")
    return ImageCamera(name, image, kind, poses)
