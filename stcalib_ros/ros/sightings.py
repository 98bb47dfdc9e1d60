"""Who is there, by the calibration in force: people in 3D who keep their numbers; knows no ROS."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from stcalib_ros.core.capture.people import capture_people
from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.calibration import Calibration, CameraCalibration
from stcalib_ros.core.model.keypoint_layouts import Layout
from stcalib_ros.core.monitoring.matching import RATE_HZ
from stcalib_ros.core.options import Options
from stcalib_ros.io.assemble import CameraImages, assemble_recording
from stcalib_ros.io.messages import NS, PoseImage
from stcalib_ros.io.stamps import SAME_CLOCK, ClockCorrection
from stcalib_ros.ros.limits import HOLD_S, SAME_PERSON, SHOWN_HZ, TRACK_MEMORY_S
from stcalib_ros.ros.recognition import SeenImage, recognise

_LEAST_STEP_NS = round(0.75 / RATE_HZ * NS)
"""Nanoseconds. Images of a camera that follow sooner are left out: those of 30 Hz and more are
thinned to `RATE_HZ`, those of 15 Hz with some jitter are not."""

TrackKey = tuple[str, int]
"""Name of a camera and an id of its own tracker."""


@dataclass(frozen=True, slots=True, eq=False)
class SeenPerson:
    """One person over a second or two.

    Attributes
    ----------
    number : int
        Stays the same from one sight to the next.
    layout : Layout
        Names and parents of the J joints.
    times_s : (K,) ndarray
        Uniform, seconds since the Unix epoch, reference clock; something is known at both ends.
    joints_ref : (K, J, 3) ndarray
        In the frame and unit of the calibration; NaN where unknown.
    """

    number: int
    layout: Layout
    times_s: Float64Array
    joints_ref: Float64Array

    def at(self, time_s: float) -> Float64Array:
        """Return the joints (J, 3), between samples on straight lines; NaN beyond the ends."""
        last = len(self.times_s) - 1
        if not self.times_s[0] <= time_s <= self.times_s[-1]:
            return np.full(self.joints_ref.shape[1:], np.nan)
        place = float(np.interp(time_s, self.times_s, np.arange(last + 1)))
        before = min(int(place), max(last - 1, 0))
        a, b = self.joints_ref[before], self.joints_ref[min(before + 1, last)]
        part = place - before
        return np.asarray(a if part == 0.0 else b if part == 1.0 else (1.0 - part) * a + part * b)

    def shown_at(self, time_s: float) -> Float64Array:
        """Return the joints (J, 3); up to `HOLD_S` beyond an end those of the end."""
        first_s, last_s = float(self.times_s[0]), float(self.times_s[-1])
        held_s = min(max(time_s, first_s), last_s)
        return self.at(held_s if abs(held_s - time_s) <= HOLD_S else time_s)

    @property
    def size(self) -> float:
        """Median extent of the body, in the unit of the calibration; 0 if nothing is known."""
        low, high = (f(self.joints_ref, axis=1) for f in (np.fmin.reduce, np.fmax.reduce))
        extent = np.linalg.norm(high - low, axis=-1)
        return float(np.median(extent[np.isfinite(extent)])) if np.isfinite(extent).any() else 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """What was found of a second or two.

    Attributes
    ----------
    start_s, end_s : float
        Its limits, seconds since the Unix epoch, reference clock.
    people : tuple of SeenPerson
    images : mapping of str to tuple of SeenImage
        By camera; their tracks name the numbers of people.
    tracks : mapping of (str, int) to (int, float)
        Number of the person and time when they were last seen, by the cameras' own tracks, those
        of earlier sights as well.
    next_number : int
        Number of the next person who is new.
    """

    start_s: float
    end_s: float
    people: tuple[SeenPerson, ...] = ()
    images: Mapping[str, tuple[SeenImage, ...]] = field(default_factory=dict)
    tracks: Mapping[TrackKey, tuple[int, float]] = field(default_factory=dict)
    next_number: int = 0

    def residual_px(self, camera: str) -> float:
        """Return the median error of the keypoints of a camera; NaN without any."""
        errors = [image.errors_px for image in self.images.get(camera, ())]
        known = np.concatenate(errors) if errors else np.zeros(0)
        return float(np.median(known)) if len(known) else float("nan")


def look(
    windows: Sequence[CameraImages],
    calibration: Calibration,
    clocks: Mapping[str, ClockCorrection],
    options: Options,
    *,
    limits_s: tuple[float, float],
    before: Sighting,
) -> Sighting:
    """Triangulate the people of a second or two, and find them in the images.

    Parameters
    ----------
    windows : sequence of CameraImages
        Of that time only.
    calibration : Calibration
    clocks : mapping of str to ClockCorrection
        Of its cameras.
    options : Options
        For `min_score` and the limits of outliers.
    limits_s : (float, float)
        Begin and end, seconds since the Unix epoch, reference clock.
    before : Sighting
        The last one, whose people keep their numbers.
    """
    cameras = {c.name: c for c in calibration.cameras}
    windows = [_thinned(w) for w in windows if w.name in cameras and w.images]
    people = _captured(windows, calibration, options)
    images = {
        w.name: _seen(w, cameras[w.name], clocks.get(w.name, SAME_CLOCK), people, options.min_score)
        for w in windows
    }
    numbers, next_number = _numbers(people, images, before)
    tracks = {t: known for t, known in before.tracks.items() if known[1] > _old(limits_s)}
    for camera, those in images.items():
        tracks |= {(camera, i): (numbers[p], m.time_s) for m in those for i, p in m.tracks}
    return Sighting(
        *limits_s,
        people=tuple(
            SeenPerson(n, p.layout, p.times_s, p.joints_ref)
            for n, p in zip(numbers, people, strict=True)
        ),
        images=images,
        tracks=tracks,
        next_number=next_number,
    )


def _thinned(window: CameraImages) -> CameraImages:
    """Keep about `RATE_HZ` images per second."""
    kept: list[PoseImage] = []
    for image in window.images:
        if not kept or image.stamp_ns - kept[-1].stamp_ns >= _LEAST_STEP_NS:
            kept.append(image)
    return replace(window, images=kept)


def _old(limits_s: tuple[float, float]) -> float:
    return limits_s[1] - TRACK_MEMORY_S


def _captured(
    windows: Sequence[CameraImages], calibration: Calibration, options: Options
) -> list[SeenPerson]:
    """Return the people, numbered as they come."""
    if not windows:
        return []
    try:
        recording = assemble_recording(windows, warn=lambda _: None)
        found = capture_people(recording, calibration, options).people
    except InputError:  # nobody is there, or in one camera alone; the diagnostics say the rest
        return []
    epoch_s = recording.epoch_ns / NS
    people: list[SeenPerson] = []
    for person in found:
        known = np.flatnonzero(np.isfinite(person.joints_ref).all(-1).any(-1))
        if len(known):
            part = slice(known[0], known[-1] + 1)
            times_s, joints = person.times_s[part] + epoch_s, person.joints_ref[part]
            people.append(SeenPerson(len(people), person.layout, times_s, joints))
    return people


def _seen(
    window: CameraImages,
    camera: CameraCalibration,
    clock: ClockCorrection,
    people: Sequence[SeenPerson],
    min_score: float,
) -> tuple[SeenImage, ...]:
    """Return what is recognised in some images of a camera, `SHOWN_HZ` a second at most."""
    seen: list[SeenImage] = []
    for image in window.images:
        time_s = clock.apply(image.stamp_ns) / NS
        if seen and time_s - seen[-1].time_s < 1.0 / SHOWN_HZ:
            continue
        joints = [person.at(time_s) for person in people]
        layout = people[0].layout if people else image.layout
        seen.append(recognise(image, time_s, camera, joints, layout, min_score=min_score))
    return tuple(seen)


def _numbers(
    people: Sequence[SeenPerson], images: Mapping[str, Iterable[SeenImage]], before: Sighting
) -> tuple[list[int], int]:
    """Return the numbers of people, and the next number that is free.

    Who is where somebody was at the same time of the last sight is the same person; of the others,
    those whom a camera's tracker still has by the same id.
    """
    numbers = _where_they_were(people, before.people)
    for person, number in _by_tracks(images, before.tracks):
        if numbers[person] < 0 and number not in numbers:
            numbers[person] = number
    new = before.next_number
    for person, number in enumerate(numbers):
        if number < 0:
            numbers[person], new = new, new + 1
    return numbers, new


def _where_they_were(people: Sequence[SeenPerson], before: Sequence[SeenPerson]) -> list[int]:
    """Return the numbers of people who are where somebody was; -1: nobody was."""
    numbers = [-1] * len(people)
    if people and before:
        cost = np.array([[_distance(person, other) for other in before] for person in people])
        for row, column in np.transpose(linear_sum_assignment(np.minimum(cost, 1.0))):
            if cost[row, column] < 1.0:
                numbers[row] = before[int(column)].number
    return numbers


def _by_tracks(
    images: Mapping[str, Iterable[SeenImage]], tracks: Mapping[TrackKey, tuple[int, float]]
) -> list[tuple[int, int]]:
    """Return places of people and the numbers that cameras' trackers give them, surest first."""
    votes: Counter[tuple[int, int]] = Counter()
    for camera, those in images.items():
        for own, person in (track for image in those for track in image.tracks):
            if (known := tracks.get((camera, own))) is not None:
                votes[person, known[0]] += 1
    return [pair for pair, _ in votes.most_common()]


def _distance(person: SeenPerson, other: SeenPerson) -> float:
    """Return the median distance of the joints of two at the same times, 1: at the limit."""
    if person.layout != other.layout:
        return np.inf
    there = np.stack([other.at(time_s) for time_s in person.times_s])
    apart = np.linalg.norm(person.joints_ref - there, axis=-1)
    limit = SAME_PERSON * max(person.size, other.size)
    known = apart[np.isfinite(apart)]
    return float(np.median(known)) / limit if len(known) and limit > 0.0 else np.inf
