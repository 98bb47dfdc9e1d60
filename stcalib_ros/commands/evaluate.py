"""``stcalib evaluate``: how far a result is from the truth."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from stcalib_ros.commands.terminal import table, tell, warn
from stcalib_ros.core.errors import InputError
from stcalib_ros.core.evaluation.lens_errors import LensError
from stcalib_ros.core.evaluation.metrics import Evaluation, evaluate
from stcalib_ros.core.model.calibration import Status
from stcalib_ros.io.results import read_result

DESCRIPTION = """\
Compare a result with the true values: errors of rotations (E_R), positions (E_t), time offsets
(E_delta) and keypoints (E_2D) as the paper defines them; positions after aligning both with each
other; who was taken for whom, if the truth has persons; and lenses, if they were estimated.

  stcalib evaluate walk.yaml --truth walk_truth.yaml --fps 30
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("result", type=Path, metavar="OUT.yaml", help="result file to compare")
    parser.add_argument(
        "--truth", type=Path, required=True, metavar="TRUTH.yaml", help="file with the true values"
    )
    parser.add_argument(
        "--fps", type=float, metavar="HZ", help="frame rate, to print E_delta in frames as well"
    )


def run(args: argparse.Namespace) -> None:
    """Compare and print.

    Raises
    ------
    InputError
        A file or the frame rate is unusable, or the two have fewer than two cameras in common.
    """
    if args.fps is not None and not 0 < args.fps < math.inf:
        raise InputError(f"--fps must be above 0, got {args.fps}")
    estimate, truth = read_result(args.result), read_result(args.truth)
    if estimate.status is not Status.OK:
        warn(f"{args.result} is not to be used: its status is {estimate.status.name}")
    evaluation = evaluate(estimate, truth, fps=args.fps)
    tell(args, evaluation_text(evaluation, truth.metric), asdict(evaluation))


def evaluation_text(evaluation: Evaluation, metric: bool) -> str:
    """Say for a person how far a calibration is from the truth.

    Parameters
    ----------
    evaluation : Evaluation
    metric : bool
        Lengths of the truth are metres.
    """
    unit = "m" if metric else "baselines"
    centres = (
        f"{evaluation.centre_mean:.4f} {unit} (mean), {evaluation.centre_max:.4f} {unit} (largest)"
    )
    lines = [
        _cameras(evaluation, unit),
        "",
        f"E_R      {evaluation.E_R:.5f} rad",
        f"E_t      {evaluation.E_t:.5f} times the true distance of the first two cameras",
        f"E_delta  {evaluation.E_delta_s * 1e3:.2f} ms{_frames(evaluation.E_delta)}",
        f"E_2D     {evaluation.E_2D:.2f} px",
        f"centres  {centres} after similarity alignment; scale {evaluation.scale:.4f}",
    ]
    if math.isfinite(evaluation.precision):
        lines.append(
            f"persons  {evaluation.precision:.1%} of {evaluation.n_matches} matches of tracks are "
            f"right, {evaluation.recall:.1%} of the true ones are found"
        )
    if estimated := [lens for lens in evaluation.lenses if lens.estimated]:
        lines += [
            f"E_f      {evaluation.E_f:.2%} of the focal length",
            f"E_k1     {evaluation.E_k1:.4f}" if math.isfinite(evaluation.E_k1) else "E_k1     -",
            "",
            _lenses(estimated),
        ]
    lines += [f"NOT calibrated: {name}" for name in evaluation.missing]
    return "\n".join(lines)


def _cameras(evaluation: Evaluation, unit: str) -> str:
    rows = [("camera", "rotation [rad]", "translation", f"centre [{unit}]", "offset")]
    for c in evaluation.cameras:
        offset = f"{c.offset_s * 1e3:+.2f} ms{_frames(c.offset_frames)}"
        if c.name == evaluation.reference:
            offset = "reference"
        numbers = [f"{n:.5f}" for n in (c.rotation_rad, c.translation, c.centre)]
        rows.append((c.name, numbers[0], numbers[1], numbers[2], offset))
    return table(rows)


def _lenses(lenses: Sequence[LensError]) -> str:
    """Errors of estimated lenses, a row each."""
    rows = [("lens of", "focal length", "principal point", "radial", "rays [mrad]")]
    for lens in lenses:
        radial = [f"k{k} {e:+.4f}" for k, e in enumerate(lens.radial, 1) if math.isfinite(e)]
        rows.append(
            (
                lens.name,
                f"{lens.focal:+.2%}",
                f"{lens.principal_point_px:.1f} px",
                ", ".join(radial) or "another model",
                f"{1e3 * lens.ray_rad:.2f}",
            )
        )
    return table(rows)


def _frames(frames: float) -> str:
    return f" ({frames:.3f} frames)" if math.isfinite(frames) else ""
