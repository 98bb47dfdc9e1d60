"""The room as data for the 3D view in the page."""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.core.output.gravity import HEAD
from stcalib_ros.core.reconstruction.trajectories import PersonTrajectory, bones
from stcalib_ros.report.content import ReportContent
from stcalib_ros.report.room import FACE, Person, PlacedCamera, Room
from stcalib_ros.report.style import PEOPLE_ON_SCREEN, camera_colors
from stcalib_ros.report.view import best_view, frustum_depth

_RATE_HZ = 15.0
"""Samples per second of the people: between them, straight lines look smooth to the eye."""
_MOST_NUMBERS = 1_500_000
"""Coordinates of all people: 3 MB, 4 MB as text. Longer recordings have fewer samples a second."""
_STEPS = 30_000
"""Integer steps of a coordinate from the middle of the room to its end."""
_MISSING = -32768
_USUAL_PERSON = 1.7
"""Metres; drawn sizes of people where nobody's size is known."""
_WHOLE = 0.7
"""Fraction of the joints. A person with more of them known has their whole height."""
_SHOWN_ELLIPSOID = 0.03
"""Fraction of the scene. An ellipsoid that is smaller is enlarged, by a round factor."""
_FACTORS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
_USUAL = (3.0, 97.0)
"""Percentiles of the places of a person, which a few wrong points do not move."""
_FAR = 3.0
"""Extents of the cameras. What is further from their middle is no person's place."""


def scene_data(content: ReportContent, room: Room) -> dict[str, Any]:
    """Return cameras, people over time and floor; plain values for JSON.

    Parameters
    ----------
    content : ReportContent
        With camera poses.
    room : Room
        Of the same.
    """
    c = content.calibration
    view, extent = best_view(room), _extent(room)
    colors = camera_colors(camera.name for camera in room.cameras)
    depth, factor = frustum_depth(room), enlargement(c, extent)
    return {
        "size": extent,
        "floor": _floor(room),
        "view": {
            "middle": view.middle.tolist(),
            "towards": view.R[2].tolist(),
            "distance": view.distance,
        },
        "where_people_are": _usual_places(room).tolist(),
        "enlarged": factor,
        "cameras": [
            _camera(camera, depth)
            | {
                "name": camera.name,
                "color": colors[camera.name],
                "ellipsoid": _ellipsoid(own.covariance, room, factor),
            }
            for camera, own in zip(room.cameras, c.cameras, strict=True)
        ],
        "true_cameras": [_camera(camera, depth) for camera in room.true_cameras],
        **_people(room, content.people, extent),
    }


