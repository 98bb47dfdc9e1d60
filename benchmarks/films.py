"""Films calibrated with each estimator: right, or refused with which code.

    python -m benchmarks.films FOLDER --intrinsics lenses.yaml --truth truth.yaml --synchronous

An estimator is a name, with the length of the longer side of its input after a colon.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import stcalib_ros as st
from stcalib_ros.commands.terminal import table
from stcalib_ros.estimation.film_recording import FilmOptions
from stcalib_ros.estimation.registry import load_estimator
from stcalib_ros.io.film_files import films_by_camera
from stcalib_ros.io.lens_files import lenses_of

HEAD = ("estimator", "lenses", "poses", "result", "E_R [rad]", "E_t", "offset [ms]", "CPU [s]")


def main() -> None:
    """Print a table with a row for each estimator, with lenses given and unknown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--intrinsics", type=Path, required=True)
    parser.add_argument("--truth", type=Path, required=True)
    parser.add_argument("--synchronous", action="store_true", help="true offsets are zero")
    parser.add_argument("--fps-limit", type=float, default=60.0)
    parser.add_argument("--estimators", default="movenet,movenet:512,blazepose")
    args = parser.parse_args()
    truth = st.read_result(args.truth)
    if args.synchronous:
        cameras = (replace(camera, time_offset_s=0.0) for camera in truth.cameras)
        truth = replace(truth, cameras=tuple(cameras))
    rows = [HEAD]
    for name in args.estimators.split(","):
        begin_s = time.process_time()
        recording = _recording(args, name)
        spent_s = time.process_time() - begin_s
        for knowledge in (st.LensKnowledge.GIVEN, st.LensKnowledge.UNKNOWN):
            options = st.Options(intrinsics=knowledge.value)
            rows.append((name, knowledge.value, *_row(recording, options, truth, spent_s)))
    print(table(rows))


def _recording(args: argparse.Namespace, name: str) -> st.Recording:
    films = films_by_camera([("", args.folder)])
    estimator, _, size = name.partition(":")
    options = FilmOptions(args.fps_limit, lenses_of(args.intrinsics, list(films)), name)
    make = partial(load_estimator, estimator, size=int(size) if size else None)
    return st.read_films(films, make, options)


def _row(
    recording: st.Recording, options: st.Options, truth: st.Calibration, spent_s: float
) -> tuple[str, ...]:
    begin_s = time.process_time()
    calibration = st.calibrate(recording, options)
    spent_s += time.process_time() - begin_s
    poses = sum(len(track.frames) for camera in recording.cameras for track in camera.tracks)
    if calibration.status is not st.Status.OK:
        reasons = " ".join(sorted({one.reason.name for one in calibration.rejections}))
        return (str(poses), reasons, "-", "-", "-", f"{spent_s:.0f}")
    found = st.evaluate(calibration, truth)
    cameras = f"{len(calibration.cameras)} of {len(truth.cameras)} cameras"
    return (
        str(poses),
        cameras,
        f"{found.E_R:.4f}",
        f"{found.E_t:.4f}",
        f"{1e3 * found.E_delta_s:.1f}",
        f"{spent_s:.0f}",
    )


if __name__ == "__main__":
    main()
