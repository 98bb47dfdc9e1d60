"""The demo bag is what its README says."""

from __future__ import annotations

import runpy
from pathlib import Path

import numpy as np
import pytest

import stcalib_ros
from stcalib_ros.core.geometry.lens import project
from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.core.model.recording import Recording
from stcalib_ros.io.bag import read_bag
from stcalib_ros.io.results import read_result

DEMO = Path(stcalib_ros.__file__).parent / "data" / "demo"
ROOT = Path(__file__).parents[2]
SOURCE = ROOT.parent / "shared/data/pose2sim_balance/balance_multi_blazepose.npz"


@pytest.fixture(scope="module")
def recording() -> Recording:
    return read_bag(DEMO / "balance.mcap")


@pytest.fixture(scope="module")
def truth() -> Calibration:
    return read_result(DEMO / "balance_truth.yaml")


def test_bag(recording: Recording) -> None:
    assert [c.name for c in recording.cameras] == ["cam01", "cam02", "cam03", "cam04"]
    assert {c.layout.name for c in recording.cameras} == {"blazepose_33"}
    assert {len(c.stamps) for c in recording.cameras} == {100}
    assert (DEMO / "balance.mcap").stat().st_size < 2_000_000


def test_offsets_bring_the_clocks_together(recording: Recording, truth: Calibration) -> None:
    offsets = [c.time_offset_s for c in truth.cameras]
    assert offsets == [0.0, -0.317, 0.210, -0.143]
    for camera, offset in zip(recording.cameras, offsets, strict=True):
        np.testing.assert_allclose(camera.stamps + offset, recording.cameras[0].stamps, atol=1e-9)


def test_people_are_where_the_truth_says(recording: Recording, truth: Calibration) -> None:
    """Both people's hips, triangulated from all cameras, reproject as the README says."""
    man, woman, bystander = truth.persons
    assert set(man.tracks) == set(woman.tracks) == {"cam01", "cam02", "cam03", "cam04"}
    assert set(bystander.tracks) == {"cam01", "cam02"}
    for person in (man, woman):
        errors = _reprojection_errors(recording, truth, person.tracks)
        assert np.median(errors) < 25.0


def _reprojection_errors(
    recording: Recording, truth: Calibration, tracks: dict[str, tuple[int, ...]]
) -> np.ndarray:
    hip = recording.cameras[0].layout.index("left_hip")
    seen, rows = [], []
    for camera, pose in zip(recording.cameras, truth.cameras, strict=True):
        track = next(t for t in camera.tracks if t.track_id == tracks[camera.name][0])
        pixels = np.full((100, 2), np.nan)
        pixels[track.frames] = track.keypoints[:, hip]
        seen.append(pixels)
        R_cam_ref = pose.R_ref_cam.T
        P = camera.intrinsics.K @ np.column_stack([R_cam_ref, -R_cam_ref @ pose.t_ref_cam])
        rows.append(pixels[:, :, None] * P[2] - P[:2])
    systems = np.concatenate(rows, axis=1)
    errors = []
    for frame in np.flatnonzero(np.isfinite(systems).all(axis=(1, 2))):
        x = np.linalg.svd(systems[frame])[2][-1]
        x_ref = x[:3] / x[3]
        for pixels, pose in zip(seen, truth.cameras, strict=True):
            x_cam = pose.R_ref_cam.T @ (x_ref - pose.t_ref_cam)
            errors.append(np.linalg.norm(project(x_cam[None], pose.intrinsics)[0] - pixels[frame]))
    return np.array(errors)


@pytest.mark.skipif(not SOURCE.exists(), reason="the source data are not beside the checkout")
def test_script_makes_it_again(
    tmp_path: Path, recording: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    arguments = ["make_demo_bag.py", str(SOURCE), "--output", str(tmp_path)]
    monkeypatch.setattr("sys.argv", arguments)
    runpy.run_path(str(ROOT / "scripts" / "make_demo_bag.py"), run_name="__main__")
    made = (tmp_path / "balance_truth.yaml").read_text()
    assert made == (DEMO / "balance_truth.yaml").read_text()
    again = read_bag(tmp_path / "balance.mcap")
    for a, b in zip(again.cameras, recording.cameras, strict=True):
        np.testing.assert_array_equal(a.stamps, b.stamps)
        for s, t in zip(a.tracks, b.tracks, strict=True):
            np.testing.assert_array_equal(s.keypoints, t.keypoints)
            np.testing.assert_array_equal(s.joints, t.joints)
