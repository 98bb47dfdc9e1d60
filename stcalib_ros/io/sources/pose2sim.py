"""A Pose2Sim project.

::

    PROJECT/Config.toml                       [project] frame_rate: a number, or "auto": the videos'
    PROJECT/pose/cam01_json/cam01_000000.json OpenPose's form
    PROJECT/calibration/Calib_*.toml          lenses; also in the folder above, of a batch of trials
    PROJECT/videos/cam01.mp4

Cameras and lenses belong together by their names, or else in their order, as in Pose2Sim.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.recording import Intrinsics
from stcalib_ros.io.lens_formats.toml import toml_lenses
from stcalib_ros.io.sources.cameras import natural_order, with_suffix
from stcalib_ros.io.sources.form import CameraPoses, PoseFormat, PoseSource
from stcalib_ros.io.sources.openpose import read_openpose
from stcalib_ros.io.sources.videos import with_videos
from stcalib_ros.io.toml_files import read_toml

_CONFIG = "Config.toml"


def is_pose2sim(path: Path, files: Sequence[Path]) -> bool:
    """Whether a folder, or one in it, has poses beside a configuration or a calibration."""
    del files
    return bool(_trials(path))


def _trials(path: Path) -> list[Path]:
    """Return the folder itself if it is that of a trial, or the trials of a batch."""
    if not path.is_dir() or _is_trial(path):
        return [path] if path.is_dir() else []
    return [folder for folder in sorted(path.iterdir()) if _is_trial(folder)]


def _is_trial(path: Path) -> bool:
    return (path / "pose").is_dir() and bool(_configs(path) or _calibrations(path))


def _configs(path: Path) -> list[Path]:
    return [f / _CONFIG for f in _levels(path) if (f / _CONFIG).is_file()]


def _calibrations(path: Path) -> list[Path]:
    return [file for f in _levels(path) for file in _toml_files(f / "calibration")]


def _toml_files(folder: Path) -> list[Path]:
    return with_suffix(sorted(folder.iterdir()), ".toml") if folder.is_dir() else []


def _levels(path: Path) -> tuple[Path, ...]:
    """Return the folder of a trial, and of the batch that it is part of."""
    return path, path.absolute().parent


def read_pose2sim(path: Path, files: Sequence[Path]) -> PoseSource:
    """Read the poses of all cameras, with lenses and frame rate.

    Raises
    ------
    InputError
        A file has another form, or it is a batch of several trials.
    """
    trials = _trials(path) or [path]
    if len(trials) > 1:
        names = ", ".join(trial.name for trial in trials)
        raise InputError(f"{path} has {len(trials)} trials of Pose2Sim: name one: {names}")
    (path,) = trials
    folder = path / "pose"
    source = read_openpose(folder, [file for file in files if file.is_relative_to(folder)])
    cameras = sorted(source.cameras, key=lambda camera: natural_order(camera.name))
    fps = next(filter(None, (_frame_rate(file) for file in _configs(path))), None)
    with_rate = [replace(camera, fps=fps) for camera in cameras]
    filmed = with_videos(with_rate, path / "videos")
    lenses = _lenses(_calibrations(path), filmed)
    found = tuple(replace(camera, lens=lenses.get(camera.name)) for camera in filmed)
    return PoseSource(path, found)


def _frame_rate(config: Path) -> float | None:
    project = read_toml(config).get("project")
    rate = project.get("frame_rate") if isinstance(project, Mapping) else None
    return float(rate) if isinstance(rate, int | float) else None


def _lenses(files: Sequence[Path], cameras: Sequence[CameraPoses]) -> Mapping[str, Intrinsics]:
    """Return lenses by the names of cameras, or in their order; none where neither fits."""
    if not files:
        return {}
    content = read_toml(files[0])
    named = toml_lenses(content, str(files[0]))
    if all(camera.name in named for camera in cameras):
        return named
    tables = [t for t in content.values() if isinstance(t, Mapping) and "matrix" in t]
    if len(tables) != len(cameras):
        return {}
    ordered = [toml_lenses({"0": table}, str(files[0]))["0"] for table in tables]
    return {camera.name: lens for camera, lens in zip(cameras, ordered, strict=True)}


POSE2SIM = PoseFormat(
    "a Pose2Sim project: pose/, Config.toml, calibration/", is_pose2sim, read_pose2sim
)
