"""Films by camera, as the user names them."""

from __future__ import annotations

from pathlib import Path

import pytest

from stcalib_ros.core.errors import InputError
from stcalib_ros.io.film_files import film_id, films_by_camera, is_film


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("cam2.mp4", "cam10.MP4", "notes.txt"):
        (tmp_path / name).write_bytes(b"x")
    return tmp_path


def test_cameras_are_named_by_their_files_in_the_order_of_their_numbers(folder: Path) -> None:
    films = films_by_camera([("", folder / "cam10.MP4"), ("", folder / "cam2.mp4")])
    assert list(films) == ["cam2", "cam10"]
    assert films == films_by_camera([("", folder)])


def test_a_name_that_is_given_is_taken(folder: Path) -> None:
    films = films_by_camera([("left", folder / "cam10.MP4"), ("", folder / "cam2.mp4")])
    assert films["left"] == folder / "cam10.MP4"
    assert len(films) == 2


def test_films_of_one_name_are_named_by_their_folders(tmp_path: Path) -> None:
    paths = [tmp_path / name / "film.mp4" for name in ("left", "right")]
    assert list(films_by_camera([("", path) for path in paths])) == ["left", "right"]


@pytest.mark.parametrize(
    ("given", "problem"),
    [
        ([("", "a.mp4")], r"two cameras or more are needed, got .*a\.mp4"),
        ([("", "a.mp4"), ("", "a.mp4")], "given twice"),
        ([("a", "a.mp4"), ("a", "b.mp4")], "a camera has two films"),
        ([("", "rtsp://camera/1"), ("", "b.mp4")], "is an address"),
        ([("", "img_%04d.png"), ("", "b.mp4")], "is a pattern of images"),
    ],
)
def test_what_cannot_be_films_of_cameras_is_said(
    given: list[tuple[str, str]], problem: str
) -> None:
    with pytest.raises(InputError, match=problem):
        films_by_camera([(name, Path(path)) for name, path in given])


def test_a_folder_without_films_is_said(tmp_path: Path) -> None:
    (tmp_path / "image_0001.png").write_bytes(b"x")
    with pytest.raises(InputError, match="has no films"):
        films_by_camera([("", tmp_path)])


def test_films_are_told_from_bags(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    bag = tmp_path_factory.mktemp("bag")
    (bag / "metadata.yaml").write_text("")
    (bag / "camera.mp4").write_bytes(b"x")
    found = [is_film(path) for path in (folder, folder / "cam2.mp4", bag, Path("walk.mcap"))]
    assert found == [True, True, False, False]


def test_the_identity_of_a_film_is_by_its_content(tmp_path: Path) -> None:
    contents = (b"a" * 5_000_000, b"a" * 5_000_000, b"a" * 4_999_999 + b"b", b"a" * 5_000_001)
    paths = [tmp_path / f"{number}.mp4" for number in range(4)]
    for path, content in zip(paths, contents, strict=True):
        path.write_bytes(content)
    one, same, *others = map(film_id, paths)
    assert one == same
    assert len({one, *others}) == 3
