"""The figures of an evaluation against closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.evaluation.metrics import evaluate, match_quality
from stcalib_ros.core.model.calibration import Calibration, PersonAssociation
from stcalib_ros.core.synthetic import SceneOptions, simulate

TRUTH = simulate(SceneOptions(n_frames=30)).truth
BASELINE = float(np.linalg.norm(TRUTH.cameras[1].t_ref_cam))


def changed(calibration: Calibration, camera: int, **changes: object) -> Calibration:
    cameras = list(calibration.cameras)
    cameras[camera] = replace(cameras[camera], **changes)
    return replace(calibration, cameras=tuple(cameras))


def moved(calibration: Calibration, R: np.ndarray, t: np.ndarray, scale: float) -> Calibration:
    """The same calibration in another frame and unit."""
    return replace(
        calibration,
        cameras=tuple(
            replace(c, R_ref_cam=R @ c.R_ref_cam, t_ref_cam=scale * R @ c.t_ref_cam + t)
            for c in calibration.cameras
        ),
    )


def figures(estimate: Calibration, truth: Calibration = TRUTH) -> np.ndarray:
    e = evaluate(estimate, truth, fps=30)
    return np.array([e.E_R, e.E_t, e.E_delta, e.centre_mean, e.centre_max])


def perturbed() -> Calibration:
    rng = np.random.default_rng(0)
    return replace(
        TRUTH,
        reprojection_rms_px=2.5,
        cameras=tuple(
            replace(
                c,
                R_ref_cam=Rotation.from_rotvec(0.02 * rng.standard_normal(3)).as_matrix()
                @ c.R_ref_cam,
                t_ref_cam=c.t_ref_cam + 0.1 * rng.standard_normal(3),
                time_offset_s=c.time_offset_s + 0.01 * rng.standard_normal(),
            )
            for c in TRUTH.cameras
        ),
    )


def test_the_truth_has_no_error():
    evaluation = evaluate(TRUTH, TRUTH, fps=30)
    np.testing.assert_allclose(figures(TRUTH), 0, atol=1e-12)
    assert evaluation.scale == pytest.approx(1)
    assert (evaluation.precision, evaluation.recall) == (1, 1)
    assert evaluation.missing == ()
    assert [c.name for c in evaluation.cameras] == [c.name for c in TRUTH.cameras]


def test_one_turned_camera():
    R = Rotation.from_rotvec([0, 0.3, 0]).as_matrix() @ TRUTH.cameras[2].R_ref_cam
    evaluation = evaluate(changed(TRUTH, 2, R_ref_cam=R), TRUTH)
    assert pytest.approx(0.3 / 3) == evaluation.E_R
    assert evaluation.cameras[2].rotation_rad == pytest.approx(0.3)
    assert evaluation.E_t == pytest.approx(0, abs=1e-12)


def test_one_moved_camera():
    moved_to = TRUTH.cameras[3].t_ref_cam + np.array([0.0, 0.3, 0.4])
    evaluation = evaluate(changed(TRUTH, 3, t_ref_cam=moved_to), TRUTH)
    assert evaluation.cameras[3].translation == pytest.approx(0.5 / BASELINE)
    assert evaluation.E_t == pytest.approx(0.5 / BASELINE / np.sqrt(3))
    assert evaluation.E_R == 0


def test_a_second_camera_too_far_away_scales_the_others():
    cameras = TRUTH.cameras
    far = changed(TRUTH, 1, t_ref_cam=1.25 * cameras[1].t_ref_cam)
    evaluation = evaluate(far, TRUTH)
    assert evaluation.scale == pytest.approx(1.25)
    assert evaluation.cameras[1].translation == pytest.approx(0, abs=1e-12)
    for k in (2, 3):
        expected = 0.2 * np.linalg.norm(cameras[k].t_ref_cam) / BASELINE
        assert evaluation.cameras[k].translation == pytest.approx(expected)


def test_offsets_are_counted_in_frames_without_the_reference():
    estimate = changed(TRUTH, 1, time_offset_s=TRUTH.cameras[1].time_offset_s - 0.1)
    evaluation = evaluate(estimate, TRUTH, fps=30)
    assert evaluation.E_delta_s == pytest.approx(0.1 / 3)
    assert evaluation.E_delta == pytest.approx(1.0)
    assert evaluation.cameras[1].offset_frames == pytest.approx(-3)
    assert np.isnan(evaluate(estimate, TRUTH).E_delta)


def test_offsets_are_compared_in_the_middle_of_the_recording():
    middle = 0.5 * sum(TRUTH.window_s) - TRUTH.epoch_s
    estimate = changed(
        TRUTH, 2, clock_skew=1e-3, time_offset_s=TRUTH.cameras[2].time_offset_s - 1e-3 * middle
    )
    assert evaluate(estimate, TRUTH).E_delta_s == pytest.approx(0, abs=1e-9)


def test_the_epoch_of_the_estimate_does_not_matter():
    skewed = changed(TRUTH, 2, clock_skew=1e-3)
    later = replace(
        changed(skewed, 2, time_offset_s=TRUTH.cameras[2].time_offset_s + 1e-3 * 5),
        epoch_s=TRUTH.epoch_s + 5,
    )
    assert evaluate(later, skewed).E_delta_s == pytest.approx(0, abs=1e-8)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), scale=st.floats(0.01, 100))
def test_frame_and_unit_of_the_estimate_do_not_matter(seed, scale):
    rng = np.random.default_rng(seed)
    estimate = perturbed()
    other = moved(estimate, Rotation.random(rng=rng).as_matrix(), rng.standard_normal(3), scale)
    np.testing.assert_allclose(figures(other), figures(estimate), rtol=1e-6, atol=1e-9)
    e = evaluate(other, TRUTH)
    assert e.scale == pytest.approx(scale * evaluate(estimate, TRUTH).scale)


@settings(max_examples=10, deadline=None)
@given(order=st.permutations(range(4)))
def test_order_and_reference_of_the_estimate_do_not_matter(order):
    estimate = perturbed()
    other = replace(
        estimate,
        cameras=tuple(estimate.cameras[k] for k in order),
        reference=estimate.cameras[order[0]].name,
    )
    np.testing.assert_allclose(figures(other), figures(estimate), rtol=1e-9)


def test_clocks_are_compared_relative_to_the_reference():
    late = replace(
        TRUTH, cameras=tuple(replace(c, time_offset_s=c.time_offset_s + 5) for c in TRUTH.cameras)
    )
    assert evaluate(late, TRUTH).E_delta_s == pytest.approx(0, abs=1e-12)


def test_cameras_that_are_not_there_are_listed():
    without = replace(TRUTH, cameras=TRUTH.cameras[:2])
    evaluation = evaluate(without, TRUTH)
    assert evaluation.missing == ("cam2", "cam3")
    assert evaluation.E_R == 0


def test_without_the_reference_the_first_common_camera_serves():
    without = replace(perturbed(), cameras=perturbed().cameras[1:], reference="cam1")
    evaluation = evaluate(without, TRUTH)
    assert evaluation.reference == "cam1"
    assert evaluation.cameras[0].rotation_rad == pytest.approx(0, abs=1e-12)


def test_too_little_in_common():
    with pytest.raises(InputError, match="two cameras in common, got none"):
        evaluate(replace(TRUTH, cameras=()), TRUTH)
    one_place = changed(TRUTH, 1, t_ref_cam=np.zeros(3))
    with pytest.raises(InputError, match="'cam0' and 'cam1' are at one place"):
        evaluate(one_place, TRUTH)


def person(person_id: int, **tracks: tuple[int, ...]) -> PersonAssociation:
    return PersonAssociation(person_id, tracks, float("nan"))


def test_matches_are_pairs_of_tracks_of_different_cameras():
    true = [person(0, a=(0, 1), b=(0,), c=(0,)), person(1, a=(2,), b=(1,), c=(1,))]
    # Found: b and c exchanged in c; the right pairs are (a0, b0), (a1, b0), (a2, b1).
    found = [person(7, a=(0, 1), b=(0,), c=(1,)), person(8, a=(2,), b=(1,), c=(0,))]
    n, precision, recall = match_quality(found, true, "abc")
    assert (n, precision, recall) == (8, 3 / 8, 3 / 8)
    assert match_quality(found, true, "ab") == (3, 1.0, 1.0)


def test_tracks_unknown_to_the_truth_do_not_count():
    true = [person(0, a=(0,), b=(0,))]
    found = [person(0, a=(0,), b=(0,)), person(1, a=(5,), b=(6,))]
    assert match_quality(found, true, "ab") == (1, 1.0, 1.0)


def test_a_switched_track_may_belong_to_two_people():
    true = [person(0, a=(0,), b=(0,)), person(1, a=(0,), b=(1,))]
    assert match_quality([person(0, a=(0,), b=(1,))], true, "ab") == (1, 1.0, 0.5)


def test_nothing_to_judge():
    n, precision, recall = match_quality([], [], "ab")
    assert n == 0
    assert np.isnan([precision, recall]).all()
