"""Scenes and calibrations that several tests look at; made once."""

from __future__ import annotations

import numpy as np
import pytest
from core_helpers import EXACT, HALF_SECOND, SMALL, lifted
from hypothesis import settings

from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.skeleton import Skeleton
from stcalib_ros.core.options import Options, RegistrationOptions, VmfOptions
from stcalib_ros.core.pipeline import run_stages
from stcalib_ros.core.stages import Stages
from stcalib_ros.core.synthetic import Scene, SceneOptions, paper_scene, simulate

# The same examples every time, however slow the machine is.
settings.register_profile("stcalib", deadline=None, derandomize=True, max_examples=40)
settings.load_profile("stcalib")


VMF = RegistrationOptions(method="vmf")


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


@pytest.fixture(scope="session")
def noise_free() -> Scene:
    """Three people before three cameras; clocks off by 3 and -2 frames, no noise at all."""
    options = SceneOptions(n_cameras=3, n_people=3, n_frames=60, sigma_px=0.0, seed=2)
    return paper_scene(options, offset_frames=[3.0, -2.0])


@pytest.fixture(scope="session")
def noisy() -> Scene:
    """The paper's noise and offsets."""
    return paper_scene(SceneOptions(n_cameras=3, n_people=3, n_frames=90, seed=4))


@pytest.fixture(scope="session")
def noisy_stages(noisy: Scene) -> Stages:
    """All stages of the paper's method."""
    vmf = VmfOptions(window=9, n_windows=10)
    return run_stages(noisy.recording, Options(offset_range_s=0.2, registration=VMF, vmf=vmf))
