"""People who move alike, and cameras that see only some of them."""

from types import SimpleNamespace

import numpy as np
import pytest

from stcalib_ros.core.geometry.so3 import exp_so3
from stcalib_ros.core.validation.lookalikes import has_lookalike_alternative

K, J = 60, 17
STEP = np.array([1.2, 0.4, 0.0])


@pytest.fixture
def walk(rng):
    """Joints (K, J, 3) of somebody who walks about, swinging his limbs."""
    t = np.arange(K)[:, None, None] / 30.0
    swing = 0.3 * np.sin(2 * np.pi * t * rng.uniform(0.5, 2, (J, 3)) + rng.uniform(0, 6, (J, 3)))
    return rng.uniform(-0.5, 0.5, (J, 3)) + swing + np.stack([t, 0.3 * t**2, 0 * t], -1)[..., 0, :]


def scene(paths, views):
    """A round of persons (P, K, J, 3) whom cameras see: per camera the numbers of persons."""
    person, time_bin = (one.ravel() for one in np.mgrid[: len(paths), :K])
    used = np.zeros((len(person), len(views), J), dtype=bool)
    for c, persons in enumerate(views):
        used[np.isin(person, persons), c] = True
    return SimpleNamespace(
        observations=SimpleNamespace(person=person, time_bin=time_bin),
        state=SimpleNamespace(X=np.concatenate(paths), inlier=used),
    )


def doubled(paths, views):
    return has_lookalike_alternative(scene(paths, views)).tolist()


def test_who_sees_all_of_a_row_can_count_them(walk):
    row = [walk + k * STEP for k in range(3)]
    everybody = [0, 1, 2]
    assert doubled(row, [everybody] * 3) == [False] * 3
    assert doubled(row, [everybody, everybody, [1]]) == [False, False, True]
    assert doubled(row, [everybody, everybody, [0, 1]]) == [False, False, True]
    assert doubled(row, [everybody, everybody, [0, 2]]) == [False, False, False]


def test_somebody_in_two_pieces_is_not_their_own_double(walk):
    same = walk + 0.03
    assert doubled([walk, same], [[0], [0], [1], [1]]) == [False] * 4
    assert doubled([walk, walk + STEP], [[0], [0], [1], [1]]) == [True] * 4


def test_a_double_may_walk_another_way(walk):
    turned = walk @ exp_so3(np.array([0.0, 0.0, 1.9])).T + STEP
    assert doubled([walk, turned], [[0, 1], [0, 1], [1]]) == [False, False, True]


def test_somebody_else_tells_them_apart(walk, rng):
    row = [walk, walk + STEP, walk[::-1] + 2 * STEP]
    assert doubled(row, [[0, 1, 2], [0, 1, 2], [0, 2]]) == [False] * 3
    assert doubled(row, [[0, 1, 2], [0, 1, 2], [0]]) == [False, False, True]


@pytest.mark.parametrize(("noise", "alike"), [(0.02, True), (0.3, False)])
def test_alike_within_what_is_known_of_them(walk, rng, noise, alike):
    other = walk + STEP + noise * rng.normal(size=walk.shape)
    assert doubled([walk, other], [[0, 1], [0, 1], [0]]) == [False, False, alike]


def test_one_person_has_no_double(walk):
    assert doubled([walk], [[0], [0]]) == [False, False]


def test_a_double_who_is_gone_is_none(walk):
    gone = scene([walk, walk + STEP], [[0, 1], [0, 1], [0]])
    o = gone.observations
    gone.state.inlier[(o.person == 1) & (o.time_bin < K // 2)] = False
    assert has_lookalike_alternative(gone).tolist() == [False] * 3
