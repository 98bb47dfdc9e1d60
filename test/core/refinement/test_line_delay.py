"""Line times that are estimated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundle_helpers import problem, stepped
from core_helpers import HALF_SECOND, error

from stcalib_ros.core.bundle.normal_equations import Block
from stcalib_ros.core.bundle.parameters import LINE_DELAY, POSE_AND_CLOCK, ParameterLayout
from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.rolling_shutter import with_known_line_times
from stcalib_ros.core.options import Options, RegistrationOptions
from stcalib_ros.core.pipeline import calibrate
from stcalib_ros.core.synthetic import SceneOptions, simulate
from stcalib_ros.io.mocap import shipped_clips
from stcalib_ros.wording import line_delay_text

ESTIMATE = replace(HALF_SECOND, estimate_line_time=True)
LINES_S = (25e-6, 0.0, 20e-6)
ROLLING = SceneOptions(
    n_frames=200, n_cameras=3, id_switches_per_10s=0, line_time_s=LINES_S, seed=3
)


@pytest.fixture(scope="module")
def scene():
    return simulate(ROLLING, clips=shipped_clips())


@pytest.fixture(scope="module")
def found(scene):
    return calibrate(scene.recording, ESTIMATE)


def test_the_normal_equations_are_those_of_central_differences(rng):
    """Of the cost that is left when the points have followed, written out densely."""
    p = problem(rng, sigma_px=0.5, missing=0.1)
    N, C, J = p.o.observed.shape
    o = replace(p.o, row=rng.uniform(-400, 400, (N, C, J)), line_s=np.zeros(C))
    scale, every = 1e6, np.ones(C, dtype=bool)
    layout = ParameterLayout(C).with_unknown(LINE_DELAY, every)

    def residual(state, line_s):
        moved = replace(o, line_s=line_s)
        block = Block(moved, state.inlier, state.V, state.A, slice(0, N))
        at = block.at(state.cameras, state.X.reshape(-1, 3)[block.points], layout)
        return at, (at.r * block.mask[:, None]).ravel()

    at, r = residual(p.truth, np.zeros(C))
    columns = []
    for k in range(8 * C + 3 * N * J):
        h = 1e-9 if 7 * C <= k < 8 * C else 1e-6
        step = np.zeros(8 * C + 3 * N * J)
        step[k] = h
        moved = [
            residual(
                stepped(
                    p.truth,
                    sign * step[: 7 * C].reshape(C, 7),
                    sign * step[8 * C :].reshape(N, J, 3),
                ),
                sign * step[7 * C : 8 * C],
            )[1]
            for sign in (1, -1)
        ]
        columns.append((moved[0] - moved[1]) / (2 * h))
    A = np.array(columns).T
    a, b = A[:, : 8 * C], A[:, 8 * C :]
    free = np.abs(b).max(0) > 0
    b = b[:, free]
    follow = np.linalg.solve(b.T @ b, np.c_[b.T @ a, b.T @ r])
    system, scores = at.scores(scale)
    standard = [layout.columns(one) for one in POSE_AND_CLOCK]
    order = np.r_[np.concatenate(standard, 1).ravel(), layout.scalars(LINE_DELAY)]
    H, scores = system.H[np.ix_(order, order)], scores[order]
    unit = np.sqrt(np.diag(H))
    np.testing.assert_allclose(
        H / np.outer(unit, unit), (a.T @ (a - b @ follow[:, :-1])) / np.outer(unit, unit), atol=1e-4
    )
    expected = a.T @ (r - b @ follow[:, -1])
    np.testing.assert_allclose(scores.sum(1) / unit, expected / unit, atol=1e-3)


def test_line_times_are_found_within_their_deviations(found):
    for camera, line_s in zip(found.cameras, LINES_S, strict=True):
        assert camera.line_time_s == pytest.approx(line_s, abs=4e-6)
        assert abs(camera.line_time_s - line_s) < 3.0 * camera.line_time_stddev_s
        assert camera.line_time_stddev_s < 3e-6
        assert "+-" in line_delay_text(camera)


def test_estimated_is_nearly_as_good_as_given(scene, found):
    lines = {camera.name: camera.line_time_s for camera in scene.truth.cameras}
    ignored = error(calibrate(scene.recording, HALF_SECOND), scene.truth)
    given = error(
        calibrate(with_known_line_times(scene.recording, lines), HALF_SECOND), scene.truth
    )
    estimated = error(found, scene.truth)
    assert max(given.E_R, estimated.E_R) < 0.6 * ignored.E_R
    assert max(given.E_delta, estimated.E_delta) < 0.2 * ignored.E_delta


def test_offsets_are_of_the_first_row_and_know_how_well(scene, found):
    for true, camera in zip(scene.truth.cameras[1:], found.cameras[1:], strict=True):
        off = abs(camera.time_offset_s - true.time_offset_s)
        assert off < 4.0 * camera.time_offset_stddev_s
        # The offset of the rows where people are would be off by 10 ms.
        assert off < 1.5e-3


def test_what_is_known_of_a_line_time_is_where_the_search_begins(scene, found):
    lines = {camera.name: camera.line_time_s for camera in scene.truth.cameras}
    again = calibrate(with_known_line_times(scene.recording, lines), ESTIMATE)
    for one, other in zip(found.cameras, again.cameras, strict=True):
        assert one.line_time_s == pytest.approx(other.line_time_s, abs=one.line_time_stddev_s)


def test_synchronised_clocks_hold_for_the_first_row():
    scene = simulate(replace(ROLLING, max_offset_frames=0), clips=shipped_clips())
    found = calibrate(scene.recording, Options(offset_range_s=0.0, estimate_line_time=True))
    for camera, line_s in zip(found.cameras, LINES_S, strict=True):
        assert camera.time_offset_s == 0.0
        assert camera.line_time_s == pytest.approx(line_s, abs=3e-6)


def test_what_the_recording_does_not_tell_stays_as_given():
    options = replace(ROLLING, people="gesturing", n_people=1, n_frames=60, line_time_s=0.0)
    recording = simulate(options).recording
    found = calibrate(with_known_line_times(recording, {"cam1": 5e-6}), ESTIMATE)
    assert found.cameras
    for camera in found.cameras:
        assert camera.line_time_s == (5e-6 if camera.name == "cam1" else 0.0)
        assert camera.line_time_stddev_s * camera.intrinsics.height > 8e-3
        assert "not observable" in line_delay_text(camera)


def test_the_method_of_the_paper_takes_them_as_given():
    with pytest.raises(InputError, match="method vmf takes line times as they are given"):
        Options(estimate_line_time=True, registration=RegistrationOptions(method="vmf"))
