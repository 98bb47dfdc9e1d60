"""Lenses that are given wrongly: how often they are named, and how often right ones are.

    python -m benchmarks.field.lenses                    20 scenes of each fault, 50 right ones
    python -m benchmarks.field.lenses --scenes 5
    python -m benchmarks.field.lenses --only "half resolution"

Faults are made in scenes "default" of benchmarks.accuracy.level: 4 cameras, 3 people, 10 s. A fault
is recognised if a reason or a remark about lenses names all cameras that have it, and no other.
Exit status 1 if one is not, or if anything is said of right lenses.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from typing import NamedTuple

from benchmarks.accuracy.scenarios import SCENARIOS
from benchmarks.field.case import CODES, Case, simulated
from benchmarks.field.changes import change_info, change_keypoints, each
from stcalib_ros.core.evaluation.metrics import evaluate
from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.core.model.recording import CameraRecording, Intrinsics
from stcalib_ros.core.pipeline import calibrate
from stcalib_ros.threads import use_one_thread

_SCENES, _RIGHT_SCENES = 20, 50
"""Scenes of each fault, and of right lenses, count. From the project's requirements."""
_KINDS = {one.name: one for one in SCENARIOS}
_FIRST_SEED = 500
"""Seeds after those of the scenes of benchmarks.accuracy.level: limits were chosen on these."""


class Heard(NamedTuple):
    """What was said of one scene: recognised or not, error of the poses, codes."""

    is_right: bool
    rotation_rad: float
    said: str


class Fault(NamedTuple):
    """A fault: how it is made, and of which cameras (of all if none is named)."""

    change: Callable[[CameraRecording], CameraRecording]
    cameras: tuple[str, ...] = ("cam1",)


def _focal(factor: float) -> Callable[[CameraRecording], CameraRecording]:
    def change(lens: Intrinsics) -> None:
        lens.K[[0, 1], [0, 1]] *= factor

    return lambda camera: change_info(camera, change)


def _principal_point(x_px: float, y_px: float) -> Callable[[CameraRecording], CameraRecording]:
    def change(lens: Intrinsics) -> None:
        lens.K[:2, 2] += [x_px, y_px]

    return lambda camera: change_info(camera, change)


def _half(camera: CameraRecording) -> CameraRecording:
    return change_keypoints(camera, lambda x: 0.5 * (x + 0.5) - 0.5)


FAULTS = {
    "focal length 5 % long": Fault(_focal(1.05)),
    "focal length 5 % short": Fault(_focal(0.95)),
    "reference 5 % long": Fault(_focal(1.05), ("cam0",)),
    "all 5 % long": Fault(_focal(1.05), ()),
    "all 5 % short": Fault(_focal(0.95), ()),
    "focal length 20 % long": Fault(_focal(1.2)),
    "focal length 20 % short": Fault(_focal(0.8)),
    "reference 20 % long": Fault(_focal(1.2), ("cam0",)),
    "all 20 % long": Fault(_focal(1.2), ()),
    "principal point 50 px right": Fault(_principal_point(50.0, 0.0)),
    "principal point 50 px down": Fault(_principal_point(0.0, 50.0)),
    "reference 50 px right": Fault(_principal_point(50.0, 0.0), ("cam0",)),
    "half resolution": Fault(_half),
    "reference half resolution": Fault(_half, ("cam0",)),
}
"""Faults by name."""
RIGHT = ("default", "bias", "crowd", "wide", "small", "one", "short")
"""Kinds of scenes of benchmarks.accuracy.level that are calibrated with right lenses."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark and print the table.

    Returns
    -------
    int
        0 if all faults are recognised and nothing is said of right lenses, else 1.
    """
    args = _arguments(argv)
    chosen = [name for name in (*FAULTS, *RIGHT) if args.only in (None, name)]
    missed = 0
    print(f"{'':28s} {'right':>10s} {'E_R':>8s}  said")
    with ProcessPoolExecutor(args.jobs, initializer=use_one_thread) as pool:
        for name in chosen:
            n = args.scenes or (_SCENES if name in FAULTS else _RIGHT_SCENES)
            rows = list(pool.map(run, [name] * n, range(n)))
            missed += sum(not row.is_right for row in rows)
            print(_line(name, rows), flush=True)
    return 1 if missed else 0


def run(name: str, index: int) -> Heard:
    """Calibrate one scene of a fault, or of a kind with right lenses."""
    case = faulty_case(name, index) if name in FAULTS else _scene(name, index)
    found = calibrate(case.recording, case.options)
    said = said_of_lenses(found)
    named = {camera for names in said.values() for camera in names}
    errors = evaluate(found, case.truths[0], fps=1.0) if found.cameras else None
    rotation_rad = float("nan") if errors is None else errors.E_R
    return Heard(
        named == case.faulty, rotation_rad, f"{found.status.name} {' '.join(sorted(said))}".strip()
    )


def faulty_case(name: str, index: int) -> Case:
    """Return one scene with a fault."""
    fault = FAULTS[name]
    return each(_scene("default", index), fault.cameras, fault.change)


def said_of_lenses(found: Calibration) -> dict[str, set[str]]:
    """Return the codes about lenses of reasons and remarks, with the cameras that they name."""
    reasons = [(one.reason.value, one.cameras) for one in found.reasons]
    remarks = [(one.code.value, one.cameras) for one in found.remarks]
    out: dict[str, set[str]] = {}
    for code, cameras in (*reasons, *remarks):
        if code in CODES["B"]:
            out.setdefault(code, set()).update(cameras)
    return out


def _scene(kind: str, index: int) -> Case:
    options = _KINDS[kind].options
    return simulated(replace(options, seed=options.seed + _FIRST_SEED + index))


def _line(name: str, rows: Sequence[Heard]) -> str:
    right = sum(row.is_right for row in rows)
    rotation_rad = sorted(row.rotation_rad for row in rows)[len(rows) // 2]
    said = ", ".join(f"{n} {text}" for text, n in Counter(r.said for r in rows).most_common())
    return f"{name:28s} {right:4d} of {len(rows):2d} {rotation_rad:8.4f}  {said}"


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.field.lenses",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--only", choices=(*FAULTS, *RIGHT), help="one row only")
    parser.add_argument("--scenes", type=int, help="scenes of each (default: 20; 50 right ones)")
    parser.add_argument("--jobs", type=int, default=1, help="processes (default: 1)")
    return parser.parse_args(argv)


if __name__ == "__main__":
    sys.exit(main())
