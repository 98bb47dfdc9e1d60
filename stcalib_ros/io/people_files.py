"""People as files: TRC, which OpenSim and Pose2Sim read, NumPy arrays, and bags."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.arrays import Float64Array, IntArray
from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.core.reconstruction.trajectories import PersonTrajectory
from stcalib_ros.io.files import atomic_path, require_writable, write_text
from stcalib_ros.io.people_bag import write_people_bag

ENDINGS = (".trc", ".npz", ".mcap")
"""What a file of people can be, by the end of its name."""

_TRC_COLUMNS = (
    "DataRate",
    "CameraRate",
    "NumFrames",
    "NumMarkers",
    "Units",
    "OrigDataRate",
    "OrigDataStartFrame",
    "OrigNumFrames",
)
_Y_UP_WORLD = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
"""Rotation from a frame with z up: its x becomes z, y becomes x, z becomes y."""
_Y_UP_CAMERA = np.diag([1.0, -1.0, -1.0])
"""Rotation from an optical frame: half a turn about x."""


@dataclass(frozen=True, slots=True, eq=False)
class PeopleFile:
    """People of a calibration, as they are written.

    Attributes
    ----------
    calibration : Calibration
        For its frame and unit.
    people : tuple of PersonTrajectory
        One or more.
    epoch_ns : int
        Zero of their times, nanoseconds since the Unix epoch.
    metres : float
        Metres of the unit of the calibration, or what they are by the size of the people.
    """

    calibration: Calibration
    people: tuple[PersonTrajectory, ...]
    epoch_ns: int
    metres: float

    def on_grid(self) -> tuple[Float64Array, IntArray]:
        """Return the times (K,) from the first to the last image, and each person's first one."""
        step_s = self.step_s
        start_s = min(float(person.times_s[0]) for person in self.people)
        firsts: IntArray = np.array(
            [round((float(p.times_s[0]) - start_s) / step_s) for p in self.people], dtype=np.int64
        )
        n = max(int(first) + len(p.times_s) for first, p in zip(firsts, self.people, strict=True))
        return np.asarray(start_s + step_s * np.arange(n)), firsts

    @property
    def step_s(self) -> float:
        """Time between samples, seconds."""
        longest = max((person.times_s for person in self.people), key=len)
        return float(longest[-1] - longest[0]) / max(len(longest) - 1, 1)


def require_people_writable(path: Path) -> None:
    """Make sure that a file of people can be written.

    Raises
    ------
    InputError
        Its name ends otherwise than in `ENDINGS`, or it cannot be written.
    """
    if path.suffix.lower() not in ENDINGS:
        raise InputError(
            f"{path}: people are written as {' or '.join(ENDINGS)}, by the end of the name"
        )
    require_writable(path)


def write_people(content: PeopleFile, path: Path) -> tuple[Path, ...]:
    """Write people: TRC files, one a person, or one file of NumPy arrays or messages.

    Returns
    -------
    tuple of Path
        The files: `path` itself, or of several people in TRC those with _P0, _P1, ... before the
        ending.
    """
    if path.suffix.lower() == ".npz":
        _write_npz(content, path)
        return (path,)
    if path.suffix.lower() == ".mcap":
        frame_id = content.calibration.reference_frame
        write_people_bag(content.people, content.epoch_ns, frame_id, path)
        return (path,)
    if len(content.people) == 1:
        paths = [path]
    else:
        paths = [
            path.with_name(f"{path.stem}_P{person.person_id}{path.suffix}")
            for person in content.people
        ]
    times_s, firsts = content.on_grid()
    for person, first, one in zip(content.people, firsts.tolist(), paths, strict=True):
        write_text(one, _trc_text(content, person, first, times_s, one.name))
    return tuple(paths)


def _trc_text(
    content: PeopleFile, person: PersonTrajectory, first: int, times_s: Float64Array, name: str
) -> str:
    """Return a TRC file: metres, y up, time 0 at the first image with anybody; empty: unknown."""
    R = _Y_UP_WORLD if content.calibration.frame_id else _Y_UP_CAMERA
    joints = content.metres * person.joints_ref @ R.T
    markers = person.layout.joint_names
    rate, n = f"{1.0 / content.step_s:.6g}", len(joints)
    rows = [
        ["PathFileType", "4", "(X/Y/Z)", name],
        list(_TRC_COLUMNS),
        [rate, rate, str(n), str(len(markers)), "m", rate, str(first + 1), str(n)],
        ["Frame#", "Time", *(cell for marker in markers for cell in (marker, "", ""))],
        ["", "", *(f"{axis}{j}" for j in range(1, len(markers) + 1) for axis in "XYZ")],
    ]
    for k, frame in enumerate(joints.reshape(n, -1), start=first):
        known = ["" if np.isnan(value) else f"{value:.5f}" for value in frame.tolist()]
        rows.append([str(k + 1), f"{times_s[k] - times_s[0]:.6f}", *known])
    return "\n".join("\t".join(row) for row in rows) + "\n"


def _write_npz(content: PeopleFile, path: Path) -> None:
    """Write arrays on one clock; NaN where unknown.

    `joints` (P, K, J, 3) and `stddev` (P, K, J) are in the frame and unit of the calibration.
    """
    times_s, firsts = content.on_grid()
    layout = content.people[0].layout
    shape = (len(content.people), len(times_s), layout.n_joints)
    joints, stddev = np.full((*shape, 3), np.nan), np.full(shape, np.nan)
    for i, (person, first) in enumerate(zip(content.people, firsts.tolist(), strict=True)):
        joints[i, first : first + len(person.joints_ref)] = person.joints_ref
        stddev[i, first : first + len(person.stddev)] = person.stddev
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        np.savez_compressed(
            stream,
            person_id=np.array([person.person_id for person in content.people]),
            time_s=times_s,
            epoch_ns=np.int64(content.epoch_ns),
            joints=joints,
            stddev=stddev,
            joint_names=np.array(layout.joint_names),
            frame_id=np.array(content.calibration.reference_frame),
            metric=np.bool_(content.calibration.metric),
            metres_per_unit=np.float64(content.metres),
        )
