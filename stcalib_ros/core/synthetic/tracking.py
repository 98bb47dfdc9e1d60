"""Errors of a tracker: gaps, fragments with new ids, exchanged ids."""

from __future__ import annotations

import numpy as np

from stcalib_ros.core.model.arrays import BoolArray, Float64Array, IntArray

_GAP_S = 2.0
"""Seconds. Mean duration of a stretch without detections of a person. Chosen."""
_MEMORY_S = 0.5
"""Seconds. Gap after which the tracker gives a new id. Chosen: usual trackers keep 15-30 frames."""
_COVERED = 0.8
"""Fraction of its box from which on a person behind another one is not detected. Chosen."""


def missing_stretches(
    rng: np.random.Generator, times: Float64Array, n_people: int, fraction: float
) -> BoolArray:
    """Return where people are not detected (T, P): stretches that make up a fraction on average.

    On and off times are exponential; the process is stationary.
    """
    out = np.zeros((len(times), n_people), dtype=bool)
    if fraction <= 0 or len(times) == 0:
        return out
    seen_s = _GAP_S * (1 - fraction) / fraction
    for person in range(n_people):
        now, hidden = times[0], rng.uniform() < fraction
        while now < times[-1]:
            end = now + rng.exponential(_GAP_S if hidden else seen_s)
            out[(times >= now) & (times < end), person] = hidden
            now, hidden = end, not hidden
    return out


def bursts(
    rng: np.random.Generator,
    times: Float64Array,
    n_people: int,
    rate: float,
    length_s: tuple[float, float],
) -> BoolArray:
    """Short random stretches (T, P), at a rate per person and second."""
    out = np.zeros((len(times), n_people), dtype=bool)
    if rate <= 0 or len(times) == 0:
        return out
    for person in range(n_people):
        n = rng.poisson(rate * (times[-1] - times[0]))
        for start in rng.uniform(times[0], times[-1], n):
            out[(times >= start) & (times < start + rng.uniform(*length_s)), person] = True
    return out


def boxes_of(keypoints: Float64Array) -> Float64Array:
    """Left, top, right and bottom (T, P, 4) of keypoints (T, P, J, 2); NaN if there are none."""
    high = np.where(np.isnan(keypoints), -np.inf, keypoints).max(axis=-2)
    low = np.where(np.isnan(keypoints), np.inf, keypoints).min(axis=-2)
    boxes = np.concatenate([low, high], axis=-1)
    return np.where(np.isfinite(boxes), boxes, np.nan)


def hidden_behind(boxes: Float64Array, depth: Float64Array) -> BoolArray:
    """People (T, P) most of whose box is covered by that of somebody nearer."""
    low = np.maximum(boxes[:, :, None, :2], boxes[:, None, :, :2])
    high = np.minimum(boxes[:, :, None, 2:], boxes[:, None, :, 2:])
    common = np.prod(np.clip(high - low, 0, None), axis=-1)
    own = np.prod(boxes[..., 2:] - boxes[..., :2], axis=-1)
    nearer = depth[:, None, :] < depth[:, :, None]
    return np.asarray(np.any(nearer & (common > _COVERED * own[:, :, None]), axis=2))


def fragment_ids(times: Float64Array, visible: BoolArray) -> IntArray:
    """Assign track ids (T, P), -1 where not observed; long gaps give a new id.

    Ids are given in the order of appearance.
    """
    ids = np.full(visible.shape, -1, dtype=np.int64)
    starts: list[tuple[int, int, IntArray]] = []
    for person in range(visible.shape[1]):
        frames = np.flatnonzero(visible[:, person])
        cuts = np.flatnonzero(np.diff(times[frames]) > _MEMORY_S) + 1
        starts += [(int(p[0]), person, p) for p in np.split(frames, cuts) if len(p)]
    for track_id, (_, person, frames) in enumerate(sorted(starts, key=lambda s: s[:2])):
        ids[frames, person] = track_id
    return ids


def switch_ids(
    rng: np.random.Generator, times: Float64Array, ids: IntArray, boxes: Float64Array, rate: float
) -> IntArray:
    """Track ids with two people's exchanged now and then, mostly when their boxes are close.

    Parameters
    ----------
    rng : Generator
    times : (T,) ndarray
    ids : (T, P) ndarray
        -1 where not observed.
    boxes : (T, P, 4) ndarray
    rate : float
        Exchanges that a person takes part in, per second.
    """
    ids = ids.copy()
    first, second = np.triu_indices(ids.shape[1], 1)
    if rate <= 0 or len(times) < 2 or len(first) == 0 or not (ids >= 0).any():
        return ids
    centre = 0.5 * (boxes[..., :2] + boxes[..., 2:])
    width = np.nanmean(boxes[..., 2] - boxes[..., 0])
    gap = np.linalg.norm(centre[:, first] - centre[:, second], axis=-1) / width
    weight = np.where((ids[:, first] >= 0) & (ids[:, second] >= 0), np.exp(-2 * gap), 0.0)
    weight = np.nan_to_num(weight).ravel()
    if not weight.any():
        return ids
    n = rng.poisson(rate * (times[-1] - times[0]) * ids.shape[1] / 2)
    for event in np.sort(rng.choice(len(weight), size=n, p=weight / weight.sum())):
        frame, pair = divmod(int(event), len(first))
        a, b = ids[frame, first[pair]], ids[frame, second[pair]]
        later = ids[frame:]
        was_a, was_b = later == a, later == b
        later[was_a], later[was_b] = b, a
    return ids
