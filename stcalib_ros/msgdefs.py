"""The texts of our message definitions, readable without ROS and wherever we are installed."""

from __future__ import annotations

from pathlib import Path

from stcalib_ros.core.errors import InputError

_PACKAGE = Path(__file__).parent

_FOLDERS = (
    _PACKAGE / "definitions",  # pip and colcon installs copy msg/ to here
    _PACKAGE.parent / "msg",  # source tree
)


def definition(name: str) -> str:
    """Text of ``msg/<name>.msg``, comments included.

    Parameters
    ----------
    name : str
        Of a message of this package, without the package: ``"PersonPose3DArray"``.

    Raises
    ------
    InputError
        There is no such message, or the installation lacks its text.
    """
    for folder in _FOLDERS:
        path = folder / f"{name}.msg"
        if path.is_file():
            return path.read_text(encoding="utf-8")
    searched = " or ".join(str(folder) for folder in _FOLDERS)
    raise InputError(
        f"no definition of message {name!r} in {searched}: check the name, or reinstall stcalib_ros"
    )
