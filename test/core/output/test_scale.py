"""How long a metre is: closed forms, and sources that contradict each other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_helpers import true_rig
from hypothesis import given
from hypothesis import strategies as st

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.geometry.lens import project
from stcalib_ros.core.model.rig import Rig
from stcalib_ros.core.model.scale_cues import Distance, distances_from_list
from stcalib_ros.core.output.scale import (
    LEG_FRACTION,
    InconsistentScale,
    ScaleCue,
    by_distance,
    by_height,
    fuse,
)
from stcalib_ros.core.synthetic.skeleton import LAYOUT


def shrunk(rig: Rig, factor: float) -> Rig:
    return replace(rig, t_ref_cam=rig.t_ref_cam / factor)


def test_without_claims_there_is_no_metre():
    assert fuse([]) is None


@given(
    metres=st.floats(0.01, 100),
    stddevs=st.lists(st.floats(0.001, 0.3), min_size=1, max_size=5),
)
def test_claims_that_agree_make_it_surer(metres, stddevs):
    scale = fuse([ScaleCue(str(i), metres, s) for i, s in enumerate(stddevs)])
    assert scale.metres == pytest.approx(metres)
    assert scale.stddev == pytest.approx(sum(s**-2 for s in stddevs) ** -0.5)


def test_the_surer_claim_counts_more():
    scale = fuse([ScaleCue("a", 1.0, 0.01), ScaleCue("b", 1.1, 0.1)])
    assert np.log(scale.metres) == pytest.approx(np.log(1.1) / 101)


def test_claims_that_differ_by_more_than_four_deviations_contradict_each_other():
    fuse([ScaleCue("a", 1.0, 0.03), ScaleCue("b", np.exp(0.199), 0.04)])
    with pytest.raises(InconsistentScale, match=r"a and b contradict .* 0\.82 times"):
        fuse([ScaleCue("a", 1.0, 0.03), ScaleCue("b", np.exp(0.201), 0.04)])


def test_a_known_baseline_is_the_metre(small_scene):
    rig = true_rig(small_scene)
    apart = float(np.linalg.norm(rig.t_ref_cam[2] - rig.t_ref_cam[1]))
    distance = Distance(apart, 0.01 * apart, cameras=("cam1", "cam2"))
    covariance = np.zeros((21, 21))
    claim = by_distance(distance, small_scene.recording, shrunk(rig, 3.0), covariance)
    assert claim.metres == pytest.approx(3.0)
    assert claim.stddev == pytest.approx(0.01)
    assert "cam1 and cam2" in claim.source


def test_what_is_not_known_of_the_cameras_counts_too(small_scene):
    """Two cameras that wander together leave their distance alone; one alone does not."""
    rig = true_rig(small_scene)
    line = rig.t_ref_cam[2] - rig.t_ref_cam[1]
    distance = Distance(float(np.linalg.norm(line)), 1e-6, cameras=("cam1", "cam2"))
    both = np.zeros((21, 21))
    rows = [7, 8, 9, 14, 15, 16]
    both[np.ix_(rows, rows)] = np.kron(np.ones((2, 2)), np.eye(3)) * 0.05**2
    alone = np.zeros((21, 21))
    alone[7:10, 7:10] = np.eye(3) * 0.05**2
    stddev = [
        by_distance(distance, small_scene.recording, rig, covariance).stddev
        for covariance in (both, alone)
    ]
    assert stddev[0] < 1e-5
    assert stddev[1] == pytest.approx(0.05 / np.linalg.norm(line), rel=1e-3)


def door(scene, metres=2.0):
    """Pixels of a vertical line in the middle, as every camera sees its ends."""
    ends = np.array([[0.3, 0.1, 0.0], [0.3, 0.1, metres]])
    rig = scene.rig
    return {
        name: tuple(
            map(tuple, project(ends @ rig.R_cam_world[c].T + rig.t_cam_world[c], rig.intrinsics[c]))
        )
        for c, name in enumerate(rig.names)
    }


def test_a_known_object_is_the_metre(small_scene):
    distance = Distance(2.0, 0.02, points=door(small_scene))
    rig = shrunk(true_rig(small_scene), 0.4)
    claim = by_distance(distance, small_scene.recording, rig, np.zeros((21, 21)))
    assert claim.metres == pytest.approx(0.4)
    assert claim.stddev == pytest.approx(0.01)


def test_pixels_of_different_points_are_refused(small_scene):
    points = door(small_scene)
    (u, v), end = points["cam1"]
    points["cam1"] = ((u + 300.0, v), end)
    distance = Distance(2.0, 0.02, points=points)
    with pytest.raises(InconsistentScale, match="cam0, cam1, cam2 do not meet"):
        by_distance(distance, small_scene.recording, true_rig(small_scene), np.zeros((21, 21)))


def test_a_camera_that_is_not_calibrated_tells_nothing(small_scene):
    rig = true_rig(small_scene)
    two = Rig(rig.cameras[:2], rig.R_ref_cam[:2], rig.t_ref_cam[:2], rig.offset_s[:2], 1.0)
    distance = Distance(2.0, 0.02, cameras=("cam0", "cam2"))
    assert by_distance(distance, small_scene.recording, two, np.zeros((14, 14))) is None


def test_the_height_of_people_is_the_metre(small_scene):
    joints = small_scene.joints_world(np.arange(0.0, 2.0, 0.1))
    legs = np.mean([[p.lengths[2] + p.lengths[3]] for p in small_scene.people])
    claim = by_height(LAYOUT, list(joints / 2.5), height_m=legs / LEG_FRACTION, sigma_m=0.1)
    assert claim.metres == pytest.approx(2.5, rel=0.02)
    one = by_height(LAYOUT, [joints[0]], height_m=1.7, sigma_m=0.3)
    both = by_height(LAYOUT, list(joints), height_m=1.7, sigma_m=0.3)
    assert one.stddev > both.stddev > 0.04
    assert by_height(LAYOUT, [], height_m=1.7, sigma_m=0.1) is None


@pytest.mark.parametrize(
    ("entry", "word"),
    [
        ({"metres": 1.0}, "sigma_m"),
        ({"metres": 1.0, "sigma_m": 0.1}, "two cameras"),
        ({"metres": 1.0, "sigma_m": 0.1, "cameras": ["a"]}, "two cameras"),
        ({"metres": 1.0, "sigma_m": 0.1, "cameras": ["a", "a"]}, "two cameras"),
        ({"metres": 1.0, "sigma_m": 0.1, "points": {"a": [[1, 2], [3, 4]]}}, "two cameras"),
        ({"metres": -1.0, "sigma_m": 0.1, "cameras": ["a", "b"]}, "above 0"),
        ({"metres": 1.0, "sigma_m": 2.0, "cameras": ["a", "b"]}, "between 0"),
        ({"metres": 1.0, "sigma_m": 0.1, "points": {"a": [[1, 2]], "b": 3}}, "two pixels"),
        ({"metres": "long", "sigma_m": 0.1, "cameras": ["a", "b"]}, "two pixels"),
        ("cam0 cam1", "metres"),
    ],
)
def test_unusable_distances_are_said(entry, word):
    with pytest.raises(InputError, match=word):
        distances_from_list([entry], "scale.distances")


def test_a_list_is_wanted():
    with pytest.raises(InputError, match="expected a list"):
        distances_from_list({"metres": 1.0}, "scale.distances")
