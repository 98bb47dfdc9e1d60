"""The 3D library of a report, three.js with its controls, as the package trimesh carries it."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from zipfile import BadZipFile, ZipFile

from stcalib_ros.core.errors import InputError

_ARCHIVE, _PAGE = Path("resources/templates/viewer.zip"), "viewer.html.template"
_BEGIN, _END = "<script>", "THREE.TrackballControls=TrackballControls;})();"
_MISSING = "a report needs trimesh, which carries three.js: pip install 'stcalib-ros[report]'"


def require_three_js() -> None:
    """Make sure, before the long work, that a report can be made.

    Raises
    ------
    InputError
        trimesh is not installed, or has no three.js.
    """
    three_js()


def three_js() -> str:
    """Return three.js and its TrackballControls as one script, which defines ``THREE``.

    Raises
    ------
    InputError
        trimesh is not installed, or has no three.js.
    """
    spec = find_spec("trimesh")
    if spec is None or not spec.submodule_search_locations:
        raise InputError(_MISSING)
    archive = Path(spec.submodule_search_locations[0]) / _ARCHIVE
    try:
        with ZipFile(archive) as file:
            page = file.read(_PAGE).decode("utf-8")
        begin = page.index(_BEGIN) + len(_BEGIN)
        return page[begin : page.index(_END, begin) + len(_END)]
    except (OSError, BadZipFile, KeyError, ValueError) as error:
        raise InputError(f"{_MISSING} ({archive} has none)") from error
