"""Changes of a simulated scene that poorer pose estimators and trackers would make."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from stcalib_ros.core.model.calibration import PersonAssociation
from stcalib_ros.core.model.recording import Track
from stcalib_ros.core.synthetic import Scene

TRACK_FRAMES = 15
"""Images. Length of the pieces that `cut_tracks` cuts tracks into: half a second at 30 fps, as from
trackers that lose people at every crossing. From the project's requirements."""
MISSING_JOINTS = 0.5
"""Fraction of the joints of every image that `without_half_of_joints` removes. From the project's
requirements."""

_RNG = 12
"""Seed beside that of the scene: which joints are missing, independent of the simulator. Chosen."""

Alteration = Callable[[Scene], Scene]


def without_half_of_joints(scene: Scene) -> Scene:
    """Remove half of the joints of every person and image, 2D and 3D, at random."""
    rng = np.random.default_rng([scene.options.seed, _RNG])

    def poorer(track: Track) -> Track:
        order = rng.random(track.scores.shape).argsort(1).argsort(1)
        missing = order < MISSING_JOINTS * track.scores.shape[1]
        return replace(
            track,
            keypoints=np.where(missing[..., None], np.nan, track.keypoints),
            joints=np.where(missing[..., None], np.nan, track.joints),
            scores=np.where(missing, 0.0, track.scores),
        )

    cameras = tuple(
        replace(camera, tracks=tuple(map(poorer, camera.tracks)))
        for camera in scene.recording.cameras
    )
    return replace(scene, recording=replace(scene.recording, cameras=cameras))


def cut_tracks(scene: Scene) -> Scene:
    """Cut all tracks every `TRACK_FRAMES` images, with new ids; the truth knows them."""
    cameras, persons = [], scene.truth.persons
    for camera in scene.recording.cameras:
        pieces: dict[int, list[Track]] = {}
        n = 0
        for track in camera.tracks:
            pieces[track.track_id] = _pieces(track, n)
            n += len(pieces[track.track_id])
        cameras.append(replace(camera, tracks=tuple(t for own in pieces.values() for t in own)))
        ids = {old: tuple(t.track_id for t in own) for old, own in pieces.items()}
        persons = tuple(_renamed(person, camera.name, ids) for person in persons)
    return replace(
        scene,
        recording=replace(scene.recording, cameras=tuple(cameras)),
        truth=replace(scene.truth, persons=persons),
        track_persons={},
    )


def _pieces(track: Track, first_id: int) -> list[Track]:
    block = track.frames // TRACK_FRAMES
    return [
        replace(track[block == b], track_id=first_id + k) for k, b in enumerate(np.unique(block))
    ]


def _renamed(
    person: PersonAssociation, camera: str, ids: dict[int, tuple[int, ...]]
) -> PersonAssociation:
    tracks = {
        name: tuple(new for old in own for new in ids[old]) if name == camera else own
        for name, own in person.tracks.items()
    }
    return replace(person, tracks=tracks)
