"""Estimators on the film in the repository."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.film import score
from benchmarks.film.compare import JOINT_NAMES
from benchmarks.film.references import TrueReference
from stcalib_ros.core.model.keypoint_layouts import LAYOUTS, Layout
from stcalib_ros.estimation.poses import ImagePoses, UInt8Array
from stcalib_ros.io.films import film_images, open_film

_FILM = Path(__file__).parents[3] / "examples" / "film"
_HZ = 0.5


class _Knowing:
    """Knows the truth of every image in turn, and is 3 px off."""

    layout: Layout = LAYOUTS["coco_17"]

    def __init__(self) -> None:
        path = _FILM / "cam2.mp4"
        reference = TrueReference(_FILM)
        images = film_images(open_film("cam2", path), limit_hz=_HZ)
        self._seen = iter([reference.seen("cam2", one.stamp_s, 0) for one in images])

    def poses(self, image: UInt8Array) -> ImagePoses:
        assert image.shape == (480, 640, 3)
        order = [JOINT_NAMES.index(name) for name in self.layout.joint_names]
        keypoints = next(self._seen).keypoints[:, order] + np.array([0.0, 3.0])
        scores = np.isfinite(keypoints).all(-1).astype(float)
        return ImagePoses(keypoints, scores, np.full((*scores.shape, 3), np.nan))


def test_an_estimator_that_is_three_pixels_off(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("cam2.mp4", "truth.yaml", "truth.npz"):
        (tmp_path / name).symlink_to(_FILM / name)
    monkeypatch.setattr(score, "load_estimator", lambda *_, **__: _Knowing())
    assert score.main([str(tmp_path), "--estimators", "movenet:256", "--hz", str(_HZ)]) == 0
    row = next(line for line in capsys.readouterr().out.splitlines() if "all" in line)
    name, missed, hidden, invented, exchanged, unit, median, most, *_ = row.split()
    assert (name, missed.split("/")[0], hidden.split("/")[0]) == ("all", "0", "0")
    assert (invented, exchanged, unit) == ("0.00", "0.0", "%")
    assert (median, most) == ("3.0", "3.0")


def test_a_folder_without_films(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert score.main([str(tmp_path)]) == 2
    assert "no *.mp4; make them: python -m benchmarks.film" in capsys.readouterr().err
