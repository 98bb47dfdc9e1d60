"""A lens of the film that is wrong: what errors by angle show of it, and what refining it gives.

    python -m benchmarks.film.wrong_lens

Calibrates `examples/film/poses.mcap` with the true lenses, with k1 of one camera set to zero, and
with that k1 refined. Outward: how much too far from the axis joints are projected in the outermost
range of angles that the report shows.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.table import Row, print_rows
from stcalib_ros.core.evaluation.metrics import evaluate
from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.core.model.lens_knowledge import LensKnowledge
from stcalib_ros.core.model.recording import Recording
from stcalib_ros.core.pipeline import run_stages
from stcalib_ros.io.bag import read_bag
from stcalib_ros.io.results import read_result
from stcalib_ros.report.angles import errors_by_angle
from stcalib_ros.report.content import content_of_stages
from stcalib_ros.report.fits import camera_fits
from stcalib_ros.threads import use_one_thread

_FOLDER = Path("examples/film")


def main() -> int:
    """Print a section for each case; return 0."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--camera", default="cam3", help="whose k1 is wrong (default cam3)")
    camera = parser.parse_args().camera
    use_one_thread()
    truth = read_result(_FOLDER / "truth.yaml")
    right = _with_line_times(read_bag(_FOLDER / "poses.mcap"), truth)
    for title, recording in (
        ("true lenses", right),
        (f"k1 of {camera} zero", _without_k1(right, camera, LensKnowledge.GIVEN)),
        (f"k1 of {camera} zero, refined", _without_k1(right, camera, LensKnowledge.REFINE)),
    ):
        print_rows(title, _rows(recording, truth, camera), file=sys.stdout)
    return 0


def _rows(recording: Recording, truth: Calibration, camera: str) -> list[Row]:
    stages = run_stages(recording)
    found = stages.calibration
    evidence = content_of_stages(recording, stages).evidence
    (fit,) = camera_fits(evidence, [camera])
    lens = next(one.intrinsics for one in found.cameras if one.name == camera)
    errors = errors_by_angle(fit, lens)
    metres = evaluate(found, truth).centre_max
    return [
        Row("result", found.status.name, "", None),
        Row("outward", f"{errors.outward_px[-1, 1]:+.2f} px in the outermost range", "", None),
        Row("elsewhere", f"{np.abs(errors.outward_px[:-1, 1]).max():.2f} px at most", "", None),
        Row("k1", f"{lens.D[0] if lens.D.size else 0.0:.3f}", "", None),
        Row("centre", f"{metres:.3f} m off, the farthest camera", "", None),
    ]


def _with_line_times(recording: Recording, truth: Calibration) -> Recording:
    line_time_s = {camera.name: camera.line_time_s for camera in truth.cameras}
    cameras = [replace(c, line_time_s=line_time_s[c.name]) for c in recording.cameras]
    return replace(recording, cameras=tuple(cameras))


def _without_k1(recording: Recording, name: str, knowledge: LensKnowledge) -> Recording:
    cameras = list(recording.cameras)
    k = [camera.name for camera in cameras].index(name)
    lens = cameras[k].intrinsics
    D = np.where(np.arange(lens.D.size) == 0, 0.0, lens.D)
    cameras[k] = replace(cameras[k], intrinsics=replace(lens, D=D), lens_knowledge=knowledge)
    return replace(recording, cameras=tuple(cameras))


if __name__ == "__main__":
    raise SystemExit(main())
