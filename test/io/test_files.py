"""Files that are there whole or not at all, and only where files belong."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from stcalib_ros.core.errors import InputError
from stcalib_ros.io.files import atomic_path, read_bounded, require_writable, sweep, write_text


def test_content_and_name_are_on_the_disk_before_it_counts(tmp_path, monkeypatch):
    """File, rename, folder: in this order, a power failure leaves the old or the new one."""
    done: list[str] = []

    def fsync(descriptor: int) -> None:
        kind = os.fstat(descriptor).st_mode
        done.append("folder" if stat.S_ISDIR(kind) else "file")

    replace = os.replace

    def replaced(*paths: object) -> None:
        done.append("rename")
        replace(*paths)

    monkeypatch.setattr(os, "fsync", fsync)
    monkeypatch.setattr(os, "replace", replaced)
    write_text(tmp_path / "a.yaml", "x")
    assert done == ["file", "rename", "folder"]
    done.clear()
    with atomic_path(tmp_path / "bag") as temporary:
        temporary.mkdir()
        (temporary / "bag_0.mcap").write_bytes(b"x")
        (temporary / "metadata.yaml").write_bytes(b"x")
    assert done == ["file", "file", "folder", "rename", "folder"]


def test_a_file_system_that_cannot_sync_folders_is_one_all_the_same(tmp_path, monkeypatch):
    fsync = os.fsync

    def refuse_folders(descriptor: int) -> None:
        if stat.S_ISDIR(os.fstat(descriptor).st_mode):
            raise OSError(22, "Invalid argument")
        fsync(descriptor)

    monkeypatch.setattr(os, "fsync", refuse_folders)
    write_text(tmp_path / "a.yaml", "x")
    assert (tmp_path / "a.yaml").read_text() == "x"


def test_a_full_disk_leaves_what_was_there(tmp_path, monkeypatch):
    write_text(tmp_path / "a.yaml", "before")

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(InputError, match=r"cannot write .*a\.yaml: No space left"):
        write_text(tmp_path / "a.yaml", "after")
    assert (tmp_path / "a.yaml").read_text() == "before"
    assert os.listdir(tmp_path) == ["a.yaml"]


def test_only_regular_files_are_replaced(tmp_path):
    """A device as root: what looks like one, a pipe and a link to it, stays what it is."""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to(tmp_path / "pipe")
    (tmp_path / "null").symlink_to("/dev/null")
    (tmp_path / "dangling").symlink_to(tmp_path / "absent")
    for name in ("pipe", "link", "null", "dangling"):
        before = (tmp_path / name).lstat()
        with pytest.raises(InputError, match="it is not a regular file; name another"):
            write_text(tmp_path / name, "x")
        with pytest.raises(InputError, match="it is not a regular file; name another"):
            require_writable(tmp_path / name)
        assert (tmp_path / name).lstat().st_mode == before.st_mode
    assert sorted(os.listdir(tmp_path)) == ["dangling", "link", "null", "pipe"]


@pytest.mark.parametrize("name", ["x" * 255, "é" * 127])
def test_the_longest_names_there_are(tmp_path, name):
    require_writable(tmp_path / name)
    write_text(tmp_path / name, "x")
    assert os.listdir(tmp_path) == [name]


@pytest.mark.parametrize("name", ["x" * 256, "nul\0"])
def test_names_that_cannot_be(tmp_path, name):
    for write in (require_writable, lambda path: write_text(path, "x")):
        with pytest.raises(InputError, match="cannot write"):
            write(tmp_path / name)
    assert os.listdir(tmp_path) == []


def test_what_a_killed_process_was_writing_is_swept(tmp_path):
    code = f"""
import os, signal
from pathlib import Path
from stcalib_ros.io.files import atomic_path
with atomic_path(Path({str(tmp_path / "a.yaml")!r})) as temporary:
    temporary.write_text("half")
    os.kill(os.getpid(), signal.SIGKILL)
"""
    env = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
    subprocess.run([sys.executable, "-c", code], env=env, check=False)
    assert len(os.listdir(tmp_path)) == 1
    mine = f".stcalib-{os.getppid()}-00000000.tmp"
    for name in (mine, ".hidden.tmp", ".stcalib-x-00000000.tmp", "a.yaml"):
        (tmp_path / name).touch()
    sweep(tmp_path)
    assert sorted(os.listdir(tmp_path)) == [
        ".hidden.tmp",
        mine,
        ".stcalib-x-00000000.tmp",
        "a.yaml",
    ]


def test_reading_is_bounded(tmp_path):
    (tmp_path / "a").write_text("süß")
    assert read_bounded(tmp_path / "a", 5) == "süß"
    with pytest.raises(InputError, match="more than 4 bytes"):
        read_bounded(tmp_path / "a", 4)
