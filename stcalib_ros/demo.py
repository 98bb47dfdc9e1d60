"""Calibrates the recordings that come with the package: ``python -m stcalib_ros.demo``."""

from __future__ import annotations

import argparse
import sys
import textwrap
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from stcalib_ros.cli import main as stcalib
from stcalib_ros.cli import run_command
from stcalib_ros.commands.parser import CommandParser
from stcalib_ros.commands.terminal import WIDTH, ProgressPrinter, calibration_text, table, warn
from stcalib_ros.core.errors import CalibrationError, InputError
from stcalib_ros.core.evaluation.metrics import Evaluation, evaluate
from stcalib_ros.core.model.calibration import Calibration, Status
from stcalib_ros.core.model.recording import Recording
from stcalib_ros.core.pipeline import run_stages
from stcalib_ros.core.stages import Stages
from stcalib_ros.io.bag import read_bag
from stcalib_ros.io.files import atomic_path, require_writable
from stcalib_ros.io.results import read_result, write_result
from stcalib_ros.report import require_matplotlib
from stcalib_ros.report.three_js import require_three_js

_DATA = Path(__file__).parent / "data" / "demo"
_FPS = 60.0
"""Hz. Frame rate of the four cameras of the clip."""

_MAX_ROTATION_RAD = 0.07
"""rad. Promised mean rotation error, chosen above the 2 to 3 degrees (0.035 to 0.05 rad) that the
reference itself is good to."""

_MAX_CENTRE_M = 0.25
"""m. Promised largest error of a camera's position after alignment."""

_MAX_OFFSET_S = 0.050
"""s. Promised largest error of a time offset: three frames."""

_INTRODUCTION = """\
1.67 s of video from four real cameras. A man balances on a low beam; a woman walks beside him, who
was computer-generated and added to the video; a bystander is in view of two cameras. The pose
estimator BlazePose found their keypoints. The clock of each camera was shifted by up to a third of
a second. Where the cameras stand, who is who and how clocks were shifted is now found from the
keypoints alone.
"""

_WHO = ("the man", "the woman, who is computer-generated", "the bystander")
"""Persons of the true values, by number."""

_REFERENCE = """\
Some errors are larger than the +- above, for two reasons. The true values of this clip are
themselves only good to 2-3 degrees (0.035-0.05 rad): smaller differences mean nothing. And +- is
computed from the scatter of the keypoints, so it cannot contain what BlazePose always gets wrong in
the same way. stcalib_ros/data/demo/README.md says where recording and true values come from."""


_FILM = """\
Now a film of our own: three computer-generated people walk through a room for 24 s, in front of six
cameras that were not started together. The pose estimator MoveNet found them in ten images a second
of each. As you would type it:
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Calibrate the demo recording in front of the user.

    Returns
    -------
    int
        Exit status: 0 calibrated, 2 unusable arguments or files, 3 no trustworthy calibration,
        130 interrupted.
    """
    args = _parser().parse_args(argv)
    return run_command("demo", lambda: _run(args.output_dir, args.film))


def _parser() -> argparse.ArgumentParser:
    parser = CommandParser(
        prog="python -m stcalib_ros.demo", description=_INTRODUCTION.replace("\n", " ")
    )
    parser.add_argument(
        "--output-dir",
        type=Path,
        default=Path("out"),
        metavar="DIR",
        help="where demo.yaml, demo.html and demo.png go (default: out)",
    )
    parser.add_argument(
        "--film",
        type=Path,
        metavar="DIR",
        help="also calibrate the film in examples/film, and draw the people into it",
    )
    return parser


def _run(folder: Path, film: Path | None) -> None:
    outputs = _outputs(folder)
    print(_INTRODUCTION, flush=True)
    recording, stages = _calibrate()
    calibration = stages.calibration
    truth = read_result(_DATA / "balance_truth.yaml")
    if calibration.status is not Status.OK:
        raise CalibrationError(
            f"no trustworthy calibration ({calibration.status.name}): {calibration.message}"
        )
    _write(recording, stages, truth, outputs)
    print(calibration_text(calibration))
    print()
    print(people_text(calibration, truth))
    print()
    print(errors_text(evaluate(calibration, truth, fps=_FPS), calibration, truth))
    print()
    print(_REFERENCE)
    print()
    files = _files(*outputs)
    if film is not None:
        files += _run_film(film, folder)
        print()
    print(_files_text(files))


def _run_film(film: Path, folder: Path) -> tuple[tuple[str, str], ...]:
    """Calibrate a film, compare it with the truth, and draw the people; return what was written."""
    print(_FILM)
    bag, truth, result = film / "poses.mcap", film / "truth.yaml", folder / "film.yaml"
    report, picture = folder / "film.html", folder / "film.jpg"
    for command in (
        ("calibrate", bag, "--line-time", "cam3=5e-5", "-o", result, "--report", report, "-q"),
        ("evaluate", result, "--truth", truth, "--fps", "15"),
        ("draw", result, bag, "--films", film, "-o", picture),
    ):
        words = [str(word) for word in command]
        print(_as_typed(words), flush=True)
        if status := stcalib(words):
            raise (CalibrationError if status == CalibrationError.exit_status else InputError)(
                f"the film could not be calibrated: stcalib {words[0]} ended with status {status}"
            )
    return (
        (str(report), "the report of the film"),
        (str(picture), "the film with the people drawn into it"),
    )


