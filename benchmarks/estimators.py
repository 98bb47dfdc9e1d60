"""What estimators of poses cost, whom they find, and whether their pixels are those of the image.

    python -m benchmarks.estimators walk.mp4 ...
    python -m benchmarks.estimators walk.mp4 --estimators movenet:256 blazepose --images 5

"bias" is half the horizontal difference of the joints of an image and of its mirror image, brought
back: 0 if the centres of pixels are where they should be, 0.5 px of the network's input if they are
taken for edges. "spread" is the distance of the two.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from stcalib_ros.core.errors import InputError, StcalibError
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.keypoint_layouts import Layout
from stcalib_ros.estimation.poses import ImagePoses, PoseEstimator, UInt8Array
from stcalib_ros.estimation.registry import load_estimator

_IMAGES = 10
"""Images of each film that are looked at, evenly over its length."""

_SURE = 0.4
"""Score of a joint from which it is compared with itself in the mirror image."""

_SAME_PX = 0.1
"""Distance of two poses below which they are of one person, as a fraction of the image's width."""


@dataclass(frozen=True, slots=True)
class Figures:
    """Of one estimator, over all images.

    Attributes
    ----------
    cpu_ms : (N,) ndarray
        Of an image.
    persons : (N,) ndarray
        In an image.
    differences : (M, 2) ndarray
        Of joints and their mirror images, px.
    """

    cpu_ms: Float64Array
    persons: Float64Array
    differences: Float64Array


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.estimators",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("films", type=Path, nargs="+", metavar="FILM")
    add("--estimators", nargs="+", default=["movenet:256", "movenet:512", "blazepose"])
    add("--images", type=int, default=_IMAGES, help=f"of each film (default {_IMAGES})")
    args = parser.parse_args(argv)
    cv2.setNumThreads(1)
    print("estimator      CPU ms  people an image  bias x px       spread px")
    try:
        for name in args.estimators:
            kind, _, size = name.partition(":")
            estimator = load_estimator(kind, size=int(size) if size else None)
            print(f"{name:13s}  {_line(measure(estimator, args.films, args.images))}", flush=True)
    except StcalibError as error:
        print(f"benchmarks.estimators: {error}", file=sys.stderr)
        return error.exit_status
    return 0


def measure(estimator: PoseEstimator, films: Sequence[Path], count: int) -> Figures:
    """Run an estimator on some images of films, and on their mirror images."""
    costs, persons, differences = [], [], [np.empty((0, 2))]
    for image in (image for film in films for image in _images(film, count)):
        start = time.process_time()
        poses = estimator.poses(image)
        costs.append(1000.0 * (time.process_time() - start))
        persons.append(float(len(poses.scores)))
        mirrored = estimator.poses(np.ascontiguousarray(image[:, ::-1]))
        width = image.shape[1]
        back = _mirrored(mirrored, estimator.layout, width)
        differences += list(_differences(poses, back, _SAME_PX * width))
    return Figures(np.array(costs), np.array(persons), np.concatenate(differences))


def _images(film: Path, count: int) -> Iterator[UInt8Array]:
    video = cv2.VideoCapture(str(film))
    length = int(video.get(cv2.CAP_PROP_FRAME_COUNT))
    if length < 1:
        raise InputError(f"{film} is no film")
    wanted = set(np.linspace(0, length - 1, count).astype(int).tolist())
    for k in range(length):
        there, image = video.read()
        if there and k in wanted:
            yield image.astype(np.uint8, copy=False)


def _mirrored(poses: ImagePoses, layout: Layout, width: int) -> ImagePoses:
    other = {"left": "right", "right": "left"}
    order = [
        layout.index("_".join(other.get(word, word) for word in name.split("_")))
        for name in layout.joint_names
    ]
    keypoints = poses.keypoints[:, order] * (-1.0, 1.0) + (width - 1.0, 0.0)
    return ImagePoses(keypoints, poses.scores[:, order], poses.joints[:, order])


def _differences(one: ImagePoses, other: ImagePoses, same_px: float) -> Iterator[Float64Array]:
    for points, scores in zip(one.keypoints, one.scores, strict=True):
        for others, other_scores in zip(other.keypoints, other.scores, strict=True):
            apart = points - others
            if np.hypot(*apart.T).mean() < same_px:
                yield apart[(scores >= _SURE) & (other_scores >= _SURE)].astype(np.float64)


def _line(figures: Figures) -> str:
    apart = figures.differences
    halves = apart[:, 0] / 2.0
    error = 1.25 * np.std(halves) / np.sqrt(max(len(halves), 1))  # of a median
    bias = f"{np.median(halves):.2f} +- {error:.2f}" if len(halves) else "-"
    spread = f"{np.median(np.hypot(*apart.T)):.1f}" if len(halves) else "-"
    cost, persons = np.median(figures.cpu_ms), figures.persons.mean()
    return f"{cost:6.0f}  {persons:15.2f}  {bias:14s}  {spread:>9s}"


if __name__ == "__main__":
    raise SystemExit(main())
