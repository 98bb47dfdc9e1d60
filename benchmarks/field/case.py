"""One recording of the field: what was recorded, what is true, and what would be right to say."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cache
from pathlib import Path

from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.core.model.recording import CameraRecording, Recording
from stcalib_ros.core.options import Options
from stcalib_ros.core.synthetic import Scene, SceneOptions, simulate
from stcalib_ros.io.mocap import shipped_clips


class Answer(Enum):
    """What a calibration says of a recording, beside the truth."""

    GOOD = "good"
    ONE_SIDE = "one side"
    LEFT_OUT = "left out"
    REFUSED = "refused"
    UNNAMED = "unnamed"
    WRONG = "WRONG"


SOUND = frozenset({Answer.GOOD})
"""Only a calibration of all cameras is right."""
NAMED = frozenset({Answer.GOOD, Answer.ONE_SIDE, Answer.LEFT_OUT, Answer.REFUSED})
"""Any answer is right that is true and names what is wrong."""

CODES: Mapping[str, frozenset[str]] = {
    "A": frozenset({"CLOCK_NOT_STEADY", "CLOCK_EPOCH_DIFFERS", "PART_DISAGREES", "STAMPS_JUMP"}),
    "B": frozenset(
        {
            "FOCAL_LENGTH_ABSURD",
            "PRINCIPAL_POINT_OFF_CENTRE",
            "KEYPOINTS_OUTSIDE_IMAGE",
            "KEYPOINTS_IN_CORNER",
            "IMAGE_RESIZED",
            "IMAGE_TURNED",
            "DISTORTION_DISAGREES",
            "LENS_DEVIATES",
        }
    ),
    "C": frozenset({"POSE_CHANGED", "PART_DISAGREES"}),
    "D": frozenset({"POSES_RESCALED", "POSES_NOT_METRIC", "INCONSISTENT_SCALE"}),
    "E": frozenset({"ROTATION_UNCERTAIN", "POSITION_UNCERTAIN", "OFFSET_UNCERTAIN", "NO_PARALLAX"}),
    "F": frozenset(
        {
            "IDS_ARE_NO_TRACKS",
            "IDS_LINKED",
            "IMAGES_REPEATED",
            "MIRRORED_VIEW",
            "STREAM_FROZEN",
            "KEYPOINTS_NOT_OBSERVED",
            "KEYPOINTS_SWAPPED",
            "POSES_IN_OTHER_AXES",
            "POSES_WITH_SIDES_EXCHANGED",
            "SCORES_BELOW_LIMIT",
            "SCORES_IN_PERCENT",
        }
    ),
    "G": frozenset({"STAMPS_EVENED", "STAMPS_IN_BUNCHES", "IMAGES_LEFT_OUT", "CLOCK_NOT_STEADY"}),
    "H": frozenset(),
    "-": frozenset(),
}
"""Codes of reasons and remarks that name what is wrong, by the kind of recording."""


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """A recording and what is true of it.

    Attributes
    ----------
    recording : Recording
    truths : tuple of Calibration
        The true calibration; several, where a camera was moved: before and after.
    times_s : mapping of str to (N,) ndarray
        True time of every image of a camera, by the clock of the first camera, seconds since the
        epoch of the recording.
    options : Options
    faulty : frozenset of str
        Cameras whose input is wrong.
    metres_known : bool
        Whether the unit of the result can be judged by the truth.
    """

    recording: Recording
    truths: tuple[Calibration, ...]
    times_s: Mapping[str, Float64Array]
    options: Options = field(default_factory=Options)
    faulty: frozenset[str] = frozenset()
    metres_known: bool = True

    def camera(self, name: str) -> CameraRecording:
        """Return a camera of the recording."""
        return next(camera for camera in self.recording.cameras if camera.name == name)

    def with_camera(self, changed: CameraRecording, *, times_s: Float64Array | None = None) -> Case:
        """Return the case with another recording of one camera, which is wrong from now on."""
        cameras = tuple(
            changed if camera.name == changed.name else camera for camera in self.recording.cameras
        )
        times = dict(self.times_s) if times_s is None else {**self.times_s, changed.name: times_s}
        return replace(
            self,
            recording=replace(self.recording, cameras=cameras),
            times_s=times,
            faulty=self.faulty | {changed.name},
        )


Door = Callable[[Recording, Path], Path]
"""Writes a recording as a bag into a folder and returns its path."""


@dataclass(frozen=True, slots=True, eq=False)
class Member:
    """A kind of recording of the field.

    Attributes
    ----------
    kind : str
        Letter of the kind, "A" to "H"; "-": nothing is wrong.
    name : str
    make : callable
        Makes a case from a seed.
    right : frozenset of Answer
        Which answers are right.
    door : callable or None
        Writes the bag. Default: as this package writes it.
    """

    kind: str
    name: str
    make: Callable[[int], Case]
    right: frozenset[Answer] = NAMED
    door: Door | None = None


@cache
def scene(options: SceneOptions) -> Scene:
    """Simulate a scene, once in a process."""
    return simulate(options, clips=shipped_clips())


def simulated(options: SceneOptions) -> Case:
    """Return the case of a simulated scene with nothing wrong."""
    one = scene(options)
    names = [camera.name for camera in one.recording.cameras]
    return Case(one.recording, (one.truth,), dict(zip(names, one.exposures_s, strict=True)))