def _outputs(folder: Path) -> tuple[Path, Path, Path]:
    """Files to write, before the work; their folder is made."""
    require_matplotlib("the demo's picture")
    require_three_js()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"cannot make the folder {folder}: {error.strerror}; choose another --output-dir"
        ) from error
    outputs = (folder / "demo.yaml", folder / "demo.html", folder / "demo.png")
    for path in outputs:
        require_writable(path)
    return outputs


def _calibrate() -> tuple[Recording, Stages]:
    progress = ProgressPrinter(sys.stderr)
    try:
        recording = read_bag(_DATA / "balance.mcap", progress=progress, warn=warn)
        return recording, run_stages(recording, progress=progress)
    finally:
        progress.close()


def _write(
    recording: Recording, stages: Stages, truth: Calibration, outputs: tuple[Path, Path, Path]
) -> None:
    from stcalib_ros.report.content import content_of_stages
    from stcalib_ros.report.figures import overview_png
    from stcalib_ros.report.html import write_report

    content = content_of_stages(recording, stages, truth=truth)
    result, report, picture = outputs
    write_result(stages.calibration, result)
    write_report(content, report)
    with atomic_path(picture) as temporary:
        temporary.write_bytes(overview_png(content))


def people_text(calibration: Calibration, truth: Calibration) -> str:
    """Say who the persons are.

    Parameters
    ----------
    calibration, truth : Calibration
        The result, and the true values.
    """
    names = {tuple(sorted(p.tracks.items())): _WHO[p.person_id] for p in truth.persons}
    found = {p.person_id: names.get(tuple(sorted(p.tracks.items()))) for p in calibration.persons}
    return "\n".join(
        f"Person {n} is {who}." if who else f"Person {n} mixes up several people."
        for n, who in found.items()
    )


def _as_typed(words: Sequence[str]) -> str:
    """Return a command as it is typed, with its long lines broken."""
    lines = textwrap.wrap(
        f"$ stcalib {' '.join(words)}",
        WIDTH - len(" \\"),
        subsequent_indent=" " * len("$ stcalib "),
        break_long_words=False,
        break_on_hyphens=False,
    )
    return " \\\n".join(lines)


def _files(result: Path, report: Path, picture: Path) -> tuple[tuple[str, str], ...]:
    """Return what was written, the report first."""
    return (
        (str(report), "the report: open it in a browser"),
        (str(picture), "cameras and people, and clocks before and after"),
        (str(result), "the calibration as numbers"),
    )


def _files_text(files: Sequence[tuple[str, str]]) -> str:
    """Say what was written, and how to look at it."""
    opener = "open" if sys.platform == "darwin" else "xdg-open"
    return f"{table(files)}\n\nTo look at it: {opener} {files[0][0]}"


def errors_text(evaluation: Evaluation, calibration: Calibration, truth: Calibration) -> str:
    """Return a table of the errors against the truth, each beside the promised bound.

    Parameters
    ----------
    evaluation : Evaluation
    calibration, truth : Calibration
        What the evaluation compares.
    """
    offset = max(abs(camera.offset_s) for camera in evaluation.cameras)
    frames = max(abs(camera.offset_frames) for camera in evaluation.cameras)
    right, total = persons_right(calibration, truth)
    rows = [("difference to the true values", "", "promised", "")]
    for what, value, promise, kept in (
        (
            "rotation of cameras, mean",
            f"{np.degrees(evaluation.E_R):.1f} degrees = {evaluation.E_R:.3f} rad",
            f"{np.degrees(_MAX_ROTATION_RAD):.1f} degrees",
            evaluation.E_R <= _MAX_ROTATION_RAD,
        ),
        (
            "position of cameras, largest, after alignment",
            f"{100 * evaluation.centre_max:.0f} cm",
            f"{100 * _MAX_CENTRE_M:.0f} cm",
            evaluation.centre_max <= _MAX_CENTRE_M,
        ),
        (
            "clock offset, largest",
            f"{1e3 * offset:.1f} ms = {frames:.2f} frames",
            f"{1e3 * _MAX_OFFSET_S:.0f} ms",
            offset <= _MAX_OFFSET_S,
        ),
        ("people recognised in all cameras", f"{right} of {total}", f"{total}", right == total),
    ):
        rows.append((what, value, promise, "kept" if kept else "MISSED"))
    return table(rows)


def persons_right(calibration: Calibration, truth: Calibration) -> tuple[int, int]:
    """Count the people whose tracks in all cameras that see them were found to be theirs.

    Returns
    -------
    right, total : int
    """
    found = [dict(p.tracks) for p in calibration.persons]
    return sum(dict(p.tracks) in found for p in truth.persons), len(truth.persons)


if __name__ == "__main__":
    sys.exit(main())
