"""Estimates beside the truth, one image at a time."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.film.compare import JOINT_NAMES, Seen, compare, total


@pytest.fixture
def seen() -> Seen:
    person = np.random.default_rng(5).uniform(0, 100, (len(JOINT_NAMES), 2)) * [0.4, 1.0]
    keypoints = np.stack([person, person + np.array([200.0, 0.0])])
    return Seen(keypoints, np.array([100.0, 100.0]), np.array([True, False]))


def test_errors_are_distances_in_pixels_and_of_the_height(seen: Seen) -> None:
    result = compare(seen, seen.keypoints[::-1] + np.array([3.0, 4.0]))
    assert np.allclose(result.errors_px, 5.0)
    assert np.allclose(result.errors_relative, 0.05)
    assert (result.clear_missed, result.hidden_missed, result.invented) == (0, 0, 0)


def test_missed_and_invented_people(seen: Seen) -> None:
    far = seen.keypoints[:1] + np.array([900.0, 0.0])
    result = compare(seen, np.concatenate([seen.keypoints[1:], far]))
    assert (result.clear, result.clear_missed) == (1, 1)
    assert (result.hidden, result.hidden_missed) == (1, 0)
    assert result.invented == 1


def test_one_is_found_although_another_is_nearer_to_what_is_left(seen: Seen) -> None:
    """Beyond the limit all are equally far: they do not take away the one that is found."""
    found = np.stack([seen.keypoints[1], seen.keypoints[1] + np.array([100.0, 0.0])])
    result = compare(seen, found)
    assert result.hidden_missed == 0
    assert np.allclose(result.errors_px, 0.0)


def test_exchanged_sides_are_counted_by_pair(seen: Seen) -> None:
    found = seen.keypoints.copy()
    left, right = JOINT_NAMES.index("left_knee"), JOINT_NAMES.index("right_knee")
    seen.keypoints[:, left] = seen.keypoints[:, right] + np.array([15.0, 0.0])
    found[:, left], found[:, right] = seen.keypoints[:, right], seen.keypoints[:, left]
    result = compare(seen, found)
    assert result.exchanged == 2
    assert 2 < result.pairs <= 12


def test_joints_that_were_not_found_have_no_error(seen: Seen) -> None:
    found = seen.keypoints.copy()
    found[:, 3] = np.nan
    result = compare(seen, found)
    assert np.isnan(result.errors_px[:, 3]).all()
    assert np.isfinite(np.delete(result.errors_px, 3, axis=1)).all()


def test_nobody_is_found(seen: Seen) -> None:
    result = total([compare(seen, np.zeros((0, 17, 2))), compare(seen, seen.keypoints)])
    assert (result.images, result.clear, result.clear_missed) == (2, 2, 1)
    assert result.errors_px.shape == (2, 17)
