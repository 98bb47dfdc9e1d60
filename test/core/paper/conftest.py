"""Scenes of the paper's protocol, made once."""

from __future__ import annotations

import pytest

from stcalib_ros.core.options import Options, RegistrationOptions, VmfOptions
from stcalib_ros.core.pipeline import Stages, run_stages
from stcalib_ros.core.synthetic import Scene, SceneOptions, paper_scene

VMF = RegistrationOptions(method="vmf")


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
