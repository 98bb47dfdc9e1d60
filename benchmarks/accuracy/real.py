"""Real recordings with a known calibration: the demo, and keypoints without 3D poses.

The clocks of all of them are shifted by known amounts, which the calibration has to find.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import stcalib_ros
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.lens_knowledge import LensKnowledge
from stcalib_ros.core.model.recording import CameraRecording, only_images
from stcalib_ros.core.options import LensOptions
from stcalib_ros.io.bag import read_bag
from stcalib_ros.io.convert import Converted, ConvertOptions, convert_arrays
from stcalib_ros.io.results import read_result

DATA = Path(__file__).parents[1] / "data"
BALANCE = DATA / "pose2sim_balance" / "balance_openpose.npz"
DESK = DATA / "desk_webcams" / "desk_webcams.npz"

BALANCE_FPS = 60.0
"""Frame rate of the demo and of the recording that it was made of, Hz; from its source."""
DESK_FPS = 30.0
"""Nominal frame rate of the webcams at the desk, Hz; their own stamps have a median of 30.3."""

BALANCE_SHIFTS_S = {"cam02": 0.317, "cam03": -0.210, "cam04": 0.143}
"""Seconds added to the stamps: -19.02, 12.6 and -8.58 frames, as in the demo."""
DESK_SHIFTS_S = {"cam_1": 0.251, "cam_2": -0.487, "cam_3": 0.147}
"""Seconds added to the stamps: no whole frames, up to half a second. Chosen."""

_WOMAN = 1
"""Number of the computer-generated woman among the true persons of `BALANCE`; from its source."""


@dataclass(frozen=True, slots=True)
class RealCase:
    """A real recording with the errors that are accepted.

    Attributes
    ----------
    name, title : str
    read : callable
        Returns recording and truth.
    fps : float
        Frame rate for errors of time offsets, Hz.
    limits : mapping of str to float
        Largest accepted "E_R" (rad), "centres m" and "offset frames" (of the worst camera).
    may_refuse : bool
        Whether refusing counts as much as solving.
    wrong : mapping of str to float
        Errors from which on a result with status OK counts as wrong: what no truth of these
        recordings can explain.
    lens : LensOptions
        Where lenses are estimated.
    """

    name: str
    title: str
    read: Callable[[], Converted]
    fps: float
    limits: Mapping[str, float]
    may_refuse: bool = False
    wrong: Mapping[str, float] = field(default_factory=lambda: {"E_R": 0.07, "offset frames": 3.0})
    lens: LensOptions = field(default_factory=LensOptions)


def read_demo() -> Converted:
    """Return the demo of the package, with its 3D poses."""
    folder = Path(stcalib_ros.__file__).parent / "data" / "demo"
    return Converted(read_bag(folder / "balance.mcap"), read_result(folder / "balance_truth.yaml"))


def read_balance(*, with_woman: bool = True) -> Converted:
    """Return the keypoints of OpenPose of the recording that the demo was made of."""
    arrays = _load(BALANCE)
    if not with_woman:
        kept = arrays["det_person"] != _WOMAN
        arrays |= {name: arrays[name][kept] for name in arrays if name.startswith("det_")}
    return _converted(BALANCE, arrays, ConvertOptions(BALANCE_SHIFTS_S))


def read_balance_one() -> Converted:
    """Return the same without the woman."""
    return read_balance(with_woman=False)


def read_desk() -> Converted:
    """Return the man at a desk, with the times at which each camera took its images."""
    arrays = _load(DESK)
    recording, truth = _converted(DESK, arrays, ConvertOptions(DESK_SHIFTS_S))
    zero = recording.cameras[0].stamps[0]
    cameras = tuple(
        _with_times(
            camera, zero + arrays["camera_time"][:, c] + DESK_SHIFTS_S.get(camera.name, 0.0)
        )
        for c, camera in enumerate(recording.cameras)
    )
    return Converted(replace(recording, cameras=cameras), truth)


def _with_times(camera: CameraRecording, stamps: Float64Array) -> CameraRecording:
    """Return a camera with other stamps, without the images that have none."""
    return only_images(replace(camera, stamps=stamps), np.isfinite(stamps))


def _load(path: Path) -> dict[str, NDArray[Any]]:
    with np.load(path, allow_pickle=False) as archive:
        return {name: archive[name] for name in archive.files}


def _converted(path: Path, arrays: dict[str, NDArray[Any]], options: ConvertOptions) -> Converted:
    """Convert arrays without 3D poses."""
    unknown = np.full(arrays["det_kp2d"].shape, np.nan, dtype=np.float32)
    return convert_arrays(path, arrays | {"det_kp3d": unknown}, options)


DEMO = RealCase(
    "demo",
    "four real cameras, BlazePose, clocks shifted",
    read_demo,
    BALANCE_FPS,
    {"E_R": 0.07, "centres m": 0.25, "offset frames": 3.0},
)
"""With 3D poses; its truth is accurate to 0.035 to 0.05 rad."""

DEMO_2D = replace(DEMO, limits={"E_R": 0.05, "centres m": 0.25, "offset frames": 1.0})
"""Without them."""

KEYPOINT_CASES = (
    RealCase(
        "balance two",
        "man, woman and bystander, four real cameras, OpenPose, 1.67 s, clocks shifted",
        read_balance,
        BALANCE_FPS,
        {"E_R": 0.02, "offset frames": 0.5},
    ),
    RealCase(
        "balance one",
        "the same without the woman",
        read_balance_one,
        BALANCE_FPS,
        {"E_R": 0.05, "offset frames": 0.5},
    ),
    RealCase(
        "desk",
        "a seated man, four webcams at a desk, MediaPipe, clocks shifted",
        read_desk,
        DESK_FPS,
        {"E_R": 0.07, "offset frames": 2.0},
        may_refuse=True,
    ),
)
"""Real recordings without 3D poses. Errors of `balance` are those that the project asks for; those
of `desk` are what its keypoints, 9 to 19 px off, can show."""

_FOCAL = {"E_f": 0.04}
"""Largest accepted relative error of the focal lengths of `DEMO`. From the project's requirements;
its truth is a calibration by a board."""
_ONE_MODEL = LensOptions(shared=True)
_ASKED = {**_FOCAL, "E_R": 0.06}
_INFORMATIVE = tuple(replace(case, limits={}, may_refuse=True) for case in KEYPOINT_CASES)

REAL_LENSES: Mapping[LensKnowledge, Mapping[str, tuple[RealCase, ...]]] = {
    LensKnowledge.UNKNOWN: {
        "3d": (replace(DEMO, limits={**DEMO.limits, **_ASKED}, lens=_ONE_MODEL),),
        "2d": (
            replace(DEMO_2D, limits={**DEMO_2D.limits, **_ASKED}, lens=_ONE_MODEL),
            *_INFORMATIVE,
        ),
    },
    LensKnowledge.REFINE: {
        "3d": (replace(DEMO, limits={}),),
        "2d": tuple(replace(case, limits={}) for case in (DEMO_2D, *KEYPOINT_CASES)),
    },
}
"""The same with lenses that are estimated. From given ones on, errors are compared with those of
these; where none is known, recordings other than `DEMO` are for information. The cameras of the
demo are of one model, and said to be."""
