"""Persons followed from image to image of one camera, as the images come.

Every person goes on as before, and poses are assigned to where they are expected, all at once
(H. W. Kuhn, "The Hungarian method for the assignment problem", 1955). A pose that is far
from all of them begins a person of its own. Limits are those of
`stcalib_ros.core.lifting.track_linking`: an interrupted track costs a calibration little, one that
changes to somebody else much. So, where two people meet and either could be the one who is seen,
both get new ids.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.geometry.robust import median_of_known
from stcalib_ros.core.lifting.limits import (
    LONGEST_BREAK_FRAMES,
    LONGEST_BREAK_S,
    MAX_ASTRAY,
    MIN_JOINTS,
    STRAY_SPEED,
    TRACK_JUMP,
    TRACK_SPEED,
)
from stcalib_ros.core.model.arrays import BoolArray, Float64Array, FloatArray, IntArray
from stcalib_ros.core.model.keypoint_layouts import DETAILS, Layout
from stcalib_ros.estimation.limits import (
    JOINT_MEMORY_S,
    MAX_SAME_PERSON,
    MIN_DISTINCTION,
    MIN_SIZE_PX,
    SIZE_TIME_S,
    SWING_S,
    VELOCITY_TIME_S,
)
from stcalib_ros.estimation.poses import ImagePoses
from stcalib_ros.estimation.sides import Sides, new_sides, sided_parts

_FORBIDDEN = 1e6
"""Cost of an assignment that is not possible, sizes of a person; far above that of any other."""


@dataclass(frozen=True, slots=True)
class TrackingOptions:
    """Options of a `PersonTracker`.

    Attributes
    ----------
    min_score : float
        Joints with a lower score are taken for not found, as a calibration does.
    memory_s : float
        Seconds after which somebody who is not seen is given up.
    mend_sides : bool
        Exchange left and right back.
    """

    min_score: float = 0.3
    memory_s: float = LONGEST_BREAK_S
    mend_sides: bool = True

    def __post_init__(self) -> None:
        for name, most in (("min_score", 1.0), ("memory_s", _LONGEST_MEMORY_S)):
            if not 0 <= (value := getattr(self, name)) <= most:
                raise InputError(f"{name}: expected 0 to {most:g}, got {value}")


_LONGEST_MEMORY_S = 60.0
"""Seconds. Nobody is remembered for longer: they would be expected anywhere by then. Chosen."""


@dataclass(slots=True, eq=False)
class _Person:
    """Somebody who is followed.

    Attributes
    ----------
    track_id : int
    stamp_s : float
        Of the image that they were last seen in.
    points, velocity : (J, 2) ndarray
        Joints then, px and px/s, sides mended; NaN where not known.
    seen_s : (J,) ndarray
        Stamps of the images that joints were last found in.
    size : float
        Larger side of the box around the joints, px.
    sides : Sides
    has_poses : bool
        Whether there is a pose of this id.
    """

    track_id: int
    stamp_s: float
    points: Float64Array
    velocity: Float64Array
    seen_s: Float64Array
    size: float
    sides: Sides
    has_poses: bool = True

    def expected(self, stamp_s: float) -> Float64Array:
        """Return where the joints (J, 2) are expected at some time, px."""
        gap_s = stamp_s - self.stamp_s
        if gap_s <= SWING_S:
            return self.points + self.velocity * gap_s
        return self.points + _mean_of_known(self.velocity) * gap_s

    def go_on(self, stamp_s: float, found: Float64Array, mend_sides: bool) -> IntArray:
        """Take the pose (J, 2) of an image, and return the joint that each is, (J,)."""
        gap_s, expected = stamp_s - self.stamp_s, self.expected(stamp_s)
        order = np.arange(len(found))
        if mend_sides:
            order, past = self.sides.follow(found, expected, self.size, gap_s)
            found, expected = found[order], expected[past]
            for name in ("points", "velocity", "seen_s"):
                setattr(self, name, getattr(self, name)[past])
        known: BoolArray = np.asarray(np.isfinite(found).all(-1))
        if gap_s > 0:
            self._update_velocity(found, gap_s)
        self.seen_s = np.where(known, stamp_s, self.seen_s)
        remembered = self.seen_s[:, None] >= stamp_s - JOINT_MEMORY_S
        self.points = np.where(remembered, np.where(known[:, None], found, expected), np.nan)
        self.velocity = np.where(remembered, self.velocity, np.nan)
        shrunk = self.size * math.exp(-gap_s / SIZE_TIME_S)
        self.size, self.stamp_s = max(_size(found), shrunk), stamp_s
        self.has_poses = True
        return order

    def _update_velocity(self, found: Float64Array, gap_s: float) -> None:
        """Take in the mean velocity since the image before; the first one holds as it is."""
        new, had = (found - self.points) / gap_s, np.isfinite(self.velocity)
        weight = np.where(had, gap_s / (gap_s + VELOCITY_TIME_S), 1.0)
        old = np.where(had, self.velocity, 0.0)
        self.velocity = np.where(np.isfinite(new), old + weight * (new - old), self.velocity)


class PersonTracker:
    """Gives the persons of one camera ids that last, image after image, and mends their sides.

    Parameters
    ----------
    layout : Layout
        Joints of all poses.
    options : TrackingOptions, optional

    Examples
    --------
    >>> import numpy as np
    >>> from stcalib_ros.core.model.keypoint_layouts import LAYOUTS
    >>> rng = np.random.default_rng(1)
    >>> one, other = rng.uniform(0, 200, (2, 17, 2)) + [[[0, 0]], [[300, 0]]]
    >>> tracker = PersonTracker(LAYOUTS["coco_17"])
    >>> for stamp_s, found in ((0.0, [one, other]), (0.1, [other, one])):
    ...     poses = ImagePoses(np.array(found), np.ones((2, 17)), np.full((2, 17, 3), np.nan))
    ...     print(tracker.follow(stamp_s, poses)[1])
    [0 1]
    [1 0]
    """

    def __init__(self, layout: Layout, options: TrackingOptions | None = None) -> None:
        self.layout, self.options = layout, options or TrackingOptions()
        self._parts = sided_parts(layout)
        self._body = np.array([name not in DETAILS for name in layout.joint_names], dtype=bool)
        self._people: list[_Person] = []
        self._next_id = 0
        self._before_s = self._last_s = math.nan
        self._period_s = 0.0

    def follow(self, stamp_s: float, poses: ImagePoses) -> tuple[ImagePoses, IntArray]:
        """Take the poses of the next image, and return those of persons, with their ids.

        Parameters
        ----------
        stamp_s : float
            Stamp of the image, seconds. One before the last begins anew, with new ids.
        poses : ImagePoses

        Returns
        -------
        poses : ImagePoses
            Without persons found twice and those of too few joints, left and right mended; in the
            order given.
        ids : (P,) ndarray of int
            Counted up from 0; none is used again.
        """
        gap_s = stamp_s - self._last_s
        if gap_s < 0:
            self._people.clear()
        elif gap_s > 0:
            self._period_s = gap_s if self._period_s == 0 else min(gap_s, 2 * self._period_s)
        self._before_s, self._last_s = self._last_s, stamp_s
        longest_s = max(self.options.memory_s, LONGEST_BREAK_FRAMES * self._period_s)
        self._people = [p for p in self._people if stamp_s - p.stamp_s <= longest_s]
        found = np.where(
            (poses.scores >= self.options.min_score)[..., None], poses.keypoints, np.nan
        ).astype(np.float64)
        rows = np.flatnonzero(np.isfinite(found).all(-1).sum(-1) >= MIN_JOINTS)
        whose = self._assigned(stamp_s, found[rows])
        followed = {int(rows[k]): person for k, person in whose.items()}
        rows = self._without_doubles(found, poses.scores, rows, followed)
        return self._followed(stamp_s, poses, found, rows, followed)

    def _without_doubles(
        self,
        found: Float64Array,
        scores: FloatArray,
        rows: IntArray,
        followed: Mapping[int, _Person],
    ) -> IntArray:
        """Return rows without those of persons who are somebody else once more.

        Of two who were both there in the image before, one walks in front of the other.
        """
        total = np.where(np.isfinite(scores), scores, 0.0).sum(-1)
        kept = [row for row, person in followed.items() if person.stamp_s == self._before_s]
        for row in sorted(set(rows.tolist()) - set(kept), key=lambda row: -total[row]):
            away = np.linalg.norm(found[kept] - found[row], axis=-1)[:, self._body]
            distance = median_of_known(away, least=MIN_JOINTS)
            if not (distance < MAX_SAME_PERSON * _sizes(found[kept])).any():
                kept.append(row)
        return np.array(sorted(kept), dtype=np.int64)

    def _followed(
        self,
        stamp_s: float,
        poses: ImagePoses,
        found: Float64Array,
        rows: IntArray,
        followed: Mapping[int, _Person],
    ) -> tuple[ImagePoses, IntArray]:
        """Continue persons with the poses of some rows, and begin those that are new."""
        given = (poses.keypoints, poses.scores, poses.joints)
        keypoints, scores, joints = (values[rows] for values in given)
        ids = np.zeros(len(rows), dtype=np.int64)
        for k, row in enumerate(rows.tolist()):
            if (person := followed.get(row)) is None:
                self._begin(stamp_s, found[row])
                ids[k] = self._people[-1].track_id
                continue
            order = person.go_on(stamp_s, found[row], self.options.mend_sides)
            ids[k] = person.track_id
            for values in (keypoints, scores, joints):
                values[k] = values[k][order]
        return ImagePoses(keypoints, scores, joints), ids

    def _begin(self, stamp_s: float, found: Float64Array) -> None:
        unknown = np.full(found.shape, np.nan)
        seen_s = np.where(np.isfinite(found).all(-1), stamp_s, -np.inf)
        size, sides = _size(found), new_sides(self._parts)
        person = _Person(self._new_id(), stamp_s, found.copy(), unknown, seen_s, size, sides)
        self._people.append(person)

    def _new_id(self) -> int:
        self._next_id += 1
        return self._next_id - 1

    def _assigned(self, stamp_s: float, found: Float64Array) -> dict[int, _Person]:
        """Return the person that each pose (P, J, 2) goes on, by its index; none where nobody."""
        cost = self._costs(stamp_s, found)
        pairs = zip(*map(np.ndarray.tolist, linear_sum_assignment(cost)), strict=True)
        pose_of = {a: b for a, b in pairs if cost[a, b] < _FORBIDDEN}
        for a in _confusable(cost, pose_of, [person.has_poses for person in self._people]):
            self._people[a].track_id, self._people[a].has_poses = self._new_id(), False
        return {b: self._people[a] for a, b in pose_of.items()}

    def _costs(self, stamp_s: float, found: Float64Array) -> Float64Array:
        """Distances (A, B) of poses from where persons are expected, in their sizes."""
        people, body = self._people, self._body
        if not people or not len(found):
            return np.zeros((len(people), len(found)))
        gap_s = np.array([stamp_s - p.stamp_s for p in people])[:, None]
        points = np.stack([p.points for p in people])[:, None, body]
        drift = np.stack([_mean_of_known(p.velocity) for p in people])[:, None, None]
        size = np.fmax(np.array([p.size for p in people])[:, None], _sizes(found))
        poses = (found[:, body], found[:, self._parts[0].order][:, body])
        moved, astray = (
            np.fmin(*(_distance(pose - place) for pose in poses)) / size
            for place in (points, points + drift * gap_s[..., None, None])
        )
        possible = moved < TRACK_JUMP + TRACK_SPEED * gap_s
        possible &= astray < MAX_ASTRAY + STRAY_SPEED * gap_s
        return np.where(possible, astray, _FORBIDDEN)


def _confusable(
    cost: Float64Array, pose_of: Mapping[int, int], has_poses: Sequence[bool]
) -> Collection[int]:
    """Return the people who could be one another.

    Those are two who could change places, or one who is not seen and could have the pose of
    another, at a cost (A, B) that is higher by less than `MIN_DISTINCTION`. Somebody whose new id
    has no poses yet is not counted: nothing could be mistaken.
    """
    confusable: set[int] = set()
    for a, pose in pose_of.items():
        for other in range(len(cost)):
            others_pose = pose_of.get(other)
            if other == a or (others_pose is None and not has_poses[other]):
                continue
            rise = cost[other, pose] - cost[a, pose]
            if others_pose is not None:
                rise += cost[a, others_pose] - cost[other, others_pose]
            if rise < MIN_DISTINCTION:
                confusable |= {a, other}
    return sorted(confusable)


def _distance(away: Float64Array) -> Float64Array:
    """Mean length over the joints that are known; infinite where none is."""
    length = np.linalg.norm(away, axis=-1)
    known = np.isfinite(length)
    total = np.where(known, length, 0.0).sum(-1)
    return np.where(known.any(-1), total / np.maximum(known.sum(-1), 1), np.inf)


def _size(found: Float64Array) -> float:
    return float(_sizes(found[None])[0])


def _sizes(found: Float64Array) -> Float64Array:
    """Larger sides (P,) of the boxes around poses (P, J, 2), px."""
    sides = np.fmax.reduce(found, axis=1) - np.fmin.reduce(found, axis=1)
    return np.asarray(np.fmax(np.fmax(*sides.T), MIN_SIZE_PX))


def _mean_of_known(values: Float64Array) -> Float64Array:
    known = np.isfinite(values)
    return np.asarray(np.where(known, values, 0.0).sum(0) / np.maximum(known.sum(0), 1))
