"""The stamps of every camera, before anything is computed from them.

Images that were stamped on arrival come in bunches, as a buffer lets them go; a clock that is set
jumps; what no other camera can have seen at that time is of no use.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.geometry.interpolation import mean_period
from stcalib_ros.core.geometry.robust import median_of_known
from stcalib_ros.core.lifting.limits import (
    CLOSEST_IMAGES_S,
    EVEN_RATIO,
    IMPOSSIBLE_RATIO,
    MANY_SHORT,
    MAX_GRID_FACTOR,
    MOVING_QUANTILE,
    OVERLAP_MARGIN_S,
    SHORT_INTERVAL,
    SOME_SHORT,
    UNEVEN_POSITION,
    VERY_SHORT_INTERVAL,
)
from stcalib_ros.core.model.arrays import BoolArray, Float64Array, IntArray
from stcalib_ros.core.model.recording import CameraRecording, Recording, Track, only_images
from stcalib_ros.core.model.rejection import Rejection, RejectionReason, Remark, RemarkCode
from stcalib_ros.core.options import Options

_SPAN_S = 15.0
"""Seconds of stamps that are fitted by one line. Chosen: clocks of cameras wander less within that
than bunches are long."""
_SLACK_PERIODS = 1.5
"""Frame periods. Stamps in bunches of n are up to n - 1 periods from even ones, and may be off by
this in addition. Chosen: half a bunch at an end, and jitter."""


@dataclass(frozen=True, slots=True, eq=False)
class TimeBase:
    """A recording whose stamps can be relied on, and what was done to it.

    Attributes
    ----------
    recording : Recording
    faults : mapping of str to Rejection
        Why the stamps of a camera cannot be used, by its name.
    remarks : tuple of Remark
    """

    recording: Recording
    faults: Mapping[str, Rejection]
    remarks: tuple[Remark, ...]


def mended_time_base(recording: Recording, options: Options) -> TimeBase:
    """Put stamps right where that is possible, and leave out what no other camera can share.

    Parameters
    ----------
    recording : Recording
    options : Options
    """
    faults: dict[str, Rejection] = {}
    remarks: list[Remark] = []
    cameras = []
    for camera in recording.cameras:
        mended, said = _evened(camera)
        if isinstance(said, Rejection):
            faults[camera.name] = said
        elif said is not None:
            remarks.append(said)
        cameras.append(mended)
    shared = _shared_images([c for c in cameras if c.name not in faults], options)
    for k, camera in enumerate(cameras):
        used = shared.get(camera.name)
        if used is not None and not used.all():
            left_out = {"n_left_out": int((~used).sum()), "n_images": len(used)}
            remarks.append(Remark(RemarkCode.IMAGES_LEFT_OUT, (camera.name,), left_out))
            cameras[k] = only_images(camera, used)
    return TimeBase(replace(recording, cameras=tuple(cameras)), faults, tuple(remarks))


def _evened(camera: CameraRecording) -> tuple[CameraRecording, Remark | Rejection | None]:
    """Return a camera with even stamps where its stamps come in bunches.

    Where images were taken evenly, keypoints move as far within a bunch as from one to the next.
    """
    stamps, period = camera.stamps, mean_period(camera.stamps)
    if not np.isfinite(period) or not camera.tracks:
        return camera, None
    if period < CLOSEST_IMAGES_S:
        reason = RejectionReason.STAMPS_TOO_CLOSE
        return camera, Rejection(reason, (camera.name,), period, CLOSEST_IMAGES_S, "s")
    intervals = np.diff(stamps)
    short = intervals < SHORT_INTERVAL * period
    share, very_short = float(short.mean()), intervals < VERY_SHORT_INTERVAL * period
    if share < MANY_SHORT and very_short.mean() < SOME_SHORT:
        return camera, None
    even, bunch = _lines(stamps, short), _longest_run(short) + 1
    within, period = float(np.median(intervals[short])), float(np.median(np.diff(even)))
    worst_ratio = IMPOSSIBLE_RATIO if within < CLOSEST_IMAGES_S else EVEN_RATIO
    lossless = np.ptp(stamps - even) <= (bunch - 1 + _SLACK_PERIODS) * period
    possible = lossless and (np.diff(even) > 0.0).all()
    if _roughness_ratio(camera, even) > worst_ratio or (share < MANY_SHORT and not possible):
        return camera, None
    values = {"bunch": float(bunch), "within_ms": 1e3 * within, "period_ms": 1e3 * period}
    if possible:
        remark = Remark(RemarkCode.STAMPS_EVENED, (camera.name,), values)
        return replace(camera, stamps=even), remark
    reason = RejectionReason.STAMPS_IN_BUNCHES
    return camera, Rejection(reason, (camera.name,), share, MANY_SHORT, values=values)


def _lines(stamps: Float64Array, short: BoolArray) -> Float64Array:
    """Return even stamps: a line over the count of the images for every quarter of a minute.

    The rate is that of the last images of bunches, which waited least; the mean is that of all.
    """
    out = np.empty_like(stamps)
    last = np.concatenate([~short, [True]])
    n_spans = max(1, min(round(float(np.ptp(stamps)) / _SPAN_S), int(last.sum()) // 4))
    for part in np.array_split(np.arange(len(stamps)), n_spans):
        count, since = part - part[0], stamps[part] - stamps[part[0]]
        fitted = last[part] if last[part].sum() > 1 else np.ones(len(part), dtype=bool)
        slope, _ = np.polyfit(count[fitted], since[fitted], 1)
        out[part] = stamps[part[0]] + since.mean() + slope * (count - count.mean())
    return out


def _longest_run(flags: BoolArray) -> int:
    """Return how many flags are set in a row at most."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return int((edges[1::2] - edges[::2]).max(initial=0))


