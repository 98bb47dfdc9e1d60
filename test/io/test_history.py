"""Numbered calibrations: the newest is in force, whatever happens while one is written."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.calibration import Calibration, CameraCalibration, Status
from stcalib_ros.core.model.recording import Intrinsics, LensModel
from stcalib_ros.io.camera_info_yaml import read_camera_info_yaml
from stcalib_ros.io.exports.plain import CAMERA_INFO, STCALIB
from stcalib_ros.io.history import History, Kept
from stcalib_ros.io.limits import MAX_FILES
from stcalib_ros.io.results import write_result

LENS = Intrinsics(640, 480, LensModel.PLUMB_BOB, np.diag([600.0, 600.0, 1.0]), np.zeros(5))


def calibration(n_inliers: int) -> Calibration:
    cameras = tuple(
        CameraCalibration(
            f"cam{i}",
            f"cam{i}_optical_frame",
            LENS,
            np.eye(3),
            np.full(3, float(i)),
            np.eye(6),
            0.0,
            0.0,
        )
        for i in range(2)
    )
    return Calibration(
        Status.OK, "", "cam0", True, 1.0, (1.0, 2.0), cameras, (), (), (), 1.0, 100, n_inliers
    )


@pytest.fixture
def history(tmp_path: Path) -> History:
    return History(tmp_path / "a" / "results", keep=3)


def names(history: History) -> list[str]:
    return sorted(p.name for p in history.folder.iterdir())


def anything(_: Calibration) -> None:
    """Every calibration that can be read can be used."""


def test_none_is_in_force_at_first(history):
    assert history.latest(anything) == (None, ())
    with pytest.raises(InputError, match="no earlier calibration"):
        history.before(0, anything)
    assert not history.folder.exists()


def test_the_newest_is_in_force_and_the_oldest_go(history):
    assert [history.add(calibration(n)) for n in (10, 20, 30, 40)] == [1, 2, 3, 4]
    assert names(history) == [f"calibration.00000{n}.yaml" for n in (2, 3, 4)]
    latest, skipped = history.latest(anything)
    assert latest is not None
    assert skipped == ()
    assert (latest.number, latest.calibration.n_inliers) == (4, 40)


def rollback(history: History, number: int) -> Kept:
    earlier, _ = history.before(number, anything)
    history.withdraw_after(earlier.number)
    return earlier


def test_a_rollback_keeps_what_it_withdraws_and_its_number(history):
    history.add(calibration(10))
    history.add(calibration(20))
    earlier = rollback(history, 2)
    assert (earlier.number, earlier.calibration.n_inliers) == (1, 10)
    latest, skipped = history.latest(anything)
    assert latest is not None
    assert skipped == ()
    assert latest.number == 1
    assert names(history) == ["calibration.000001.yaml", "calibration.000002.withdrawn.yaml"]
    with pytest.raises(InputError, match="no earlier calibration"):
        history.before(1, anything)
    assert history.add(calibration(30)) == 3


def test_before_one_that_was_not_saved_is_the_newest_file(history):
    history.add(calibration(10))
    history.add(calibration(20))
    assert rollback(history, 0).number == 2
    assert names(history) == ["calibration.000001.yaml", "calibration.000002.yaml"]
    assert rollback(history, 2).number == 1


DAMAGED = {
    "empty": b"",
    "zeros": b"\0" * 4096,
    "cut": None,
    "other version": b"format: stcalib/9",
    "no text": b"\xff\xfe",
}


def damage(path: Path, kind: str) -> None:
    content = DAMAGED[kind]
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2] if content is None else content)


@pytest.mark.parametrize("kind", DAMAGED)
def test_the_newest_that_can_be_used_is_in_force(history, kind):
    for n in (10, 20, 30):
        history.add(calibration(n))
    damage(history.folder / "calibration.000003.yaml", kind)
    latest, skipped = history.latest(anything)
    assert (latest.number, latest.calibration.n_inliers) == (2, 20)
    assert len(skipped) == 1
    assert "calibration.000003.yaml" in skipped[0]
    assert "\n" not in skipped[0]
    assert history.add(calibration(40)) == 4


@pytest.mark.parametrize("kind", DAMAGED)
def test_a_rollback_passes_over_damaged_files(history, kind):
    for n in (10, 20, 30):
        history.add(calibration(n))
    damage(history.folder / "calibration.000002.yaml", kind)
    earlier, skipped = history.before(3, anything)
    assert (earlier.number, len(skipped)) == (1, 1)
    history.withdraw_after(1)
    assert history.latest(anything).kept.number == 1
    damage(history.folder / "calibration.000001.yaml", kind)
    before = names(history)
    with pytest.raises(InputError, match=r"no earlier .*; .*calibration\.000001"):
        history.before(3, anything)
    assert names(history) == before


def test_what_the_caller_cannot_use_is_passed_over(history):
    for n in (10, 20):
        history.add(calibration(n))

    def usable(one: Calibration) -> None:
        if one.n_inliers == 20:
            raise InputError("of other cameras")

    latest, skipped = history.latest(usable)
    assert latest.number == 1
    assert skipped == ("calibration.000002.yaml: of other cameras",)


def test_what_is_no_file_is_passed_over(history):
    history.add(calibration(10))
    (history.folder / "calibration.000002.yaml").mkdir()
    os.mkfifo(history.folder / "calibration.000003.yaml")
    latest, skipped = history.latest(anything)
    assert latest.number == 1
    assert all("is not a regular file" in problem for problem in skipped)
    assert history.add(calibration(20)) == 4


def test_after_a_million_the_numbers_go_on(history):
    history.folder.mkdir(parents=True)
    write_result(calibration(10), history.folder / "calibration.999999.yaml")
    assert history.add(calibration(20)) == 1_000_000
    assert history.latest(anything).kept.calibration.n_inliers == 20


@pytest.mark.skipif(os.geteuid() == 0, reason="root may list everything")
@pytest.mark.parametrize("rights", [0o300, 0o000])
def test_a_folder_that_cannot_be_listed_is_said(history, rights):
    history.add(calibration(10))
    history.folder.chmod(rights)
    try:
        refused_everywhere(history)
    finally:
        history.folder.chmod(0o700)


def test_a_listing_that_fails_is_said(history, monkeypatch):
    """As a folder without rights does it, whoever runs the test."""
    history.add(calibration(10))

    def refuse(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "iterdir", refuse)
    refused_everywhere(history)


def refused_everywhere(history: History) -> None:
    for do in (
        lambda: history.latest(anything),
        lambda: history.before(0, anything),
        lambda: history.add(calibration(20)),
        lambda: history.export(calibration(20), "x.yaml", STCALIB),
        lambda: history.withdraw_after(0),
        history.sweep,
    ):
        with pytest.raises(InputError, match=r"cannot .*: Permission denied"):
            do()


def test_one_process_holds_the_folder(history):
    history.add(calibration(10))
    assert history.claim()
    assert history.claim()
    code = f"""
