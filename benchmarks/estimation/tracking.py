"""Following persons in simulated scenes: ids that change, tracks that break, sides that stay wrong.

python -m benchmarks.estimation.tracking
python -m benchmarks.estimation.tracking --rates 10 --people 6 --scenes 10
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from benchmarks.table import Row, print_rows
from stcalib_ros.core.model.arrays import BoolArray, Float64Array, IntArray
from stcalib_ros.core.model.recording import CameraRecording
from stcalib_ros.core.synthetic import SceneOptions, simulate
from stcalib_ros.estimation.poses import ImagePoses
from stcalib_ros.estimation.sides import sided_parts
from stcalib_ros.estimation.tracking import PersonTracker
from stcalib_ros.io.mocap import shipped_clips

RATES = (5.0, 10.0, 30.0)
"""Images per second of the scenes. Chosen: what estimators do on a processor, and on a card."""
FLIPS_PER_S = 0.1
"""Exchanges of left and right per second and person, of the whole body, the arms and the legs each.
Chosen: several times those of good estimators, so that they can be counted."""
FLIP_S = (0.05, 0.6)
"""Seconds, range. Duration of an exchange. Chosen: one image of 20 Hz to a step."""
TWICE = 0.02
"""Fraction of the persons of an image that are found twice. Chosen like those of MoveNet."""
TWICE_PX = 2.0
"""px. Standard deviation of the second pose about the first. Chosen: the noise of keypoints."""
FALSE = 0.05
"""Persons per image where nobody is. Chosen: more than estimators find."""
APART = 0.05
"""Ratio to the size of a person. Sides count as exchanged where they are further apart: the rest
changes no calibration. Chosen: a few times the noise of keypoints."""
KINDS = {"walkers": "procedural", "dancers": "mocap"}
"""What people do: they walk about, or also box, jump, run and dance."""
MAX_SWITCHES = {"walkers": (0.01, 0.003, 0.001), "dancers": (0.03, 0.006, 0.0012)}
"""Fraction of the poses at which a track goes on to somebody else, at most; by `RATES`. Chosen: a
third more than there are."""
MAX_MADE = 0.02
"""Fraction of the poses with right sides in which a part is exchanged, at most. Chosen: a tenth of
what a calibration takes as outliers."""
MAX_LEFT = {"walkers": (0.8, 0.35, 0.15), "dancers": (1.0, 0.75, 0.3)}
"""Fraction of the poses with an exchanged body in which it still is, at most; by `RATES`. Chosen:
at 5 Hz dancers turn round between two images."""


PARTS = ("body", "arms", "legs")
NOBODY = -1
"""Instead of the number of a person: nobody is there. Definition."""


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """What an estimator finds in one image, and the truth of it.

    Attributes
    ----------
    stamp_s : float
    poses : ImagePoses
    person : (P,) ndarray of int
        `NOBODY` for false persons.
    flipped : (P, 3) ndarray of bool
        Body, arms and legs with left and right exchanged.
    """

    stamp_s: float
    poses: ImagePoses
    person: IntArray
    flipped: BoolArray


def scene_images(options: SceneOptions) -> list[tuple[list[Seen], CameraRecording]]:
    """Return the images of every camera of a scene, with an estimator's faults."""
    scene = simulate(options, clips=shipped_clips())
    rng = np.random.default_rng([options.seed, 77])
    return [
        (list(_images(rng, c, scene.track_persons[c.name], options.n_people)), c)
        for c in scene.recording.cameras
    ]


def _images(
    rng: np.random.Generator,
    camera: CameraRecording,
    persons: Mapping[int, IntArray],
    n_people: int,
) -> Iterator[Seen]:
    T, J = len(camera.stamps), camera.layout.n_joints
    points = np.full((T, n_people, J, 2), np.nan)
    for track in camera.tracks:
        points[track.frames, persons[track.track_id]] = track.keypoints
    flips = _flips(rng, camera.stamps, n_people)
    parts = sided_parts(camera.layout)
    for k, stamp_s in enumerate(camera.stamps):
        there = [p for p in rng.permutation(n_people) if np.isfinite(points[k, p]).any()]
        found, person, flipped = [], [], []
        for p in there:
            pose = points[k, p]
            for part, is_flipped in zip(parts, flips[k, p], strict=True):
                pose = pose[part.order] if is_flipped else pose
            times = 2 if rng.uniform() < TWICE else 1
            found += [pose + TWICE_PX * rng.standard_normal(pose.shape) * t for t in range(times)]
            person += [p] * times
            flipped += [flips[k, p]] * times
        if there and rng.uniform() < FALSE:
            shift = rng.uniform(-0.5, 0.5, 2) * [camera.intrinsics.width, camera.intrinsics.height]
            found.append(points[k, there[0]] * 0.8 + shift)
            person.append(NOBODY)
            flipped.append(np.zeros(3, dtype=bool))
        keypoints = np.array(found).reshape(-1, J, 2)
        scores = np.where(np.isfinite(keypoints[..., 0]), 0.8, 0.0)
        poses = ImagePoses(keypoints, scores, np.full((len(found), J, 3), np.nan))
        yield Seen(float(stamp_s), poses, np.array(person, int), np.array(flipped).reshape(-1, 3))