def _roughness_ratio(camera: CameraRecording, even: Float64Array) -> float:
    """Return how rough the motion of the keypoints is by even stamps, over that by the stamps.

    By images between two others that the stamps do not put into the middle, of people who move.
    1 where nothing is known.
    """
    rough = []
    for times in (camera.stamps, even):
        found = [_roughness(track, camera.stamps, times) for track in camera.tracks]
        squares, moved = (np.concatenate(column) for column in zip(*found, strict=True))
        if not len(moved):
            return 1.0
        moving = moved >= np.quantile(moved, MOVING_QUANTILE)
        rough.append(float(np.mean(np.sqrt(squares[moving]))))
    return (rough[1] / rough[0]) ** 2 if rough[0] > 0.0 else 1.0


def _roughness(
    track: Track, stamps: Float64Array, times: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Squared distance (T,) of joints from between the images before and after, and their way."""
    first = np.flatnonzero(track.frames[2:] - track.frames[:-2] == 2)
    by_stamps = _position(stamps[track.frames], first)
    first = first[np.abs(by_stamps - 0.5) > UNEVEN_POSITION]
    u = _position(times[track.frames], first)[:, None, None]
    x: Float64Array = track.keypoints.astype(np.float64)
    before, here, after = (x[first + k] for k in range(3))
    gaps = here - (1.0 - u) * before - u * after
    squares = median_of_known((gaps**2).sum(-1)) / (1.0 + u**2 + (1.0 - u) ** 2)[:, 0, 0]
    way = median_of_known(np.linalg.norm(after - before, axis=-1))
    known = np.isfinite(squares) & np.isfinite(way)
    return squares[known], way[known]


def _position(times: Float64Array, first: IntArray) -> Float64Array:
    """Return where the second of three times is between the first (0) and the third (1)."""
    return np.asarray((times[first + 1] - times[first]) / (times[first + 2] - times[first]))


def _shared_images(cameras: Sequence[CameraRecording], options: Options) -> dict[str, BoolArray]:
    """Return which images of cameras another one can share, where there is time without images.

    Where all of the time between the first and the last image is covered, as usual, all are.
    """
    seeing = [c for c in cameras if c.tracks]
    used = {c.name: np.ones(len(c.stamps), dtype=bool) for c in seeing}
    if not _mostly_empty(seeing, used):
        return {}
    reach = 2.0 * options.offset_range_s + OVERLAP_MARGIN_S
    for camera in seeing:
        others = [c.stamps for c in seeing if c is not camera]
        near = np.any([_near(camera.stamps, other, reach) for other in others], axis=0)
        if np.any(near):
            used[camera.name] = near
    if _mostly_empty(seeing, used):
        begin, end = _fullest(np.concatenate([c.stamps[used[c.name]] for c in seeing]), reach)
        for camera in seeing:
            inside = used[camera.name] & (camera.stamps >= begin) & (camera.stamps <= end)
            if inside.any():
                used[camera.name] = inside
    return used


def _mostly_empty(cameras: Sequence[CameraRecording], used: Mapping[str, BoolArray]) -> bool:
    """Whether a grid over all images would have many times as many samples as there are images."""
    parts = [part for c in cameras if len(part := c.stamps[used[c.name]])]
    if len(parts) < 2:
        return False
    span = max(float(p[-1]) for p in parts) - min(float(p[0]) for p in parts)
    covered = max((len(p) * mean_period(p) for p in parts if len(p) > 1), default=0.0)
    return bool(span > MAX_GRID_FACTOR * covered)


def _near(stamps: Float64Array, others: Float64Array, reach_s: float) -> BoolArray:
    """Return which stamps (N,) have one of another camera within reach."""
    low = np.searchsorted(others, stamps - reach_s, side="left")
    high = np.searchsorted(others, stamps + reach_s, side="right")
    return np.asarray(high > low)


def _fullest(stamps: Float64Array, reach_s: float) -> tuple[float, float]:
    """Return begin and end of the stretch without long gaps that has the most of all stamps."""
    times = np.sort(stamps)
    edges = np.concatenate([[0], np.flatnonzero(np.diff(times) > reach_s) + 1, [len(times)]])
    k = int(np.diff(edges).argmax())
    return float(times[edges[k]]), float(times[edges[k + 1] - 1])
