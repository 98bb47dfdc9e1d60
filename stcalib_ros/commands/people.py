"""``stcalib people``: the people of a bag in 3D, by a calibration that there is."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from stcalib_ros.commands.result_and_bag import add_result_and_bag_arguments, read_bag_as_configured
from stcalib_ros.core.errors import CalibrationError

if TYPE_CHECKING:
    from stcalib_ros.core.capture.people import Capture
    from stcalib_ros.core.model.calibration import Calibration
    from stcalib_ros.core.model.recording import Recording
    from stcalib_ros.core.reconstruction.trajectories import PersonTrajectory

# What computes is imported by the functions that need it, for `--help` to be quick.

DESCRIPTION = """\
Compute how people in a bag move in 3D, from a finished calibration, on its reference clock.

  stcalib people walk.yaml walk.mcap --output walk.trc

The bag is the calibrated one, or a later one of the same cameras and clocks. OUT.trc is for OpenSim
and Pose2Sim: metres, y up, one file per person (walk_P0.trc, ...). OUT.npz has everybody, in the
frame and unit of the result, with standard deviations. OUT.mcap is a bag of PoseArray messages,
one topic per person.

`stcalib calibrate walk.mcap --output walk.yaml --people walk.trc` does both in one command.
"""

MIN_EXPLAINED = 0.5
"""Fraction of the keypoints of a camera that have to agree with the others, as in a calibration
(`CheckThresholds.min_explained_fraction`)."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    add_result_and_bag_arguments(parser, ".mcap file or rosbag2 folder")
    parser.add_argument(
        *("-o", "--output"),
        type=Path,
        required=True,
        metavar="OUT.{trc,npz,mcap}",
        help="file to write",
    )


def run(args: argparse.Namespace) -> None:
    """Triangulate people, and write them.

    Raises
    ------
    InputError
        An argument or file is unusable, or the result is not to be used.
    CalibrationError
        What the bag shows does not agree with the calibration.
    """
    from stcalib_ros.commands.terminal import tell
    from stcalib_ros.io.people_files import require_people_writable
    from stcalib_ros.io.results import read_usable_result

    require_people_writable(args.output)
    calibration = read_usable_result(args.result)
    recording, found = captured(args, calibration)
    written = write(calibration, found.people, recording, args.output)
    rms_px = found.reprojection_rms_px
    fit = f"Keypoints that agree with the others: {_shares(found)}; {rms_px:.2f} px (rms)"
    tell(
        args,
        f"{fit}\n{people_text(found.people, calibration, written)}",
        {
            "written": [str(path) for path in written],
            "people": [person.person_id for person in found.people],
            "keypoints_that_agree": dict(found.explained),
            "reprojection_rms_px": rms_px,
        },
    )


def captured(args: argparse.Namespace, calibration: Calibration) -> tuple[Recording, Capture]:
    """Read a bag, triangulate its people, and make sure that they agree with the calibration.

    Parameters
    ----------
    args : Namespace
        With `result`, `bag`, `config` and `decoder`.
    calibration : Calibration
        Content of `result`.

    Raises
    ------
    InputError
        A file is unusable.
    CalibrationError
        What the bag shows does not agree with the calibration.
    """
    from stcalib_ros.commands.terminal import warn
    from stcalib_ros.core.capture.people import capture_people

    recording, config = read_bag_as_configured(args)
    found = capture_people(recording, calibration, config.options)
    off = [name for name, share in found.explained.items() if share < MIN_EXPLAINED]
    if len(found.explained) - len(off) < 2:
        raise CalibrationError(
            f"{args.bag} does not agree with {args.result} (keypoints that agree: "
            f"{_shares(found)}): a camera was moved, its clock was set, or these are other "
            "cameras; calibrate this bag, with --people"
        )
    for name in off:
        warn(f"only {found.explained[name]:.0%} of the keypoints of {name} agree with the others")
    return recording, found


def _shares(found: Capture) -> str:
    return ", ".join(f"{name} {share:.0%}" for name, share in found.explained.items())


def write(
    calibration: Calibration,
    people: Sequence[PersonTrajectory],
    recording: Recording,
    output: Path,
) -> tuple[Path, ...]:
    """Write the people of a calibration, and return the files.

    Raises
    ------
    CalibrationError
        There is nobody.
    """
    from stcalib_ros.core.capture.people import metres_of
    from stcalib_ros.io.people_files import PeopleFile, write_people

    if not people:
        raise CalibrationError("nobody is seen by two cameras at a time: there are no people")
    metres = metres_of(calibration, people, recording)
    content = PeopleFile(calibration, tuple(people), recording.epoch_ns, metres)
    return write_people(content, output)


def people_text(
    people: Sequence[PersonTrajectory], calibration: Calibration, written: Sequence[Path]
) -> str:
    """Say who was found, and where it was written to."""
    import numpy as np

    from stcalib_ros.commands.terminal import table
    from stcalib_ros.wording import length_unit

    rows = [("person", "from", "lasts", "joints known", "typical deviation")]
    first_s = min(float(person.times_s[0]) for person in people)
    for person in people:
        known = np.isfinite(person.joints_ref[..., 0])
        spread = float(np.median(person.stddev[known])) if known.any() else float("nan")
        rows.append(
            (
                str(person.person_id),
                f"{person.times_s[0] - first_s:.2f} s",
                f"{person.times_s[-1] - person.times_s[0]:.2f} s",
                f"{known.mean():.0%}",
                f"{spread:.3f} {length_unit(calibration.metric)}",
            )
        )
    lines = [table(rows), f"People are in {', '.join(map(str, written))}"]
    if written[0].suffix.lower() == ".trc":
        if not calibration.metric:
            lines.append(
                "The result has no unit of length: metres are estimated from the size of people."
            )
        if not calibration.frame_id:
            lines.append(
                f"y is up only if {calibration.reference} is level: for the true vertical, "
                "calibrate with world_frame in the configuration."
            )
    return "\n".join(lines)