def scene_json(data: dict[str, Any]) -> str:
    """Return it as JSON that may stand in a script of a page."""
    text = json.dumps(_rounded(data), separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


def enlargement(c: Calibration, extent: float) -> int:
    """Return the round factor by which ellipsoids of one standard deviation are drawn larger."""
    largest = max((float(np.sqrt(_largest(camera.covariance))) for camera in c.cameras), default=0)
    wanted = _SHOWN_ELLIPSOID * extent / largest if largest > 0 else 1.0
    return max((factor for factor in _FACTORS if factor <= wanted), default=1)


def _largest(covariance: Float64Array) -> float:
    block = covariance[:3, :3]
    return float(np.linalg.eigvalsh(block).max()) if np.isfinite(block).all() else 0.0


def _ellipsoid(covariance: Float64Array, room: Room, factor: int) -> list[list[float]] | None:
    """Half axes in the room, one standard deviation each; None where unknown or zero."""
    if _largest(covariance) <= 0:
        return None
    variances, axes = np.linalg.eigh(covariance[:3, :3])
    half = axes * (factor * np.sqrt(np.maximum(variances, 1e-12 * variances.max())))
    return [[float(value) for value in axis] for axis in (room.R_room_ref @ half).T]


def _camera(camera: PlacedCamera, depth: float) -> dict[str, Any]:
    return {"centre": camera.centre.tolist(), "corners": camera.frustum(depth).tolist()}


def _usual_places(room: Room) -> Float64Array:
    """Return opposite corners (2 N, 3) of the places of all people but for far-off points."""
    known = [p.joints[np.isfinite(p.joints).all(-1)] for p in room.people]
    corners = [np.percentile(joints, _USUAL, axis=0) for joints in known if len(joints)]
    return np.concatenate([np.zeros((0, 3)), *corners])


def _extent(room: Room) -> float:
    """Return the size of the scene: that of the cameras, and of where people usually are."""
    centres = np.array([camera.centre for camera in room.cameras])
    points = np.concatenate([centres, _usual_places(room)])
    return max(float(np.linalg.norm(np.ptp(points, axis=0))), 1e-6)


def _floor(room: Room) -> list[float]:
    """Return left, right, near and far end of the floor, and the step of its grid."""
    step = 1.0 if room.metric else 0.5
    centres = np.array([camera.centre for camera in room.cameras])
    xy = np.concatenate([centres, _usual_places(room)])[:, :2] / step
    (left, near), (right, far) = np.floor(xy.min(0)) * step, np.ceil(xy.max(0)) * step
    return [float(left), float(right), float(near), float(far), step]


def _people(room: Room, people: Sequence[PersonTrajectory], extent: float) -> dict[str, Any]:
    """People as integers at the times that are shown."""
    if not people:
        nobody = {"people": [], "step_s": 1.0, "length_s": 0.0, "start_s": 0.0}
        return nobody | {"resolution": 1.0, "person_size": _USUAL_PERSON}
    step_s = float(np.median(np.concatenate([np.diff(p.times_s) for p in people])))
    begin = min(float(p.times_s[0]) for p in people)
    end = max(float(p.times_s[-1]) for p in people)
    amount = sum(person.joints.size for person in room.people)
    every = max(1, round(1.0 / (_RATE_HZ * step_s)), -(-amount // _MOST_NUMBERS))
    resolution = _FAR * extent / _STEPS
    shown = []
    for i, (person, path) in enumerate(zip(room.people, people, strict=True)):
        first = round((float(path.times_s[0]) - begin) / step_s)
        samples = _thinned(person.joints, every)
        shown.append(
            _person(person, samples, resolution)
            | {
                "name": f"person {person.person_id}",
                "color": PEOPLE_ON_SCREEN[i % len(PEOPLE_ON_SCREEN)],
                "first": first / every,
            }
        )
    return {
        "people": shown,
        "step_s": every * step_s,
        "length_s": max(end - begin, 0.0),
        "start_s": float(np.clip(_fullest(people) - begin, 0.0, end - begin)),
        "resolution": resolution,
        "person_size": _person_size(room),
    }


def _thinned(joints: Float64Array, every: int) -> Float64Array:
    """Return every n-th sample (K, J, 3); where it is missing, the mean of those around it."""
    if every == 1:
        return joints
    n = -(-len(joints) // every)
    padded = np.full((n * every, *joints.shape[1:]), np.nan)
    padded[: len(joints)] = joints
    blocks = padded.reshape(n, every, *joints.shape[1:])
    known = np.isfinite(blocks)
    mean = np.where(known, blocks, 0.0).sum(1) / np.maximum(known.sum(1), 1)
    mean[~known.any(1)] = np.nan
    return np.where(known[:, 0], blocks[:, 0], mean)


def _person(person: Person, samples: Float64Array, resolution: float) -> dict[str, Any]:
    names = person.layout.joint_names
    steps = np.rint(samples / resolution)
    good = (np.abs(steps) < -_MISSING).all(-1, keepdims=True)
    values = np.where(good, np.nan_to_num(steps), _MISSING).astype("<i2")
    return {
        "n_joints": len(names),
        "bones": [[a, b] for a, b in bones(person.layout) if not FACE & {names[a], names[b]}],
        "head": [names.index(name) for name in HEAD if name in names],
        "data": base64.b64encode(values.tobytes()).decode("ascii"),
    }


def _person_size(room: Room) -> float:
    """Return the usual height of a person, in the unit of the room."""
    tall = [
        np.nanmax(whole[..., 2], axis=1) - np.nanmin(whole[..., 2], axis=1)
        for person in room.people
        if len(whole := person.joints[np.isfinite(person.joints[..., 2]).mean(1) > _WHOLE])
    ]
    return float(np.median(np.concatenate(tall))) if tall else _USUAL_PERSON


def _fullest(people: Sequence[PersonTrajectory]) -> float:
    """Return the time at which most joints are known, of several the one nearest to the middle."""
    times = np.concatenate([person.times_s for person in people])
    known = np.concatenate([np.isfinite(person.joints_ref[..., 0]).sum(1) for person in people])
    moments, which = np.unique(np.round(times, 3), return_inverse=True)
    n_known = np.bincount(which, weights=known)
    best = moments[n_known == n_known.max()]
    return float(best[np.abs(best - moments.mean()).argmin()])


def _rounded(value: Any) -> Any:
    """Return plain data with numbers as precise as a picture needs."""
    if isinstance(value, dict):
        return {key: _rounded(one) for key, one in value.items()}
    if isinstance(value, list):
        return [_rounded(one) for one in value]
    return float(f"{value:.6g}") if isinstance(value, float) else value
