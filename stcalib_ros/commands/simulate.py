"""``stcalib simulate``: a bag with a known answer."""

from __future__ import annotations

import argparse
from dataclasses import Field, fields, replace
from pathlib import Path
from typing import Any

from stcalib_ros.commands.bag_and_truth import (
    add_output_arguments,
    require_outputs,
    write_outputs,
    written_plain,
    written_text,
)
from stcalib_ros.commands.terminal import tell
from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.recording import Recording, keypoints_only, unknown_intrinsics
from stcalib_ros.core.synthetic import BIAS_FORMS, LENS_MODELS, PEOPLE, SceneOptions, simulate
from stcalib_ros.io.mocap import shipped_clips
from stcalib_ros.io.rigs import read_rig

DESCRIPTION = """\
Make a bag of simulated people who walk about in view of cameras, and a file with the true values.
Pose estimators, lenses and clocks have realistic errors.

  stcalib simulate scene.mcap --truth scene_truth.yaml --n-cameras 6 --seed 3
  stcalib simulate flat.mcap --truth flat_truth.yaml --keypoints-only
  stcalib simulate free.mcap --truth free_truth.yaml --unknown-lenses
"""

_HELP = {
    "n_cameras": "number of cameras",
    "n_people": "number of people",
    "n_frames": "length of the recording, in frames of the first camera",
    "people": "how people move",
    "area_radius_m": "people stay within about this distance from the middle",
    "fps": "frame rate: one, or one per camera",
    "image_size": "width and height, px",
    "focal_px": "focal length: one, or one per camera",
    "lens_model": "model of the lenses",
    "distortion": "coefficients of that model in OpenCV's order",
    "principal_point_px": "standard deviation of principal points about the middle of the image",
    "ring_radius_m": "least and largest distance of cameras from the middle",
    "ring_height_m": "least and largest height of cameras",
    "rig": "JSON file of given cameras (name, image_size, K, dist, R, t) instead of a ring",
    "rig_scale": "factor by which the rig is enlarged",
    "max_offset_frames": "largest time offset, in frames of the first camera",
    "skew_ppm": "largest clock skew",
    "stamp_jitter_s": "timestamp jitter, standard deviation",
    "drop_rate": "fraction of images that are lost",
    "line_time_s": "rolling shutter, seconds per image row: one, or one per camera",
    "sigma_px": "noise of keypoints, per axis",
    "keypoint_bias_mm": "systematic displacement of keypoints, rms",
    "keypoint_bias_form": "how that displacement depends on view and pose",
    "lifter_mm": "least and largest mean joint error of 3D poses",
    "lifter_depth_ratio": "ratio of joint errors along the optical axis to those across it",
    "tilt_deg": "slow tilt of 3D poses, rms",
    "crop_perspective": "fraction of the error that 3D poses from crops of the image have",
    "scale_error": "standard deviation of the 3D size of a person",
    "flip_rate": "fraction of frames with left and right exchanged",
    "missing": "fraction of frames in which a camera misses a person",
    "occlusions": "whether people hide each other",
    "bursts_per_10s": "times that a person is lost for a moment, per camera",
    "id_switches_per_10s": "exchanges of track ids, per person and camera",
    "seed": "random seed: the same seed gives the same scene",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command: one for every field of `SceneOptions`."""
    add_output_arguments(parser)
    parser.add_argument(
        "--keypoints-only",
        action="store_true",
        help="no camera has 3D poses, as from 2D pose estimators",
    )
    parser.add_argument(
        "--keypoints-only-of",
        action="append",
        metavar="CAM",
        help="this camera has no 3D poses; may be repeated",
    )
    parser.add_argument(
        "--unknown-lenses",
        action="store_true",
        help="K of every CameraInfo is zero, as from drivers without a calibration file",
    )
    for field in fields(SceneOptions):
        flag = f"--{field.name.replace('_', '-')}"
        text = _HELP[field.name]
        if field.default is not None:
            default = field.default if isinstance(field.default, tuple) else (field.default,)
            text += f" (default: {' '.join(map(str, default)) or 'none'})"
        parser.add_argument(
            flag, dest=field.name, default=argparse.SUPPRESS, help=text, **_settings(field)
        )


def run(args: argparse.Namespace) -> None:
    """Simulate.

    Raises
    ------
    InputError
        An argument is unusable.
    """
    require_outputs(args)
    scene = simulate(scene_options(args), clips=shipped_clips())
    recording = _given_poses(scene.recording, args)
    if args.unknown_lenses:
        recording = _without_lenses(recording)
    write_outputs(args, recording, scene.truth)
    tell(args, written_text(args, recording), written_plain(args, recording))


def _given_poses(recording: Recording, args: argparse.Namespace) -> Recording:
    """Return the recording without the 3D poses that are not wanted."""
    if args.keypoints_only:
        return keypoints_only(recording)
    names, wanted = [camera.name for camera in recording.cameras], args.keypoints_only_of or []
    if unknown := [name for name in wanted if name not in names]:
        raise InputError(
            f"--keypoints-only-of {unknown[0]}: no such camera; there are {', '.join(names)}"
        )
    return keypoints_only(recording, wanted)


def _without_lenses(recording: Recording) -> Recording:
    lenses = [camera.intrinsics for camera in recording.cameras]
    unknown = [unknown_intrinsics(lens.width, lens.height) for lens in lenses]
    pairs = zip(recording.cameras, unknown, strict=True)
    return replace(recording, cameras=tuple(replace(c, intrinsics=lens) for c, lens in pairs))


def scene_options(args: argparse.Namespace) -> SceneOptions:
    """Build the options of parsed arguments.

    Raises
    ------
    InputError
        A value is out of range, or the rig cannot be read.
    """
    given = {f.name: getattr(args, f.name) for f in fields(SceneOptions) if f.name in args}
    given = {name: tuple(v) if isinstance(v, list) else v for name, v in given.items()}
    for name in ("fps", "line_time_s", "focal_px"):
        if len(values := given.get(name, ())) == 1:
            given[name] = values[0]
    if "rig" in given:
        given["rig"] = read_rig(given["rig"])
    return SceneOptions(**given)


def _settings(field: Field[Any]) -> dict[str, Any]:
    """How argparse reads a field."""
    special: dict[str, dict[str, Any]] = {
        "fps": {"nargs": "+", "type": float, "metavar": "HZ"},
        "line_time_s": {"nargs": "+", "type": float, "metavar": "S"},
        "focal_px": {"nargs": "+", "type": float, "metavar": "PX"},
        "distortion": {"nargs": "+", "type": float, "metavar": "K"},
        "lens_model": {"choices": LENS_MODELS},
        "rig": {"type": Path, "metavar": "FILE"},
        "people": {"choices": PEOPLE},
        "keypoint_bias_form": {"choices": BIAS_FORMS},
    }
    if field.name in special:
        return special[field.name]
    if isinstance(field.default, bool):
        return {"action": argparse.BooleanOptionalAction}
    unit = field.name.rpartition("_")[2]
    metavar = unit.upper() if unit in ("m", "mm", "px", "s", "deg", "ppm", "frames") else "N"
    if isinstance(field.default, tuple):
        n = len(field.default)
        return {"nargs": n, "type": type(field.default[0]), "metavar": (metavar,) * n}
    return {"type": type(field.default), "metavar": metavar}
