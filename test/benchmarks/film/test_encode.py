"""Films have the stamps of their images."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmarks.film.encode import encode
from stcalib_ros.core.errors import InputError

_TICKS = np.array([0, 1, 4, 5, 7, 11])


@pytest.fixture
def images(tmp_path: Path) -> Path:
    for k in range(len(_TICKS)):
        image = np.full((48, 64, 3), 40 * k, dtype=np.uint8)
        cv2.imwrite(str(tmp_path / f"{k:06d}.png"), image)
    return tmp_path


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="no program ffmpeg")
def test_stamps_and_images_come_back(images: Path) -> None:
    encode(images, _TICKS, 12.5, images / "film.mp4", 20)
    film = cv2.VideoCapture(str(images / "film.mp4"))
    for k, tick in enumerate(_TICKS):
        there, image = film.read()
        assert there
        assert film.get(cv2.CAP_PROP_POS_MSEC) == pytest.approx(1000 * tick / 12.5, abs=0.1)
        assert image.mean() == pytest.approx(40 * k, abs=4)
    assert not film.read()[0]


def test_missing_images_are_counted(images: Path) -> None:
    with pytest.raises(InputError, match="6 images of 7; take the others first"):
        encode(images, np.arange(7), 12.5, images / "film.mp4", 20)
    assert not (images / "film.mp4").exists()
