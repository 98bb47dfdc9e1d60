"""From films to a recording: times, people, what is kept after an interruption."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path

import film_helpers
import numpy as np
import pytest
from film_helpers import NumberEstimator, made_at, write_film, write_scene_films

import stcalib_ros as st
from stcalib_ros.commands.jobs import processes
from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.recording import Recording
from stcalib_ros.estimation.film_recording import FilmOptions, read_films
from stcalib_ros.estimation.parts import n_kept
from stcalib_ros.estimation.poses import ImagePoses, UInt8Array

ROOT = Path(__file__).parents[2]
SCENE = st.SceneOptions(n_cameras=2, n_people=2, n_frames=40, fps=20.0, image_size=(320, 240))


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Path], Recording]:
    folder = tmp_path_factory.mktemp("films")
    films, recording = write_scene_films(folder, SCENE)
    return folder, films, recording


def poses_by_image(recording: Recording, camera: int) -> list[list[float]]:
    """Mean coordinate of all persons in each image."""
    found: list[list[float]] = [[] for _ in recording.cameras[camera].stamps]
    for track in recording.cameras[camera].tracks:
        for frame, points in zip(track.frames, track.keypoints, strict=True):
            found[frame].append(float(np.nanmean(points)))
    return [sorted(one) for one in found]


def test_a_recording_has_all_images_with_their_times_and_people(
    scene: tuple[Path, dict[str, Path], Recording],
) -> None:
    folder, films, truth = scene
    options = FilmOptions(limit_hz=100.0)
    found = read_films(films, partial(NumberEstimator, folder / "poses.npz"), options)
    assert [camera.name for camera in found.cameras] == ["cam0", "cam1"]
    for k, (one, other) in enumerate(zip(found.cameras, truth.cameras, strict=True)):
        assert one.stamps == pytest.approx(other.stamps, abs=1e-3)
        assert (one.intrinsics.width, one.intrinsics.height) == (320, 240)
        assert not one.intrinsics.known
        for a, b in zip(poses_by_image(found, k), poses_by_image(truth, k), strict=True):
            assert a == pytest.approx(b)


def test_two_processes_find_the_same(
    scene: tuple[Path, dict[str, Path], Recording], tmp_path: Path
) -> None:
    folder, films, _ = scene
    make = partial(NumberEstimator, folder / "poses.npz")
    progress: list[tuple[int, int]] = []
    with processes(2) as executor:
        found = read_films(
            films, make, executor=executor, progress=lambda n, total, _: progress.append((n, total))
        )
    alone = read_films(films, make)
    for k in (0, 1):
        assert np.array_equal(found.cameras[k].stamps, alone.cameras[k].stamps)
        assert poses_by_image(found, k) == poses_by_image(alone, k)
    assert progress[-1] == (40, 40)


class Interrupting(NumberEstimator):
    """Is interrupted after some images."""

    def __init__(self, poses: Path, n_images: int) -> None:
        super().__init__(poses)
        self._left = n_images

    def poses(self, image: UInt8Array) -> ImagePoses:
        if not self._left:
            raise KeyboardInterrupt
        self._left -= 1
        return super().poses(image)


def test_after_an_interruption_the_rest_is_done_and_no_image_twice(
    scene: tuple[Path, dict[str, Path], Recording], tmp_path: Path
) -> None:
    folder, films, _ = scene
    options = FilmOptions(limit_hz=100.0, parts=tmp_path / "parts")
    with pytest.raises(KeyboardInterrupt):
        read_films(films, partial(Interrupting, folder / "poses.npz", 50), options)
    rest = partial(Interrupting, folder / "poses.npz", 30)
    found = read_films(films, rest, options)
    whole = read_films(films, partial(NumberEstimator, folder / "poses.npz"), FilmOptions(100.0))
    for k in (0, 1):
        assert np.array_equal(found.cameras[k].stamps, whole.cameras[k].stamps)
        assert poses_by_image(found, k) == poses_by_image(whole, k)


@pytest.mark.parametrize("change", [{"limit_hz": 5.0}, {"estimator_name": "other"}])
def test_parts_of_other_options_are_not_taken(
    change: dict[str, float | str],
    scene: tuple[Path, dict[str, Path], Recording],
    tmp_path: Path,
) -> None:
    folder, films, _ = scene
    make = partial(NumberEstimator, folder / "poses.npz")
    read_films(films, make, FilmOptions(parts=tmp_path / "parts"))
    options = FilmOptions(parts=tmp_path / "parts", **change)  # type: ignore[arg-type]
    with pytest.raises(KeyboardInterrupt):
        read_films(films, partial(Interrupting, folder / "poses.npz", 0), options)


@pytest.fixture
def two_films(tmp_path: Path) -> dict[str, Path]:
    """Films of two cameras."""
    return {name: write_film(tmp_path / f"{name}.mp4", range(10)) for name in ("cam0", "cam1")}


def test_clocks_begin_when_the_films_were_made_if_all_say_so(
    scene: tuple[Path, dict[str, Path], Recording], two_films: dict[str, Path]
) -> None:
    make = partial(NumberEstimator, scene[0] / "poses.npz")
    made_at(two_films["cam0"], 1_790_000_003)
    together = read_films(two_films, make)
    assert [camera.stamps[0] for camera in together.cameras] == [0.0, 0.0]
    made_at(two_films["cam1"], 1_790_000_001)
    found = read_films(two_films, make)
    assert found.epoch_ns == 1_790_000_001 * 10**9
    assert [camera.stamps[0] for camera in found.cameras] == [2.0, 0.0]


class Nobody(NumberEstimator):
    """Finds nobody."""

    def poses(self, image: UInt8Array) -> ImagePoses:
        found = super().poses(image)
        return ImagePoses(found.keypoints[:0], found.scores[:0], found.joints[:0])


def test_films_without_people_are_refused(
    scene: tuple[Path, dict[str, Path], Recording], two_films: dict[str, Path]
) -> None:
    with pytest.raises(InputError, match=r"nobody was found in .*cam0\.mp4"):
        read_films(two_films, partial(Nobody, scene[0] / "poses.npz"))


def test_a_film_that_grows_while_it_is_read_is_refused(
    scene: tuple[Path, dict[str, Path], Recording], two_films: dict[str, Path]
) -> None:
    class Growing(NumberEstimator):
        def poses(self, image: UInt8Array) -> ImagePoses:
            with two_films["cam0"].open("ab") as stream:
                stream.write(b"\0" * 8)
            return super().poses(image)

    with pytest.raises(InputError, match=r"cam0\.mp4 was changed while it was read"):
        read_films(two_films, partial(Growing, scene[0] / "poses.npz"))


def test_a_film_of_which_the_end_is_missing_is_used_with_a_warning(
    scene: tuple[Path, dict[str, Path], Recording], two_films: dict[str, Path]
) -> None:
    content = two_films["cam1"].read_bytes()
    at = content.index(b"mvhd") + 4
    ticks = int.from_bytes(content[at + 16 : at + 20], "big") * 3
    two_films["cam1"].write_bytes(
        content[: at + 16] + ticks.to_bytes(4, "big") + content[at + 20 :]
    )
    warnings: list[str] = []
    make = partial(NumberEstimator, scene[0] / "poses.npz")
    read_films(two_films, make, warn=warnings.append)
    assert len(warnings) == 1
    assert "0.9 s of 3.0 s can be read" in warnings[0]


def test_ctrl_c_in_a_terminal_which_all_processes_get_keeps_what_is_done(
    scene: tuple[Path, dict[str, Path], Recording], tmp_path: Path
) -> None:
    folder, films, _ = scene
    parts, poses = tmp_path / "parts", folder / "poses.npz"
    paths = {name: str(path) for name, path in films.items()}
    code = (
        "from functools import partial; from pathlib import Path\n"
        "from film_helpers import SlowEstimator\n"
        "from stcalib_ros.commands.jobs import processes\n"
        "from stcalib_ros.estimation.film_recording import FilmOptions, read_films\n"
        f"films = {{name: Path(path) for name, path in {paths}.items()}}\n"
        f"options = FilmOptions(100.0, parts=Path({str(parts)!r}))\n"
        "with processes(2) as executor:\n"
        f"    read_films(films, partial(SlowEstimator, Path({str(poses)!r})), options,\n"
        "        executor=executor, progress=lambda n, *_: print(n, flush=True))\n"
    )
    helpers = Path(film_helpers.__file__).parent
    process = subprocess.Popen(
        [sys.executable, "-c", code],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), str(helpers)])},
        start_new_session=True,
    )
    assert process.stdout is not None
    assert any(int(line) > 0 for line in process.stdout)
    os.killpg(process.pid, signal.SIGINT)
    err = process.communicate(timeout=60)[1]
    assert process.returncode == -signal.SIGINT
    assert err.splitlines()[-1] == "KeyboardInterrupt"
    kept = n_kept(parts)
    assert 0 < kept < 80
    found = read_films(
        films, partial(Interrupting, poses, 80 - kept), FilmOptions(100.0, parts=parts)
    )
    assert [len(camera.stamps) for camera in found.cameras] == [40, 40]
