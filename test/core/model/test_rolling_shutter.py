"""Rolling shutters: what is given, and what is made of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import EXACT, FRAME_S, HALF_SECOND, error, lifted, true_rig
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from stcalib_ros.core.bundle.observations import observe
from stcalib_ros.core.bundle.residuals import errors_px
from stcalib_ros.core.bundle.state import initial_state
from stcalib_ros.core.errors import InputError
from stcalib_ros.core.integration.association import associate
from stcalib_ros.core.lifting.input_checks import require_line_times
from stcalib_ros.core.model.recording import Intrinsics, LensModel
from stcalib_ros.core.model.rolling_shutter import Shutter, with_known_line_times
from stcalib_ros.core.pipeline import calibrate
from stcalib_ros.core.registration.resampling import common_step
from stcalib_ros.core.synthetic import SceneOptions, simulate
from stcalib_ros.core.synthetic.people import PersonMotion
from stcalib_ros.core.synthetic.shutter import joints_by_row
from stcalib_ros.core.synthetic.skeleton import N_JOINTS

LINE_S = 25e-6
LENS = Intrinsics(
    1920,
    1080,
    LensModel.PLUMB_BOB,
    np.array([[1400.0, 0, 960], [0, 1400, 540], [0, 0, 1]]),
    np.zeros(0),
)
SCENE = replace(EXACT, line_time_s=(LINE_S, 0.0, 20e-6, LINE_S))


def true_lines(scene):
    return {camera.name: camera.line_time_s for camera in scene.truth.cameras}


@pytest.fixture(scope="module")
def scene():
    """No errors at all but rolling shutters, three out of four."""
    return simulate(SCENE)


@settings(max_examples=15)
@given(
    start=st.tuples(*[st.floats(-1, 1)] * 2),
    velocity=st.tuples(*[st.floats(-3, 3)] * 2),
    depth=st.floats(3, 6),
    line_s=st.floats(1e-6, 30e-6),
)
def test_a_point_of_constant_velocity_is_seen_where_it_meets_the_row(
    start, velocity, depth, line_s
):
    """At constant depth ``v = f (y + u (t + l v)) / Z + c`` is linear in v."""
    times = np.linspace(-1, 1, 9)
    path = np.array([*start, depth]) + times[:, None] * np.array([*velocity, 0.0])
    person = PersonMotion(CubicSpline(times, np.tile(path, N_JOINTS)), np.ones(N_JOINTS))
    at = np.array([0.0, 0.1])
    found = joints_by_row(person, at, np.eye(3)[None], np.zeros((1, 3)), LENS, line_s)
    f, c = 1400.0, 540.0
    moving = f * velocity[1] / depth
    row = (f * start[1] / depth + c + moving * at) / (1.0 - moving * line_s)
    when = at + line_s * np.clip(row, 0.0, LENS.height)
    expected = np.array([*start, depth]) + when[:, None] * np.array([*velocity, 0.0])
    np.testing.assert_allclose(found, np.repeat(expected[:, None], N_JOINTS, 1), atol=1e-7)


def test_a_global_shutter_takes_the_joints_as_they_are(scene):
    times = np.linspace(0.0, 1.0, 5)
    R, t = scene.rig.R_cam_world[:1], scene.rig.t_cam_world[:1]
    found = joints_by_row(scene.people[0], times, R, t, scene.rig.intrinsics[0], 0.0)
    np.testing.assert_array_equal(found, scene.people[0](times) @ R[0].T + t[0])


def observed(scene, recording):
    _, cameras = lifted(recording)
    rig, step_s = true_rig(scene), common_step(cameras)
    association = associate(cameras, rig, step_s=step_s, floor_px=8.0)
    o = observe(cameras, rig, association, step_s=step_s)
    return cameras, rig, o, errors_px(o, initial_state(o, rig))


def test_given_line_times_leave_no_error(scene):
    *_, ignored = observed(scene, scene.recording)
    *_, found = observed(scene, with_known_line_times(scene.recording, true_lines(scene)))
    assert np.nanmedian(found) < 0.2
    assert np.nanmedian(ignored) > 5 * np.nanmedian(found)


def test_points_are_timed_by_their_rows(scene):
    cameras, rig, o, _ = observed(scene, with_known_line_times(scene.recording, true_lines(scene)))
    n, c, j = np.argwhere(o.observed).T
    stamp = o.start_s + o.time_bin[n] * o.step_s + o.elapsed()[n, c, j] - rig.offset_s[c]
    lens = scene.rig.intrinsics[0]
    v = o.x[n, c, j, 1] * lens.K[1, 1] + lens.K[1, 2]
    line_s = np.array([camera.shutter.line_time_s for camera in cameras])[c]
    frames = (stamp - line_s * v) / FRAME_S
    assert np.abs(frames - np.rint(frames)).max() < 1e-6


def test_parts_of_the_observations_keep_their_times(scene):
    _, _, o, _ = observed(scene, with_known_line_times(scene.recording, true_lines(scene)))
    np.testing.assert_array_equal(o.thinned_joints(4).elapsed(), o.elapsed()[:, :, ::4])
    rows = np.array([3, 5])
    np.testing.assert_array_equal(o.only(rows).elapsed(), o.elapsed()[rows])


def test_a_global_shutter_has_one_time_per_image(exact_scene):
    cameras, _, o, _ = observed(exact_scene, exact_scene.recording)
    np.testing.assert_array_equal(o.elapsed()[..., 0], o.phi)
    for camera, recorded in zip(cameras, exact_scene.recording.cameras, strict=True):
        assert camera.stamps is recorded.stamps
        assert all(track.rows is None for track in camera.tracks)


def test_a_calibration_with_given_line_times_is_exact(scene):
    recording = with_known_line_times(scene.recording, true_lines(scene))
    found = calibrate(recording, HALF_SECOND)
    errors = error(found, scene.truth)
    assert errors.E_R < 1e-4
    assert errors.E_t < 1e-4
    assert errors.E_delta < 2e-3
    ignored = error(calibrate(scene.recording, HALF_SECOND), scene.truth)
    assert ignored.E_R > 5 * errors.E_R
    assert ignored.E_delta > 0.1
    assert [c.line_time_s for c in found.cameras] == list(SCENE.line_time_s)
    assert all(np.isnan(c.line_time_stddev_s) for c in found.cameras)


def test_stamps_stand_for_the_middle_row():
    stamps = np.arange(3.0)
    np.testing.assert_array_equal(Shutter(1e-3, 200.0).times(stamps), stamps + 0.2)
    assert Shutter(0.0, 200.0).times(stamps) is stamps


@pytest.mark.parametrize(
    ("line_s", "message"),
    [
        (-1e-6, r"camera cam1: line_time_s must be at least 0 .*, got -1e-06"),
        (np.nan, r"camera cam1: line_time_s must be at least 0 .*, got nan"),
        (np.inf, r"camera cam1: line_time_s must be at least 0 .*, got inf"),
        (25e-3, r"camera cam1: line_time_s 0.025 makes 2.7e\+04 ms for 1080 rows, but its images"),
        (33e-6, r"camera cam1: .* 35.6 ms for 1080 rows, but its images are 33.3 ms apart"),
    ],
)
def test_unusable_line_times_name_the_camera(exact_scene, line_s, message):
    recording = with_known_line_times(exact_scene.recording, {"cam1": line_s})
    with pytest.raises(InputError, match=message) as caught:
        calibrate(recording)
    assert "\n" not in str(caught.value)


def test_all_of_the_frame_period_can_be_taken(exact_scene):
    line_s = FRAME_S / exact_scene.rig.intrinsics[0].height
    require_line_times(with_known_line_times(exact_scene.recording, {"cam1": line_s}))


def test_the_truth_keeps_the_line_times_and_the_recording_does_not(scene):
    assert [c.line_time_s for c in scene.truth.cameras] == list(SCENE.line_time_s)
    assert {c.line_time_s for c in scene.recording.cameras} == {0.0}


@pytest.mark.parametrize("line_s", [-1e-6, np.nan, (1e-6, 2e-6)])
def test_unusable_scenes(line_s):
    with pytest.raises(InputError, match="line_time_s"):
        SceneOptions(line_time_s=line_s)
