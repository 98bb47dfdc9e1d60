"""A part of a recording in time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from stcalib_ros.core.types import CameraRecording, Recording


def excerpt(
    recording: Recording,
    start_s: float,
    end_s: float,
    *,
    offsets_s: Mapping[str, float] | None = None,
) -> Recording:
    """Images with ``start_s <= stamp < end_s``; cameras without any stay, empty.

    Parameters
    ----------
    recording : Recording
    start_s, end_s : float
        Seconds since the epoch of the recording.
    offsets_s : mapping of str to float, optional
        By camera, what to add to its stamps before they are compared.
    """
    offsets = offsets_s or {}
    return replace(
        recording,
        cameras=tuple(
            _part(c, start_s - offsets.get(c.name, 0.0), end_s - offsets.get(c.name, 0.0))
            for c in recording.cameras
        ),
    )


def _part(camera: CameraRecording, start_s: float, end_s: float) -> CameraRecording:
    first, last = np.searchsorted(camera.stamps, [start_s, end_s])
    tracks = []
    for track in camera.tracks:
        a, b = np.searchsorted(track.frames, [first, last])
        if b > a:
            tracks.append(
                replace(
                    track,
                    frames=track.frames[a:b] - first,
                    keypoints=track.keypoints[a:b],
                    joints=track.joints[a:b],
                    scores=track.scores[a:b],
                )
            )
    return replace(camera, stamps=camera.stamps[first:last], tracks=tuple(tracks))
