"""Estimators by name: those of the package, and those of others as ``module:function``."""

from __future__ import annotations

import importlib
from pathlib import Path

from stcalib_ros.core.errors import InputError, one_line
from stcalib_ros.core.model.keypoint_layouts import Layout
from stcalib_ros.estimation.poses import PoseEstimator
from stcalib_ros.estimation.registry import load_estimator

_MAX_LINE = 400
"""Characters of an error of somebody else's module that are repeated. Chosen: a few lines."""


def named_estimator(
    name: str, *, size: int | None = None, threads: int = 1, folder: Path | None = None
) -> PoseEstimator:
    """Load an estimator of the package, or one of your own.

    Parameters
    ----------
    name : str
        One of `stcalib_ros.estimation.registry.ESTIMATORS`, or ``module:function``: what the
        function returns, called without arguments, is a
        `stcalib_ros.estimation.poses.PoseEstimator`.
    size, threads, folder
        As in `stcalib_ros.estimation.registry.load_estimator`; one of your own takes none of them.

    Raises
    ------
    InputError
        There is no such estimator, or it cannot be loaded.
    """
    module, colon, function = name.partition(":")
    if not colon:
        return load_estimator(name, size=size, threads=threads, folder=folder)
    try:
        estimator: PoseEstimator = getattr(importlib.import_module(module), function)()
    except InputError:
        raise
    except Exception as error:  # whatever a module of somebody else raises
        said = one_line(f"{type(error).__name__}: {error}", _MAX_LINE)
        raise InputError(f"estimator {name!r} cannot be loaded: {said}") from error
    if not isinstance(getattr(estimator, "layout", None), Layout) or not hasattr(
        estimator, "poses"
    ):
        raise InputError(
            f"estimator {name!r} returned a {type(estimator).__name__}, which has no layout of "
            "joints and no poses(image): see stcalib_ros.estimation.poses.PoseEstimator"
        )
    return estimator
