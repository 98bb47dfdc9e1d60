"""Pairs as tasks: the same numbers whichever executor has them, and a clean end."""

from __future__ import annotations

import pickle
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest
from core_helpers import HALF_SECOND, lifted, parameters
from pool_tasks import double, exit_at_once

from stcalib_ros.core.errors import CalibrationError, Cancelled
from stcalib_ros.core.pipeline import calibrate
from stcalib_ros.core.registration.executors import map_tasks
from stcalib_ros.core.registration.pairs import agreements, pair_tasks, register, with_agreements
from stcalib_ros.core.registration.resampling import Grid, common_step


def nothing(_fraction):
    pass


@pytest.fixture(scope="module")
def pool():
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as executor:
        yield executor


@pytest.fixture(scope="module")
def tasks(small_scene):
    skeleton, cameras = lifted(small_scene.recording)
    options, step = HALF_SECOND, common_step(cameras)
    start = float(cameras[0].stamps[0])
    return pair_tasks(cameras, [2, 0, 1], skeleton, options, grid=Grid(start, step, 80))


class Patient:
    """An executor that never begins a task."""

    def __init__(self):
        self.futures = []

    def submit(self, *_):
        self.futures.append(Future())
        return self.futures[-1]


def assert_same(one, two):
    np.testing.assert_array_equal(parameters(one), parameters(two))
    np.testing.assert_array_equal(one.joint_covariance, two.joint_covariance)
    assert one.reprojection_rms_px == two.reprojection_rms_px
    assert one.persons == two.persons
    assert one.pairs == two.pairs


def test_there_is_a_task_for_every_pair_in_the_order_of_the_cameras(tasks):
    assert [(task.a, task.b) for task in tasks] == [(2, 0), (2, 1), (0, 1)]
    for task in tasks:
        assert {(h.a, h.b) for h in register(task)} == {(task.a, task.b)}


def test_a_task_holds_its_two_cameras_only(tasks, small_scene):
    whole = len(pickle.dumps(small_scene.recording))
    names = [{pieces.camera.name for pieces in task.pieces} for task in tasks]
    assert names == [{"cam2", "cam0"}, {"cam2", "cam1"}, {"cam0", "cam1"}]
    assert all(len(pickle.dumps(task)) < 2.0 * whole for task in tasks)


def test_two_processes_find_the_same_numbers_bit_by_bit(small_scene, small_stages, pool):
    found = calibrate(small_scene.recording, HALF_SECOND, executor=pool)
    assert_same(found, small_stages.calibration)


def test_threads_find_the_same_numbers_bit_by_bit(small_scene, small_stages):
    with ThreadPoolExecutor(2) as executor:
        found = calibrate(small_scene.recording, HALF_SECOND, executor=executor)
    assert_same(found, small_stages.calibration)


def test_a_cluster_finds_the_same_numbers_bit_by_bit(small_scene, small_stages):
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(
            1, processes=True, threads_per_worker=1, dashboard_address=None
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        found = calibrate(small_scene.recording, HALF_SECOND, executor=client.get_executor())
    assert_same(found, small_stages.calibration)


def test_agreements_go_to_processes_and_come_back(tasks, pool):
    """With them a task has the same hypotheses as if it had searched itself."""
    found = map_tasks(agreements, tasks, pool, nothing)
    carried = [with_agreements(t, t, f) for t, f in zip(tasks, found, strict=True)]
    for task, there in zip(tasks, map_tasks(register, carried, pool, nothing), strict=True):
        here = register(task)
        assert [h.matches for h in there] == [h.matches for h in here]
        assert [h.lag_s for h in there] == pytest.approx([h.lag_s for h in here], abs=1e-4)


def test_answers_come_in_the_order_of_the_tasks(pool):
    for executor in (None, pool):
        assert map_tasks(double, range(20), executor, nothing) == list(range(0, 40, 2))


def test_progress_rises_from_zero(pool):
    seen = []
    map_tasks(double, range(20), pool, seen.append)
    assert seen[0] == 0.0
    assert seen == sorted(seen)
    assert seen[-1] < 1.0


def test_who_cancels_need_not_wait_for_tasks_that_have_not_begun(small_scene):
    executor, asked = Patient(), []

    def cancelled():
        asked.append(1)
        return len(asked) > 5

    with pytest.raises(Cancelled, match="cancelled during matching camera pairs"):
        calibrate(small_scene.recording, HALF_SECOND, cancelled=cancelled, executor=executor)
    assert len(executor.futures) == 3
    assert all(future.cancelled() for future in executor.futures)


def test_a_worker_that_is_killed_is_one_clear_error():
    with (
        ProcessPoolExecutor(1, mp_context=get_context("spawn")) as executor,
        pytest.raises(CalibrationError, match="a worker process ended before its task was done"),
    ):
        map_tasks(exit_at_once, range(3), executor, nothing)


def test_an_error_of_a_task_is_raised_as_it_is(pool):
    with pytest.raises(TypeError):
        map_tasks(double, [1, None], pool, nothing)
