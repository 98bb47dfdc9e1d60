"""In which cameras two solutions differ."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.bundle.limits import OTHER_POSITION, OTHER_ROTATION, OTHER_SCALE
from stcalib_ros.core.geometry.so3 import exp_so3
from stcalib_ros.core.model.rig import Rig, sub_rig

TOLERANCE_S = 0.1
seeds = st.integers(0, 2**32 - 1)


@pytest.fixture
def five(small_stages):
    """An iteration with a rig of five cameras, 3, 1, 4, 0 and 7, some metres apart."""
    return with_rig(small_stages.iterations[-1], random_rig(np.random.default_rng(0)))


def random_rig(rng):
    return Rig(
        np.array([3, 1, 4, 0, 7]),
        exp_so3(rng.normal(size=(5, 3))),
        rng.uniform(-3, 3, (5, 3)),
        rng.uniform(-1, 1, 5),
        1.0,
    )


def with_rig(iteration: Iteration, rig: Rig) -> Iteration:
    return replace(iteration, rig=rig)


def altered(iteration, k, *, turn=0.0, shift=0.0, late_s=0.0):
    """The camera at position k turned, moved, or its clock off."""
    rig = iteration.rig
    R, t, offset = rig.R_ref_cam.copy(), rig.t_ref_cam.copy(), rig.offset_s.copy()
    R[k] = exp_so3(np.array([0.0, turn, 0.0])) @ R[k]
    t[k] += [shift, 0.0, 0.0]
    offset[k] += late_s
    return with_rig(iteration, replace(rig, R_ref_cam=R, t_ref_cam=t, offset_s=offset))


def differing(one, other):
    return sorted(one.differing(other, TOLERANCE_S).tolist())


def test_an_iteration_does_not_differ_from_itself(five):
    assert differing(five, five) == []


@pytest.mark.parametrize("k", range(5))
@pytest.mark.parametrize(
    "change", [{"turn": 2 * OTHER_ROTATION}, {"shift": 3.0}, {"late_s": 2 * TOLERANCE_S}]
)
def test_one_camera_that_is_elsewhere_is_the_only_one(five, k, change):
    """Also where it is the reference: all others are compared with each other."""
    other = altered(five, k, **change)
    assert differing(five, other) == [five.rig.cameras[k]]
    assert differing(other, five) == [five.rig.cameras[k]]


@pytest.mark.parametrize(
    "change",
    [
        {"turn": 0.9 * OTHER_ROTATION},
        {"shift": 0.9 * OTHER_POSITION},
        {"late_s": 0.9 * TOLERANCE_S},
    ],
)
def test_what_is_less_than_the_limit_is_the_same(five, change):
    assert differing(five, altered(five, 2, **change)) == []


@given(seeds)
def test_frame_clock_and_order_do_not_matter(seed):
    rng = np.random.default_rng(seed)
    rig = random_rig(rng)
    one = Iteration(rig, None, None, None, 1.0, 1.0, 1.0)
    in_another_frame = sub_rig(rig, rng.permutation(5).tolist())
    assert differing(one, with_rig(one, in_another_frame)) == []


@pytest.mark.parametrize("k", [0, 3])
@pytest.mark.parametrize(("factor", "same"), [(1.05, True), (1 / 1.05, True), (1.6, False)])
def test_solutions_may_take_people_for_a_little_larger(five, factor, same, k):
    """Compared at the scale that leaves fewest cameras, even if another one is far off."""
    assert (max(factor, 1 / factor) < OTHER_SCALE) == same
    larger = with_rig(five, replace(five.rig, t_ref_cam=factor * five.rig.t_ref_cam))
    found = differing(five, altered(larger, k, shift=4.0))
    assert (found == [five.rig.cameras[k]]) == same


def test_of_three_cameras_the_one_that_moved_does_not_set_the_scale(five):
    rig = replace(five.rig, t_ref_cam=4 * five.rig.t_ref_cam)
    rig = sub_rig(rig, [0, 1, 2])
    for k in range(3):
        t = rig.t_ref_cam.copy()
        t[k] += 0.9 * (t[k] - t[(k + 1) % 3])
        other = with_rig(five, replace(rig, t_ref_cam=t))
        assert differing(with_rig(five, rig), other) == [rig.cameras[k]]


def test_two_of_five_in_another_place(five):
    other = altered(altered(five, 1, turn=0.5), 3, late_s=1.0)
    assert differing(five, other) == [0, 1]


def test_only_cameras_that_both_have_are_compared(five):
    fewer = with_rig(five, sub_rig(five.rig, [1, 2, 4]))
    assert differing(five, fewer) == []
    assert differing(five, altered(fewer, 2, turn=0.5)) == [7]


@pytest.mark.parametrize("cameras", [[10, 11, 12, 13, 14], [10, 11, 4, 13, 14]])
def test_without_two_common_cameras_all_differ(five, cameras):
    strangers = with_rig(five, replace(five.rig, cameras=np.array(cameras)))
    assert differing(five, strangers) == [0, 1, 3, 4, 7]
