"""Which true person each person of a calibration is."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np

from benchmarks.film.compare import JOINT_NAMES
from benchmarks.film.references import Reference, TrueReference
from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.core.model.recording import CameraRecording, Recording, Track

_OWN = 0.8
"""Fraction of its images from which on a track is of one person. Chosen: people who walk past each
other may exchange ids for some images, but not for a fifth of a track."""


def people_right(result: Calibration, recording: Recording, folder: Path) -> int:
    """Return how many persons of a result are one true person in every camera, each another one.

    Parameters
    ----------
    result : Calibration
    recording : Recording
        What it was made of; its stamps start at the first image of each film.
    folder : Path
        With the truth of the film.
    """
    reference = TrueReference(folder)
    owners = {
        (camera.name, track.track_id): _owner(camera, track, reference)
        for camera in recording.cameras
        for track in camera.tracks
    }
    found: Counter[int] = Counter()
    for person in result.persons:
        whose = {
            owners.get((camera, track)) for camera, ids in person.tracks.items() for track in ids
        }
        if len(whose) == 1 and (one := whose.pop()) is not None:
            found[one] += 1
    return sum(count == 1 for count in found.values())


def _owner(camera: CameraRecording, track: Track, reference: Reference) -> int | None:
    """Return the person whom a track shows in nearly all of its images; None: no one person."""
    order = [camera.layout.joint_names.index(name) for name in JOINT_NAMES]
    nearest: Counter[int] = Counter()
    for frame, keypoints in zip(track.frames, track.keypoints[:, order], strict=True):
        seen = reference.seen(camera.name, float(camera.stamps[frame] - camera.stamps[0]), frame)
        distance = np.linalg.norm(seen.keypoints - keypoints, axis=-1)
        known = np.isfinite(distance)
        mean = np.where(known, distance, 0.0).sum(-1) / np.maximum(known.sum(-1), 1)
        nearest[int(np.argmin(np.where(known.any(-1), mean, np.inf)))] += 1
    (person, count), *_ = nearest.most_common(1)
    return person if count >= _OWN * len(track.frames) else None
