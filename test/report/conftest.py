"""A calibrated scene that several tests look at; made once."""

from __future__ import annotations

import pytest

from stcalib_ros.core.model.calibration import Status
from stcalib_ros.core.pipeline import run_stages
from stcalib_ros.core.stages import Stages
from stcalib_ros.core.synthetic import Scene, SceneOptions, simulate
from stcalib_ros.io.mocap import shipped_clips
from stcalib_ros.report.content import ReportContent, content_of_stages


@pytest.fixture(scope="session")
def report_scene() -> Scene:
    options = SceneOptions(
        n_cameras=3, n_people=2, n_frames=150, max_offset_frames=8, sigma_px=1.0, seed=2
    )
    return simulate(options, clips=shipped_clips())


@pytest.fixture(scope="session")
def report_stages(report_scene: Scene) -> Stages:
    stages = run_stages(report_scene.recording)
    assert stages.calibration.status is Status.OK
    return stages


@pytest.fixture(scope="session")
def report_content(report_scene: Scene, report_stages: Stages) -> ReportContent:
    return content_of_stages(report_scene.recording, report_stages, truth=report_scene.truth)