def _flips(rng: np.random.Generator, stamps: Float64Array, n_people: int) -> BoolArray:
    """Return which parts (T, P, 3) are exchanged when."""
    out = np.zeros((len(stamps), n_people, 3), dtype=bool)
    for p in range(n_people):
        for part in range(3):
            n = rng.poisson(FLIPS_PER_S * (stamps[-1] - stamps[0]))
            for begin in rng.uniform(stamps[0], stamps[-1], n):
                out[(stamps >= begin) & (stamps < begin + rng.uniform(*FLIP_S)), p, part] = True
    return out


def count(images: Sequence[Seen], camera: CameraRecording) -> Counter[str]:
    """Follow the persons of one camera, and count what goes wrong."""
    tracker, out = PersonTracker(camera.layout), Counter[str]()
    owner: dict[int, int] = {}
    last_id: dict[int, int] = {}
    begin = time.process_time()
    followed = [tracker.follow(image.stamp_s, image.poses) for image in images]
    out["us"] += round(1e6 * (time.process_time() - begin))
    out["images"] += len(images)
    for image, (poses, ids) in zip(images, followed, strict=True):
        rows = _rows(image.poses, poses)
        out["twice"] += len(rows) - len(set(image.person[rows]))
        for k, row in enumerate(rows):
            person, track = int(image.person[row]), int(ids[k])
            if person == NOBODY:
                out["false"] += track in owner
                continue
            out["poses"] += 1
            out["switches"] += owner.get(track, person) != person
            out["breaks"] += last_id.get(person, track) != track
            owner[track], last_id[person] = person, track
            _count_sides(out, camera, image, row, poses.keypoints[k])
    return out


def _rows(given: ImagePoses, kept: ImagePoses) -> list[int]:
    """Return which of the given poses were kept: their joints are the same, in some order."""
    sums = np.nansum(given.keypoints, axis=(1, 2))
    return [int(np.argmin(np.abs(sums - s))) for s in np.nansum(kept.keypoints, axis=(1, 2))]


def _count_sides(
    out: Counter[str], camera: CameraRecording, image: Seen, row: int, mended: Float64Array
) -> None:
    """Count the parts of a pose that came with left and right exchanged, and that still are."""
    parts = sided_parts(camera.layout)
    given = truth = image.poses.keypoints[row]
    for part, is_flipped in reversed(list(zip(parts, image.flipped[row], strict=True))):
        truth = truth[part.order] if is_flipped else truth
    apart_px = APART * float(np.nanmax(np.ptp(truth[np.isfinite(truth[:, 0])], axis=0)))
    for name, part in zip(PARTS, parts, strict=True):
        was, is_now = (
            bool((np.linalg.norm(p - truth, axis=-1)[part.compared] > apart_px).mean() > 0.5)
            for p in (given, mended)
        )
        out[f"{name} exchanged"] += was
        out[f"{name} left"] += was and is_now
        out[f"{name} made"] += is_now and not was


def rows_of(found: Counter[str], kind: str, rate: float) -> tuple[Row, ...]:
    """Return the figures of one kind and rate beside their targets."""
    poses, at = found["poses"], RATES.index(rate)
    most_switches, most_left = MAX_SWITCHES[kind][at], MAX_LEFT[kind][at]
    switches = found["switches"] / poses
    sides = [
        Row(
            name,
            f"{found[f'{name} exchanged']} exchanged, {found[f'{name} left']} of them left,"
            f" {found[f'{name} made']} made",
            f"made <= {MAX_MADE:.0%}",
            found[f"{name} made"] <= MAX_MADE * poses,
        )
        for name in PARTS
    ]
    left = found["body left"] / max(found["body exchanged"], 1)
    return (
        Row("poses", f"{poses} in {found['images']} images", "", None),
        Row(
            "switches",
            f"{found['switches']}, {switches:.2%} of the poses",
            f"<= {most_switches:.2%}",
            switches <= most_switches,
        ),
        Row("breaks", f"{found['breaks']}", "", None),
        Row("twice", f"{found['twice']} persons that are somebody else once more", "", None),
        Row("false", f"{found['false']} poses of nobody in tracks of people", "", None),
        *sides,
        Row("body left", f"{left:.0%}", f"<= {most_left:.0%}", left <= most_left),
        Row("CPU ms", f"{found['us'] / found['images'] / 1e3:.2f} an image", "", None),
    )


def measured(kind: str, rate: float, args: argparse.Namespace) -> Counter[str]:
    """Follow the persons of all scenes of one kind, at one rate."""
    total = Counter[str]()
    for seed in range(args.scenes):
        options = SceneOptions(
            n_cameras=2,
            n_people=args.people,
            people=KINDS[kind],
            n_frames=int(args.seconds * rate),
            fps=rate,
            image_size=(640, 480),
            focal_px=500.0,
            sigma_px=2.0,
            flip_rate=0.0,
            id_switches_per_10s=0.0,
            occlusions=True,
            bursts_per_10s=0.5,
            stamp_jitter_s=0.1 / rate,
            drop_rate=0.1,
            seed=seed,
        )
        for images, camera in scene_images(options):
            total += count(images, camera)
    return total


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the figures; exit status 1 if a target is missed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rates", type=float, nargs="+", choices=RATES, default=RATES)
    parser.add_argument("--people", type=int, default=4)
    parser.add_argument("--scenes", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=40.0)
    args = parser.parse_args(arguments)
    met = True
    for kind, rate in product(KINDS, args.rates):
        rows = rows_of(measured(kind, rate, args), kind, rate)
        print_rows(f"{args.people} {kind} at {rate:g} Hz", rows, file=sys.stdout)
        met &= all(row.met is not False for row in rows)
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
