"""Films: which images, at which times, of which size; and files that are none."""

from __future__ import annotations

import wave
from pathlib import Path

import cv2
import numpy as np
import pytest
from film_helpers import made_at, number_of, numbered_image, turned, with_stamps, write_film

from stcalib_ros.core.errors import InputError
from stcalib_ros.io.film_header import read_film_header
from stcalib_ros.io.films import expected_images, film_images, open_film

FAST_HZ = 1000.0
"""A limit that no film comes near."""


def times_of(path: Path, limit_hz: float = FAST_HZ) -> list[float]:
    film = open_film("cam0", path)
    return [image.stamp_s for image in film_images(film, limit_hz=limit_hz)]


def test_images_have_the_times_of_the_container_where_the_rate_varies(tmp_path: Path) -> None:
    stamps = np.array([0.0, 0.1, 0.25, 0.3, 0.7, 0.8, 0.95])
    path = with_stamps(write_film(tmp_path / "a.mp4", range(7), fps=5.0), stamps)
    assert times_of(path) == pytest.approx(stamps, abs=1e-3)


def test_the_limit_chooses_the_first_image_of_each_period_by_its_time(tmp_path: Path) -> None:
    stamps = np.array([0.0, 0.1, 0.25, 0.3, 0.7, 0.8, 0.95, 1.0])
    path = write_film(tmp_path / "a.mp4", range(8), fps=5.0)
    film = open_film("cam0", with_stamps(path, stamps))
    images = list(film_images(film, limit_hz=2.0))
    assert [number_of(image.image) for image in images] == [0, 4, 7]
    assert [image.stamp_s for image in images] == pytest.approx([0.0, 0.7, 1.0], abs=1e-3)


def test_a_third_of_30_hz_is_10_hz_whatever_the_times_are_rounded_to(tmp_path: Path) -> None:
    stamps = np.round(np.arange(31) / 30, 3)
    path = with_stamps(write_film(tmp_path / "a.mp4", range(31), fps=30.0), stamps)
    assert times_of(path, 10.0) == pytest.approx(np.arange(11) / 10, abs=1e-3)
    assert expected_images(open_film("cam0", path), 10.0) == 10


def test_reading_goes_on_after_the_images_that_are_done(tmp_path: Path) -> None:
    film = open_film("cam0", write_film(tmp_path / "a.mp4", range(20)))
    images = list(film_images(film, limit_hz=5.0, skip=4))
    assert [number_of(image.image) for image in images] == [8, 10, 12, 14, 16, 18]


def test_the_rotation_tag_turns_images_and_their_size(tmp_path: Path) -> None:
    film = open_film("cam0", turned(write_film(tmp_path / "a.mp4", [5, 6])))
    assert film.size == (240, 320)
    image = next(film_images(film, limit_hz=FAST_HZ)).image
    assert image.shape == (320, 240, 3)
    assert number_of(cv2.rotate(image, cv2.ROTATE_90_COUNTERCLOCKWISE)) == 5


def test_the_header_says_when_a_film_was_made_and_how_long_it_is(tmp_path: Path) -> None:
    path = write_film(tmp_path / "a.mp4", range(20))
    assert read_film_header(path).made_s is None
    assert read_film_header(path).duration_s == pytest.approx(2.0)
    assert read_film_header(made_at(path, 1_790_000_000)).made_s == 1_790_000_000


def test_android_says_when_a_film_ended(tmp_path: Path) -> None:
    path = made_at(write_film(tmp_path / "a.mp4", range(20)), 1_790_000_000, android=True)
    assert read_film_header(path).made_s == pytest.approx(1_790_000_000 - 2.0)


def not_films(folder: Path) -> dict[str, Path]:
    """Files that are no films."""
    whole = write_film(folder / "whole.mp4", range(20)).read_bytes()
    (folder / "cut.mp4").write_bytes(whole[: len(whole) // 2])
    (folder / "empty.mp4").write_bytes(b"")
    (folder / "text.mp4").write_text("not a film\n" * 100)
    (folder / "noise.mp4").write_bytes(np.random.default_rng(0).bytes(20_000))
    cv2.imwrite(str(folder / "picture.png"), numbered_image(0, (320, 240)))
    with wave.open(str(folder / "sound.wav"), "wb") as sound:
        sound.setparams((1, 2, 8000, 0, "NONE", ""))
        sound.writeframes(bytes(16_000))
    return {path.stem: path for path in folder.iterdir()} | {"missing": folder / "missing.mp4"}


@pytest.mark.parametrize(
    ("name", "problem"),
    [
        ("cut", r"cut\.mp4 is no film.* bytes are missing at its end"),
        ("empty", r"empty\.mp4 is empty"),
        ("text", r"text\.mp4 is no film.* no images or no table of contents"),
        ("noise", r"noise\.mp4 is no film"),
        ("picture", r"picture\.png has one image"),
        ("sound", r"sound\.wav is no film"),
        ("missing", r"missing\.mp4: no such file"),
    ],
)
def test_what_is_no_film_is_named_with_the_reason(name: str, problem: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=problem):
        open_film("cam0", not_films(tmp_path)[name])


def test_a_folder_is_no_film(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="a folder"):
        open_film("cam0", tmp_path)
