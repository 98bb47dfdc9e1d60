"""Parameters of the live node; without ROS."""

from __future__ import annotations

import re
from array import array
from pathlib import Path

import pytest
import yaml
from plain import CAMERA

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.lens_knowledge import LensKnowledge
from stcalib_ros.core.options import LensOptions, Options
from stcalib_ros.io.lens_settings import LensSettings
from stcalib_ros.ros.parameter_specs import CAMERAS, all_specs
from stcalib_ros.ros.parameters import settings_from
from stcalib_ros.ros.streams import Limits

ROOT = Path(__file__).parents[2]


def defaults(cameras: tuple[str, ...] = ("cam0", "cam1")) -> dict[str, object]:
    return {CAMERAS.name: list(cameras)} | {s.name: s.default for s in all_specs(cameras)}


def test_the_parameter_file_has_every_parameter_with_its_default():
    content = yaml.safe_load((ROOT / "config" / "calibrator.yaml").read_text())
    found: dict[str, object] = {}

    def flatten(values: dict, path: str) -> None:
        for key, value in values.items():
            if isinstance(value, dict):
                flatten(value, f"{path}{key}.")
            else:
                found[f"{path}{key}"] = value

    flatten(content["/**"]["ros__parameters"], "")
    assert found == defaults()
    assert {k: type(v) for k, v in found.items()} == {k: type(v) for k, v in defaults().items()}


def test_fixed_parameters_are_said_to_be():
    text = (ROOT / "config" / "calibrator.yaml").read_text()
    fixed = set(re.findall(r"^    (\w+):.*\(fixed\)", text, re.MULTILINE))
    assert fixed == {spec.name for spec in (CAMERAS, *all_specs(())) if spec.fixed}


def test_defaults_calibrate_as_the_command_line_does(monkeypatch):
    monkeypatch.setenv("ROS_HOME", "/ros_home")
    settings = settings_from(defaults(), node_name="/site/calibrator")
    assert settings.options == Options()
    assert settings.limits == Limits()
    assert settings.cameras[0] == CAMERA
    assert settings.results_folder == Path("/ros_home/stcalib_ros/site.calibrator")


def test_every_option_has_a_parameter():
    def leaves(options: object, path: str = "") -> set[str]:
        out: set[str] = set()
        for name in options.__dataclass_fields__:  # type: ignore[attr-defined]
            value = getattr(options, name)
            nested = hasattr(value, "__dataclass_fields__")
            out |= leaves(value, f"{path}{name}.") if nested else {path + name}
        return out

    assert leaves(Options()) <= set(defaults())


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"cameras": ["cam0"]}, "1 given"),
        ({"cameras": ["cam0", "cam0"]}, "twice"),
        ({"cameras": ["cam0", "a b"]}, "'a b' is not a name"),
        ({"cameras": [f"c{i}" for i in range(65)]}, "65 given"),
        ({"reference": "cam7"}, "'cam7' is none of the cameras"),
        ({"intrinsics": "guess"}, "intrinsics must be one of given, refine, unknown"),
        (
            {"camera.cam1.intrinsics": "guess"},
            "cam1.intrinsics: expected given, refine or unknown",
        ),
        ({"camera.cam0.field_of_view_deg": 3.0}, "5 to 180 degrees, got 3.0"),
        ({"camera.cam0.lens_group": "gopro"}, "cam0 is alone in the group 'gopro'"),
        ({"camera.cam0.image_size": [640]}, r"expected \[width, height\]"),
        ({"camera.cam0.image_size": [640, -1]}, r"expected \[width, height\]"),
        (
            {"camera.cam0.intrinsics": "unknown", "camera.cam0.field_of_view_deg": 90.0},
            "a first guess for intrinsics: refine, not for unknown",
        ),
    ],
)
def test_unusable_parameters_say_why(changes, why):
    with pytest.raises(InputError, match=why):
        settings_from(defaults() | changes, node_name="/calibrator")