from pathlib import Path
from stcalib_ros.io.camera_info_yaml import read_camera_info_yaml
from stcalib_ros.io.history import History
print(History(Path({str(history.folder)!r}), keep=3).claim())
"""
    assert run(code) == "False\n"
    assert History(history.folder / "none", keep=3).claim()


def run(code: str) -> str:
    return subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])},
        capture_output=True,
        text=True,
        check=True,
    ).stdout


def test_killed_while_it_writes_the_one_before_is_in_force(history):
    """The process dies by SIGKILL when half of the file is written."""
    history.add(calibration(10))
    code = f"""
import os, signal
from pathlib import Path
from stcalib_ros.io import files, history
from stcalib_ros.io.results import read_result

def half(self, text, **_):
    with self.open("w") as stream:
        stream.write(text[: len(text) // 2])
        stream.flush()
        os.fsync(stream.fileno())
    os.kill(os.getpid(), signal.SIGKILL)

Path.write_text = half
folder = Path({str(history.folder)!r})
history.History(folder, keep=3).add(read_result(folder / "calibration.000001.yaml"))
"""
    root = str(Path(__file__).parents[2])
    killed = subprocess.run(
        [sys.executable, "-c", code], env=os.environ | {"PYTHONPATH": root}, check=False
    )
    assert killed.returncode == -9
    assert len(names(history)) == 2, "nothing was being written"
    latest, skipped = history.latest(anything)
    assert latest is not None
    assert skipped == ()
    assert (latest.number, latest.calibration.n_inliers) == (1, 10)
    assert history.add(calibration(20)) == 2
    assert names(history) == ["calibration.000001.yaml", "calibration.000002.yaml"]


def test_killed_at_any_time_what_is_there_is_whole(history):
    """Processes that save without end, each killed by SIGKILL amid it: a save takes some 5 ms."""
    history.add(calibration(10))
    code = f"""
import os, random, signal, time
from pathlib import Path
from stcalib_ros.io.camera_info_yaml import read_camera_info_yaml
from stcalib_ros.io.history import History

history = History(Path({str(history.folder)!r}), keep=3)
first, _ = history.latest(lambda _: None)
random.seed(0)
for _ in range(25):
    if not (child := os.fork()):
        while True:
            history.add(first.calibration)
    time.sleep(random.uniform(0.005, 0.08))
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    found, _ = history.latest(lambda _: None)
    assert found.number >= first.number, (found.number, first.number)
    assert found.calibration.n_inliers == 10
    first = found
print(first.number)
"""
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 10, "hardly anything was saved"
    last = history.add(calibration(20))
    assert names(history) == [f"calibration.{n:06d}.yaml" for n in (last - 2, last - 1, last)]


def test_export_writes_below_the_folder(history):
    history.add(calibration(10))
    (history.folder / "site").mkdir()
    path = history.export(calibration(10), "site/hall.yaml", STCALIB)
    assert path.read_text() == (history.folder / "calibration.000001.yaml").read_text()


@pytest.mark.parametrize(
    "name",
    [
        "",
        "/tmp/x.yaml",
        "../x.yaml",
        "site/../../x.yaml",
        "no\0.yaml",
        "x.sh",
        "calibration.000001.yaml",
        "absent/x.yaml",
        "out/x.yaml",
        "link.yaml",
        "folder.yaml",
        "file.yaml/x.yaml",
        f"{'x' * 300}.yaml",
        f"{'x' * 251}.yaml",
        "line\nbreak.yaml",
        "\x1b[31mred.yaml",
        "pipe.yaml",
        "circle/x.yaml",
        "circle.yaml",
    ],
)
def test_export_writes_nowhere_else(history, tmp_path, name):
    history.add(calibration(10))
    outside = tmp_path / "outside"
    outside.mkdir()
    target = tmp_path / "target.yaml"
    target.write_text("untouched")
    (history.folder / "out").symlink_to(outside)
    (history.folder / "link.yaml").symlink_to(target)
    (history.folder / "folder.yaml").mkdir()
    (history.folder / "file.yaml").touch()
    os.mkfifo(history.folder / "pipe.yaml")
    (history.folder / "circle").symlink_to("circle")
    (history.folder / "circle.yaml").symlink_to("circle.yaml")
    before = sorted(p for p in tmp_path.rglob("*"))
    with pytest.raises(InputError):
        history.export(calibration(20), name, STCALIB)
    assert sorted(p for p in tmp_path.rglob("*")) == before
    assert target.read_text() == "untouched"
    latest, skipped = history.latest(anything)
    assert latest is not None
    assert skipped == ()
    assert latest.calibration.n_inliers == 10


@pytest.mark.parametrize("length", [230, 241, 245, 250, 255])
def test_export_to_the_longest_names_there_are(history, length):
    name = f"{'n' * (length - 5)}.yaml"
    history.export(calibration(10), name, STCALIB)
    assert names(history) == [name]


def test_export_does_not_fill_the_disk(history):
    history.add(calibration(10))
    for n in range(MAX_FILES - 1):
        (history.folder / f"{n}.yaml").touch()
    with pytest.raises(InputError, match="no more than 1000 files"):
        history.export(calibration(10), "one_more.yaml", STCALIB)
    assert history.export(calibration(10), "1.yaml", STCALIB).stat().st_size > 0


def test_lenses_are_written_below_the_folder(history):
    history.add(calibration(10))
    for _ in range(2):
        folder = history.export(calibration(10), "lenses", CAMERA_INFO)
    assert folder == history.folder / "lenses"
    assert sorted(p.name for p in folder.iterdir()) == ["cam0.yaml", "cam1.yaml"]
    name, lens = read_camera_info_yaml(folder / "cam1.yaml")
    assert (name, lens.width) == ("cam1", LENS.width)
    np.testing.assert_array_equal(lens.K, LENS.K)
    latest, skipped = history.latest(anything)
    assert latest is not None
    assert skipped == ()


@pytest.mark.parametrize(
    "name",
    ["", ".", "..", "/tmp/x", "../x", "a/b", "out", "out/x", "x.yaml", "file", "circle", "a\nb"],
)
def test_lenses_are_written_nowhere_else(history, tmp_path, name):
    history.add(calibration(10))
    outside = tmp_path / "outside"
    outside.mkdir()
    (history.folder / "out").symlink_to(outside)
    (history.folder / "file").touch()
    (history.folder / "circle").symlink_to("circle")
    before = sorted(p for p in tmp_path.rglob("*"))
    with pytest.raises(InputError):
        history.export(calibration(20), name, CAMERA_INFO)
    assert sorted(p for p in tmp_path.rglob("*")) == before


def test_lenses_do_not_fill_the_disk(history):
    folder = history.export(calibration(10), "lenses", CAMERA_INFO)
    for n in range(MAX_FILES - 2):
        (folder / f"{n}.yaml").touch()
    assert history.export(calibration(10), "lenses", CAMERA_INFO) == folder
    (folder / "cam1.yaml").rename(folder / "one_more.yaml")
    with pytest.raises(InputError, match="no more than 1000 files"):
        history.export(calibration(10), "lenses", CAMERA_INFO)


def test_what_cannot_be_written_is_said(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="cannot make"):
        History(tmp_path / "file" / "results", keep=3).add(replace(calibration(1), message="x"))


def test_results_are_those_of_the_command_line(history, tmp_path):
    write_result(calibration(10), tmp_path / "out.yaml")
    history.add(calibration(10))
    assert (tmp_path / "out.yaml").read_text() == (
        history.folder / "calibration.000001.yaml"
    ).read_text()
