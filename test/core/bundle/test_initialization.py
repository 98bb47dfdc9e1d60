"""Where the adjustment starts: what is tried, and what is tried again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stcalib_ros.core.bundle.initialization import Start, select_initial_rig
from stcalib_ros.core.integration.exclusions import Exclusions

TURNED = Rotation.from_euler("y", 40, degrees=True).as_matrix()


def elsewhere(one, c=2, shift_s=0.0):
    """The round with one camera turned, or its clock off."""
    R, offset = one.rig.R_ref_cam.copy(), one.rig.offset_s.copy()
    if shift_s:
        offset[c] += shift_s
    else:
        R[c] = R[c] @ TURNED
    return replace(one, rig=replace(one.rig, R_ref_cam=R, offset_s=offset))


def tried(rounds, names):
    """What `select_initial_rig` gives where adjusting rig k leads to round k, and what it tried."""
    calls = []

    def adjust(rig, exclusions):
        k = next(i for i, one in enumerate(rounds) if one.rig is rig)
        calls.append(k)
        return Start(rounds[k], exclusions)

    rigs = [one.rig for one in rounds]
    none = Exclusions(tuple(names), offset_range_s=1.0)
    start, rival = select_initial_rig(rigs, adjust, none, lambda *_: None)
    return (start.iteration, rival), calls


@pytest.fixture
def first(small_stages):
    return small_stages.iterations[0]


@pytest.fixture
def names(small_stages):
    return [camera.name for camera in small_stages.lifted]


def test_rigs_that_come_to_one_place_are_one_start(first, names):
    same = replace(first, rig=replace(first.rig, offset_s=first.rig.offset_s + 1e-3))
    (start, rival), calls = tried([first, same, replace(first, rig=replace(first.rig))], names)
    assert calls == [0, 1, 2]
    assert start is first
    assert rival is None


@pytest.mark.parametrize("change", [{}, {"shift_s": 0.5}, {"shift_s": 0.04}])
def test_rigs_that_come_to_other_places_are_all_adjusted_again(first, names, change):
    other = elsewhere(first, **change)
    (start, rival), calls = tried([first, other], names)
    assert calls == [0, 1, 0, 1]
    assert start is first
    # Less than three frames apart, no other solution.
    assert (rival is other) == (change.get("shift_s", 1.0) > 0.1)


def test_a_rig_of_other_cameras_is_no_copy(first, names):
    rig = first.rig
    fewer = replace(
        first,
        rig=replace(
            rig,
            cameras=rig.cameras[:2],
            R_ref_cam=rig.R_ref_cam[:2],
            t_ref_cam=rig.t_ref_cam[:2],
            offset_s=rig.offset_s[:2],
        ),
    )
    _, calls = tried([first, fewer], names)
    assert calls == [0, 1, 0, 1]
    np.testing.assert_array_equal(first.rig.cameras, [0, 1, 2])
