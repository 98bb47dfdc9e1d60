"""Kinds D and F: units, given lengths, and faults of one camera's own keypoints and poses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from benchmarks.field.case import SOUND, Case, Member, simulated
from benchmarks.field.changes import change_joints, change_keypoints, change_tracks, each
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.recording import CameraRecording, Track, keypoints_only
from stcalib_ros.core.model.scale_cues import Distance
from stcalib_ros.core.options import Options, ScaleOptions
from stcalib_ros.core.synthetic import SceneOptions

_CHANGED = ("cam1",)
_ALL: tuple[str, ...] = ()

_AXES = {
    "y up, z backwards": np.diag([1.0, -1.0, -1.0]),
    "x left, y forward, z up": np.array([[-1.0, 0, 0], [0, 0, 1], [0, -1, 0]]),
    "x forward, y left, z up": np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]),
}
"""Axes of other programs, from those of the optical frame."""


def _base(seed: int) -> Case:
    case = simulated(SceneOptions(seed=23_000 + seed))
    cameras = tuple(replace(camera, metric=True) for camera in case.recording.cameras)
    return replace(case, recording=replace(case.recording, cameras=cameras))


def _joints(
    seed: int, change: Callable[[Float64Array], Float64Array], cameras: tuple[str, ...]
) -> Case:
    return each(_base(seed), cameras, lambda c: change_joints(c, change))


def _keypoints(
    seed: int, change: Callable[[Float64Array], Float64Array], cameras: tuple[str, ...]
) -> Case:
    return each(_base(seed), cameras, lambda c: change_keypoints(c, change))


def _tracks(seed: int, change: Callable[[Track], Track], cameras: tuple[str, ...]) -> Case:
    return each(_base(seed), cameras, lambda c: change_tracks(c, change))


def _normalised(joints: Float64Array) -> Float64Array:
    """Let the root be the origin and the body about two units tall, as lifters normalise it."""
    centred = joints - np.nanmean(joints, 1, keepdims=True)
    return np.asarray(centred / (0.5 * np.nanmax(np.abs(centred))))


def _measured(seed: int, factors: tuple[float, ...]) -> Case:
    """Give distances of the first camera to others, off by these factors."""
    case = _base(seed)
    cameras = case.truths[0].cameras
    lengths = [float(np.linalg.norm(c.t_ref_cam)) for c in cameras[1:]]
    distances = tuple(
        Distance(factor * length, 0.01, ("cam0", camera.name))
        for factor, length, camera in zip(factors, lengths, cameras[1:], strict=False)
    )
    return replace(case, options=Options(scale=ScaleOptions(distances=distances)))


def _zeroed(track: Track, value: float) -> Track:
    """Set uncertain keypoints to one value and keep their scores, some above the limit."""
    rng = np.random.default_rng([track.track_id, len(track.frames)])
    low = rng.random(track.scores.shape) < 0.25
    scores = np.where(low, rng.uniform(0.05, 0.5, low.shape), rng.uniform(0.5, 1.0, low.shape))
    keypoints = np.where(low[..., None], value, track.keypoints)
    return replace(track, keypoints=keypoints, scores=scores)


def _renamed(camera: CameraRecording, order: str) -> CameraRecording:
    """Give poses the ids of an estimator without a tracker, image by image."""
    rng = np.random.default_rng(7)
    rows = [
        (frame, t, k)
        for t, track in enumerate(camera.tracks)
        for k, frame in enumerate(track.frames)
    ]
    images: dict[int, list[tuple[int, int]]] = {}
    for frame, t, k in rows:
        images.setdefault(int(frame), []).append((t, k))
    found: dict[int, list[tuple[int, int, int]]] = {}
    n = 0
    for frame in sorted(images):
        people = images[frame]
        if order == "index":
            people = [people[i] for i in rng.permutation(len(people))]
        for place, (t, k) in enumerate(people):
            found.setdefault(n if order == "detection" else place, []).append((frame, t, k))
            n += 1
    tracks = []
    for track_id, own in found.items():
        parts = [(camera.tracks[t], k) for _, t, k in own]
        tracks.append(
            Track(
                track_id,
                np.array([frame for frame, _, _ in own]),
                np.stack([track.keypoints[k] for track, k in parts]),
                np.stack([track.joints[k] for track, k in parts]),
                np.stack([track.scores[k] for track, k in parts]),
            )
        )
    return replace(camera, tracks=tuple(tracks))


def _untracked(seed: int, order: str) -> Case:
    case = each(_base(seed), _ALL, lambda c: _renamed(c, order))
    truth = replace(case.truths[0], persons=())
    return replace(case, truths=(truth,))


def _frozen(track: Track) -> Track:
    """Let the picture stand still from a third of the clip on."""
    row = np.minimum(np.arange(len(track.frames)), len(track.frames) // 3)
    return replace(
        track,
        keypoints=track.keypoints[row],
        joints=track.joints[row],
        scores=track.scores[row],
    )


def _mirrored(seed: int) -> Case:
    """Let a camera show a mirror image, and its estimator name left and right as it sees them."""
    case = _base(seed)
    layout = case.recording.cameras[0].layout
    order = layout.joint_names
    other = {"left": "right", "right": "left"}
    swap = np.array(
        [order.index("_".join(other.get(w, w) for w in name.split("_"))) for name in order]
    )

    def change(track: Track) -> Track:
        x, joints = track.keypoints[:, swap].copy(), track.joints[:, swap].copy()
        x[..., 0], joints[..., 0] = 1919.0 - x[..., 0], -joints[..., 0]
        return replace(track, keypoints=x, joints=joints, scores=track.scores[:, swap])

    return each(case, _CHANGED, lambda c: change_tracks(c, change))


def _swapped(x: Float64Array) -> Float64Array:
    return np.asarray(x[..., ::-1])


def _percent(track: Track) -> Track:
    return replace(track, scores=100.0 * track.scores)


def _unsure(track: Track) -> Track:
    return replace(track, scores=0.2 * track.scores)


def _without_3d(seed: int) -> Case:
    case = _base(seed)
    return replace(case, recording=keypoints_only(case.recording))


INPUTS = (
    Member("D", "millimetres", lambda s: _joints(s, lambda j: 1e3 * j, _ALL)),
    Member("D", "millimetres, one camera", lambda s: _joints(s, lambda j: 1e3 * j, _CHANGED)),
    Member("D", "bodies of two units", lambda s: _joints(s, _normalised, _ALL)),
    Member("D", "half size, one camera", lambda s: _joints(s, lambda j: 0.5 * j, _CHANGED)),
    Member("D", "distance 3.4 times as long", lambda s: _measured(s, (3.4,))),
    Member("D", "distances that contradict", lambda s: _measured(s, (1.0, 1.5))),
    *(
        Member("F", f"3D poses {name}", lambda s, A=A: _joints(s, lambda j: j @ A.T, _ALL))
        for name, A in _AXES.items()
    ),
    Member(
        "F",
        "3D poses of other axes, one camera",
        lambda s: _joints(s, lambda j: j @ _AXES["x forward, y left, z up"].T, _CHANGED),
    ),
    Member(
        "F", "uncertain keypoints at 0, 0", lambda s: _tracks(s, lambda t: _zeroed(t, 0.0), _ALL)
    ),
    Member("F", "the same at -1, -1", lambda s: _tracks(s, lambda t: _zeroed(t, -1.0), _ALL)),
    Member("F", "no tracker: new ids", lambda s: _untracked(s, "detection")),
    Member("F", "no tracker: places in the list", lambda s: _untracked(s, "index")),
    Member("F", "frozen stream", lambda s: _tracks(s, _frozen, _CHANGED)),
    Member("F", "mirrored view", _mirrored),
    Member("F", "x and y exchanged", lambda s: _keypoints(s, _swapped, _CHANGED)),
    Member("F", "scores in percent", lambda s: _tracks(s, _percent, _CHANGED)),
    Member("F", "scores below the limit", lambda s: _tracks(s, _unsure, _CHANGED)),
    Member("F", "no 3D poses", _without_3d, SOUND),
)
