"""Time and memory grow with the data, whatever the stamps and ids are."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import stcalib_ros as st
from stcalib_ros.core.lifting.views import lift_views
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.recording import CameraRecording, Recording
from stcalib_ros.core.registration.limits import MAX_SAMPLES_PER_IMAGE
from stcalib_ros.core.registration.resampling import common_grid

SCENE = st.simulate(st.SceneOptions(n_cameras=2, n_people=3, n_frames=300, seed=4))
K = np.arange(300)
MAX_BYTES = 300e6
"""Bytes, at most; 10 s of three people before two cameras take 60 MB."""

STAMPS: dict[str, tuple[Callable[[Float64Array], Float64Array], tuple[int, ...]]] = {
    "set by hours": (lambda s: np.where(K > 200, s + 1e4, s), (1,)),
    "set by a day": (lambda s: np.where(K > 200, s + 1e5, s), (0,)),
    "set from 1970": (lambda s: np.where(K > 200, s + 1.76e9, s), (1,)),
    "both set": (lambda s: np.where(K > 200, s + 1.76e9, s), (0, 1)),
    "gaps": (lambda s: s + 1e4 * (K // 20), (0, 1)),
    "gaps of one": (lambda s: s + 1e6 * (K // 20), (1,)),
    "bunches": (lambda s: s[0] + (K // 10) / 3.0 + (K % 10) * 1e-6, (0, 1)),
    "bunches, growing": (lambda s: s[0] + np.sqrt(K // 3) + (K % 3) * 1e-6, (0, 1)),
    "nanoseconds": (lambda s: s[0] + K * 1e-9, (0, 1)),
    "nanoseconds of one": (lambda s: s[0] + K * 1e-9, (0,)),
    "a quarter of an hour": (lambda s: s[0] + K * 1e3, (0, 1)),
    "geometric": (lambda s: s[0] + 1.05**K * 1e-5, (0, 1)),
    "random": (lambda s: np.sort(np.random.default_rng(0).pareto(0.3, 300)) + K * 1e-6, (0, 1)),
}


def with_stamps(name: str) -> Recording:
    change, which = STAMPS[name]
    cameras = tuple(
        replace(c, stamps=np.asarray(change(c.stamps), dtype=np.float64)) if i in which else c
        for i, c in enumerate(SCENE.recording.cameras)
    )
    return replace(SCENE.recording, cameras=cameras)


def peak_bytes(recording: Recording) -> tuple[st.Calibration, int]:
    tracemalloc.start()
    try:
        result = st.calibrate(recording)
        return result, tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("name", STAMPS)
def test_whatever_the_stamps_are(name: str) -> None:
    result, peak = peak_bytes(with_stamps(name))
    assert peak < MAX_BYTES
    if result.status is st.Status.OK:
        errors = st.evaluate(result, SCENE.truth)
        assert errors.E_R < 0.02


@pytest.mark.parametrize("name", STAMPS)
def test_grids_have_so_many_samples_per_image(name: str) -> None:
    recording = with_stamps(name)
    grid = common_grid(lift_views(recording, st.Options()).lifted)
    assert grid.n <= MAX_SAMPLES_PER_IMAGE * 300 + 1


def in_pieces(camera: CameraRecording, every: int) -> CameraRecording:
    """Everybody has another id every so many images."""
    tracks = []
    for track in camera.tracks:
        for k in range(0, len(track.frames), every):
            values = {
                name: getattr(track, name)[k : k + every]
                for name in ("frames", "keypoints", "joints", "scores")
            }
            tracks.append(replace(track, track_id=len(tracks), **values))
    return replace(camera, tracks=tuple(tracks))


def test_ids_that_break() -> None:
    cameras = tuple(in_pieces(c, 12) for c in SCENE.recording.cameras)
    _, peak = peak_bytes(replace(SCENE.recording, cameras=cameras))
    assert peak < MAX_BYTES
