"""The configuration file of ``stcalib calibrate`` and ``replay``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.options import Options, options_from_mapping
from stcalib_ros.io.topics import CameraSelection, selection_from_mapping
from stcalib_ros.io.yaml_files import read_yaml


@dataclass(frozen=True, slots=True)
class Config:
    """What a configuration file says.

    Attributes
    ----------
    options : Options
    selection : CameraSelection
    """

    options: Options = field(default_factory=Options)
    selection: CameraSelection = field(default_factory=CameraSelection)


def read_config(path: Path) -> Config:
    """Read a configuration file: the options of the calibration, ``cameras`` and ``camera``.

    ``cameras`` is a list of names, ``camera`` a mapping by name to ``pose_topic``, ``info_topic``,
    ``frame`` and ``line_time_s``. Whatever is left out has its default.

    Raises
    ------
    InputError
        The file cannot be read or has an entry that is unknown or unusable.
    """
    content = read_yaml(path)
    if content is None:
        return Config()
    if not isinstance(content, Mapping):
        raise InputError(f"{path}: expected NAME: VALUE lines, got {content!r}")
    options = {str(k): v for k, v in content.items() if k not in ("cameras", "camera")}
    try:
        return Config(
            options_from_mapping(options),
            selection_from_mapping(content.get("cameras"), content.get("camera")),
        )
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
