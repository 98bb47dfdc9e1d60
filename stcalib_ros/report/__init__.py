"""Reports and figures of a calibration; they need the extra ``report``."""

from __future__ import annotations

from importlib.util import find_spec

from stcalib_ros.core.errors import InputError


def require_matplotlib(what: str) -> None:
    """Make sure, before the long work, that pictures can be drawn.

    Raises
    ------
    InputError
        Matplotlib is not installed; `what` needs it.
    """
    if find_spec("matplotlib") is None:
        raise InputError(
            f"{what} needs Matplotlib, which is not installed: pip install 'stcalib-ros[report]'"
        )
