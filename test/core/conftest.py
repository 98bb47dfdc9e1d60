"""Scenes and calibrations that several tests look at; made once."""

from __future__ import annotations

import numpy as np
import pytest
from core_helpers import EXACT, HALF_SECOND, SMALL, lifted
from hypothesis import settings

from stcalib_ros.core.lift import LiftedCamera
from stcalib_ros.core.pipeline import Stages, run_stages
from stcalib_ros.core.skeleton import Skeleton
from stcalib_ros.core.synthetic import Scene, simulate

# The same examples every time, however slow the machine is.
settings.register_profile("stcalib", deadline=None, derandomize=True, max_examples=40)
settings.load_profile("stcalib")


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


@pytest.fixture(scope="session")
def exact_scene() -> Scene:
    return simulate(EXACT)


@pytest.fixture(scope="session")
def exact_lifted(exact_scene: Scene) -> tuple[Skeleton, tuple[LiftedCamera, ...]]:
    return lifted(exact_scene.recording)


@pytest.fixture(scope="session")
def small_scene() -> Scene:
    return simulate(SMALL)


@pytest.fixture(scope="session")
def small_stages(small_scene: Scene) -> Stages:
    return run_stages(small_scene.recording, HALF_SECOND)
