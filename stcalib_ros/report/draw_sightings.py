"""When each camera saw whom, by its own clock."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from stcalib_ros.core.geometry.interpolation import frame_period
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.recording import CameraRecording, Recording
from stcalib_ros.report.style import FAINT, PALETTE

_BRIDGED = 2.6
"""Gaps up to this many frame periods are drawn through."""


def sightings_figure(recording: Recording) -> Figure:
    """Draw a line per track, a row per camera, against the camera's own stamps."""
    cameras = recording.cameras
    figure = Figure(figsize=(10.0, 0.7 + 0.45 * len(cameras)), layout="constrained")
    ax = figure.subplots()
    for i, camera in enumerate(cameras):
        color = PALETTE[i % len(PALETTE)]
        if len(camera.stamps):
            span = camera.stamps[[0, -1]]
            ax.plot(span, [i, i], color=FAINT, linewidth=0.6, zorder=1)
        for k, track in enumerate(camera.tracks):
            y = i + 0.35 - 0.7 * (k + 1) / (len(camera.tracks) + 1)
            for begin, end in _stretches(camera, camera.stamps[track.frames]):
                ax.plot([begin, end], [y, y], color=color, linewidth=2.5)
    ax.set_yticks(range(len(cameras)), [camera.name for camera in cameras])
    ax.set_ylim(len(cameras) - 0.4, -0.6)
    ax.grid(axis="y", visible=False)
    ax.set_xlabel("stamp of the camera's own clock [s]")
    return figure


def _stretches(camera: CameraRecording, times: Float64Array) -> list[tuple[float, float]]:
    """Intervals in which a track is seen without gaps."""
    if not len(times):
        return []
    cuts = np.flatnonzero(np.diff(times) > _BRIDGED * frame_period(camera.stamps)) + 1
    return [(float(part[0]), float(part[-1])) for part in np.split(times, cuts)]
