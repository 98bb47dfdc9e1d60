"""A person who was split is one again; two who meet stay two."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from stcalib_ros.core.reconstruction.people import joint_path
from stcalib_ros.core.reconstruction.same_people import same_people

BODY = np.random.default_rng(4).uniform([-0.3, -0.2, 0.0], [0.3, 0.2, 1.8], (17, 3))
CAMERAS = 3


def part(person, bins, place, *, cameras=(0, 1, 2), track=0):
    """A person in some time bins at a place (n, 3), seen by some cameras."""
    n = len(bins)
    tracks = np.full((n, CAMERAS), -1)
    tracks[:, list(cameras)] = track
    inlier = np.zeros((n, CAMERAS, len(BODY)), dtype=bool)
    inlier[:, list(cameras)] = True
    return {
        "person": np.full(n, person),
        "time_bin": np.asarray(bins),
        "track": tracks,
        "inlier": inlier,
        "X": BODY + np.broadcast_to(place, (n, 3))[:, None],
    }


def iteration(*parts):
    rows = {name: np.concatenate([one[name] for one in parts]) for name in parts[0]}
    observations = SimpleNamespace(**{k: rows[k] for k in ("person", "time_bin", "track")})
    state = SimpleNamespace(inlier=rows["inlier"], X=rows["X"])
    return SimpleNamespace(observations=observations, state=state)


def walk(bins, offset=(0.0, 0.0, 0.0)):
    return np.c_[0.05 * np.asarray(bins), np.zeros(len(bins)), np.zeros(len(bins))] + offset


def split(*, apart_m=0.05, cameras=(0, 1)):
    """Person 0 is lost in bin 30 and goes on from bin 26 as person 2; person 1 is another one."""
    first, second, others = np.arange(30), np.arange(26, 60), np.arange(60)
    return iteration(
        part(0, first, walk(first)),
        part(1, others, walk(others, (0.0, 2.0, 0.0)), track=1),
        part(2, second, walk(second, (0.0, apart_m, 0.0)), cameras=cameras, track=2),
    )


def test_a_person_who_was_split_is_one():
    # In the bins of both, each camera sees one of them: the first four have other cameras.
    last = split()
    last.observations.track[26:30] = -1
    assert same_people(last) == ((0, 2), (1,))


def test_people_who_are_seen_side_by_side_are_two():
    assert same_people(split()) == ((0,), (1,), (2,))
    last = split(apart_m=0.6)
    last.observations.track[26:30] = -1
    assert same_people(last) == ((0,), (1,), (2,))


def test_who_meets_somebody_and_walks_on_is_somebody_else():
    bins = np.arange(40)
    away = np.abs(bins - 20)[:, None] * np.array([0.0, 0.1, 0.0])
    last = iteration(
        part(0, bins, walk(bins), cameras=(0, 1)),
        part(1, bins, walk(bins) + away, cameras=(2, 1), track=1),
    )
    assert same_people(last) == ((0,), (1,))


def test_joints_of_both_parts_are_those_that_more_cameras_see():
    last = split(apart_m=0.1)
    obs = last.observations
    rows = np.flatnonzero(obs.person != 1)
    rows = rows[np.argsort(obs.time_bin[rows], kind="stable")]
    joints = joint_path(last, rows)
    assert joints.shape == (60, 17, 3)
    np.testing.assert_allclose(joints[28], BODY + walk([28])[0])
    np.testing.assert_allclose(joints[40], BODY + walk([40], (0.0, 0.1, 0.0))[0])