def test_a_camera_has_what_is_said_of_its_lens():
    changes = {
        "intrinsics": "refine",
        "lens.shared": True,
        "camera.cam0.intrinsics": "unknown",
        "camera.cam0.image_size": array("q", [1280, 720]),
        "camera.cam1.field_of_view_deg": 90.0,
        "camera.cam0.lens_group": "gopro",
        "camera.cam1.lens_group": "gopro",
        "camera.cam1.set_camera_info": "/cam1/set_camera_info",
    }
    settings = settings_from(defaults() | changes, node_name="/calibrator")
    assert settings.options == Options(intrinsics="refine", lens=LensOptions(shared=True))
    first, second = (camera.lens for camera in settings.cameras)
    assert first == LensSettings(LensKnowledge.UNKNOWN, "gopro", None, (1280, 720))
    assert second == LensSettings(None, "gopro", 90.0, None)
    assert settings.set_camera_info == {"cam0": "", "cam1": "/cam1/set_camera_info"}


NINEFOLD = "".join(f", &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 9))


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("scale.distances", "!!bool x", "'x' with the tag"),
        ("scale.distances", "!!float ''", "'' with the tag"),
        ("scale.distances", "!!timestamp x", "'x' with the tag"),
        (
            "scale.distances",
            f"[&a0 [x, x, x, x, x, x, x, x, x]{NINEFOLD}]",
            "more than 1000 values",
        ),
        ("scale.distances", "{" + ", ".join(f"k{i}: 1" for i in range(30_000)) + "}", "10000 char"),
        ("scale.distances", "{" + ", ".join(f"k{i}: 1" for i in range(900)) + "}", "1000 values"),
        ("scale.distances", "[" * 5000, "not valid YAML"),
        ("scale.distances", "[1]", "expected metres"),
        (
            "scale.distances",
            "[{cameras: [cam0, cam1], metres: .inf, sigma_m: 1}]",
            "at most 1000000",
        ),
        (
            "scale.distances",
            f"[{{cameras: [cam0, cam1], metres: 1{'0' * 60}, sigma_m: 1}}]",
            "at most 1000000",
        ),
        (
            "scale.distances",
            "[{metres: 2, sigma_m: 1, points: {a: [[.nan, 0], [1, 1]], b: [[0, 0], [1, 1]]}}]",
            "points are two pixels",
        ),
        ("world_frame", "x" * 20_000, "at most 10000 characters"),
        ("world_frame", "x" * 300, "at most 256 printable"),
        ("world_frame", "a\nb", "at most 256 printable"),
        ("world_frame", "a\0b", "expected printable characters"),
        ("results_folder", "/tmp/\x1b[31m", "expected printable characters"),
        ("results_folder", "~nobody-of-that-name/x", "results_folder: .*give a path without ~"),
        ("cameras", ["cam0", "c" * 300], "at most 256 letters"),
    ],
)
def test_no_value_of_a_parameter_does_more_than_be_refused(name, value, message):
    with pytest.raises(InputError, match=message):
        settings_from(defaults() | {name: value}, node_name="/calibrator")


def test_the_type_of_the_poses_is_one_that_is_read():
    values = defaults() | {"camera.cam1.pose_type": "yolo_msgs/msg/DetectionArray"}
    cameras = settings_from(values, node_name="/calibrator").cameras
    assert [c.pose_type for c in cameras] == [CAMERA.pose_type, "yolo_msgs/msg/DetectionArray"]
    values["camera.cam1.pose_topic"] = values["camera.cam0.pose_topic"]
    with pytest.raises(InputError, match=r"cam1\.pose_type: /cam0/person_poses cannot be both stc"):
        settings_from(values, node_name="/calibrator")
    values["camera.cam1.pose_type"] = "hri_msgs/msg/Skeleton2D"
    said = (
        r"cam1\.pose_topic: every .* expected \* in place of the id, as in /cam1/humans/bodies/\*/"
    )
    with pytest.raises(InputError, match=said):
        settings_from(values, node_name="/calibrator")
    values["camera.cam1.pose_topic"] = "/cam1/person_poses"
    _, camera = settings_from(values, node_name="/calibrator").cameras
    assert camera.pose_topic == "/cam1/humans/bodies/*/skeleton2d"
    values["camera.cam1.pose_type"] = "sensor_msgs/msg/Image"
    said = r"camera\.cam1\.pose_type: expected stcalib_ros/.* or yolo_msgs/.*, got 'sensor_msgs/"
    with pytest.raises(InputError, match=said):
        settings_from(values, node_name="/calibrator")
