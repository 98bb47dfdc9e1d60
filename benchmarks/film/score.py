"""How well estimators see the people of a film.

    python -m benchmarks.film.score examples/film
    python -m benchmarks.film.score examples/film --estimators movenet:256 movenet:512
    python -m benchmarks.film.score VIDEOS --reference balance_single_openpose.npz

Errors of joints are distances from the truth, px and as a part of the person's height. "missed" are
people in clear view that were not found, "hidden" those behind somebody that were not; "invented"
are people found where nobody is, an image; "exchanged" are pairs of joints with left and right
exchanged.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from benchmarks.film.compare import JOINT_NAMES, Comparison, compare, total
from benchmarks.film.references import OpenPoseReference, Reference, TrueReference
from stcalib_ros.core.errors import InputError, StcalibError
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.estimation.poses import ImagePoses, PoseEstimator
from stcalib_ros.estimation.registry import load_estimator
from stcalib_ros.io.films import film_images, open_film

_LEAST = 0.2
"""Score below which a joint is not there: what a calibration leaves out by default as well."""
_HZ = 5.0
"""Images of each film a second that are looked at. Chosen: people move on by a third of a step."""


def main(argv: Sequence[str] | None = None) -> int:
    """Print the tables; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.film.score",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("folder", type=Path, help="folder with the films, *.mp4, and their truth")
    add("--reference", type=Path, help="npz with poses by OpenPose instead of the truth")
    add("--estimators", nargs="+", default=["movenet:256", "movenet:512"], metavar="NAME[:SIZE]")
    add("--models", type=Path, help="folder of the weights")
    add("--hz", type=float, default=_HZ, help=f"images a second (default {_HZ:g})")
    args = parser.parse_args(argv)
    try:
        films = sorted(args.folder.glob("*.mp4"))
        if not films:
            raise InputError(f"{args.folder}: no *.mp4; make them: python -m benchmarks.film")
        reference: Reference = (
            OpenPoseReference(args.reference) if args.reference else TrueReference(args.folder)
        )
        for name in args.estimators:
            _print(name, films, _load(name, args.models), reference, args.hz)
    except StcalibError as error:
        print(f"benchmarks.film.score: {error}", file=sys.stderr)
        return error.exit_status
    return 0


def _load(name: str, models: Path | None) -> PoseEstimator:
    kind, _, size = name.partition(":")
    return load_estimator(kind, size=int(size) if size else None, folder=models)


def _print(
    name: str, films: Sequence[Path], estimator: PoseEstimator, reference: Reference, hz: float
) -> None:
    start = time.process_time()
    by_film = {path.stem: total(_compared(path, estimator, reference, hz)) for path in films}
    everything = total(by_film.values())
    spent = (time.process_time() - start) / everything.images
    print(f"\n{name}: {everything.images} images, {1000 * spent:.0f} ms of CPU an image")
    print(
        f"  {'film':14s}  missed       hidden       invented  exchanged  median px  90 %  of height"
    )
    for film, one in {**by_film, "all": everything}.items():
        print(f"  {film:14s}  {_line(one)}")
    joint_rows = zip(JOINT_NAMES, everything.errors_px.T, everything.errors_relative.T, strict=True)
    for joint, px, relative in joint_rows:
        print(f"  {joint:14s}  {'':46s}{_errors(px, relative)}")


def _compared(
    path: Path, estimator: PoseEstimator, reference: Reference, hz: float
) -> Iterator[Comparison]:
    film = open_film(path.stem, path)
    for taken in film_images(film, limit_hz=hz):
        number = round(taken.stamp_s * film.rate_hz)
        seen = reference.seen(path.stem, taken.stamp_s, number)
        yield compare(seen, _coco(estimator, estimator.poses(taken.image)))


def _coco(estimator: PoseEstimator, poses: ImagePoses) -> Float64Array:
    """Return the joints (Q, 17, 2) that are compared, NaN where the score is too low."""
    order = [estimator.layout.joint_names.index(name) for name in JOINT_NAMES]
    there = poses.scores[:, order, None] >= _LEAST
    return np.where(there, poses.keypoints[:, order], np.nan)


def _line(one: Comparison) -> str:
    clear = f"{one.clear_missed}/{one.clear}"
    hidden = f"{one.hidden_missed}/{one.hidden}"
    exchanged = f"{100 * one.exchanged / max(one.pairs, 1):.1f} %"
    errors = _errors(one.errors_px, one.errors_relative)
    return f"{clear:11s}  {hidden:11s}  {one.invented / one.images:8.2f}  {exchanged:>9s}  {errors}"


def _errors(px: Float64Array, relative: Float64Array) -> str:
    if not np.isfinite(px).any():
        return "none found"
    median, most = np.nanquantile(px, [0.5, 0.9])
    return f"{median:9.1f}  {most:4.1f}  {100 * np.nanmedian(relative):.1f} %"


if __name__ == "__main__":
    raise SystemExit(main())
