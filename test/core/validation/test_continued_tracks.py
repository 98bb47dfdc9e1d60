"""Tracks of a camera that no longer fits go on as the persons that they were."""

from __future__ import annotations

import numpy as np

from stcalib_ros.core.integration.association import Association
from stcalib_ros.core.validation.continued_tracks import with_tracks_continued


def continued(*persons):
    tables = tuple(np.array(one) for one in persons)
    n = 1 + max(int(one.max()) for one in tables)
    association = Association(tables, 0.0, 1.0, n, 4.0, {})
    return [one.tolist() for one in with_tracks_continued(association).person_of]


def test_a_track_that_is_alone_has_the_person_it_had():
    first, second = continued([[0, 0, 0, 0]], [[0, 0, 1, 2]])
    assert first == [[0, 0, 0, 0]]
    assert second == [[0, 0, 0, 0]]


def test_or_the_one_that_it_has_next():
    assert continued([[0, 0, 0, 0]], [[1, 1, 0, 0]])[1] == [[0, 0, 0, 0]]


def test_of_two_persons_the_nearer_one_in_time():
    first = [[0, 0, 0, 0, 0], [1, 1, 1, 1, 1]]
    assert continued(first, [[0, 2, 3, 1, 1]])[1] == [[0, 0, 1, 1, 1]]


def test_no_person_is_there_twice():
    assert continued([[0, 0]], [[0, 0], [0, 1]])[1] == [[0, 0], [0, 1]]


def test_what_is_never_shared_or_not_there_stays():
    assert continued([[0, 0, -1]], [[1, 1, 1]]) == [[[0, 0, -1]], [[1, 1, 1]]]
