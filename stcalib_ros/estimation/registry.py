"""The estimators that there are, by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from stcalib_ros.core.errors import InputError
from stcalib_ros.estimation.movenet import MoveNet
from stcalib_ros.estimation.poses import PoseEstimator
from stcalib_ros.estimation.weights import MOVENET, find_weights

DEFAULT_ESTIMATOR = "movenet"
"""The one that is used if none is named."""


@dataclass(frozen=True, slots=True)
class EstimatorOptions:
    """How an estimator is to run.

    Attributes
    ----------
    size : int or None
        Length of the longer side of the network's input, px; None: the estimator's own.
    threads : int
        Threads of one image.
    folder : Path or None
        Folder of the weights; None: the usual one.
    """

    size: int | None = None
    threads: int = 1
    folder: Path | None = None


@dataclass(frozen=True, slots=True)
class Estimator:
    """What is known of an estimator before it is loaded.

    Attributes
    ----------
    load : callable
        Makes one.
    layout : str
        Name of the layout of its joints.
    in_3d : bool
        Whether it gives poses in 3D as well.
    licence : str
        Of its weights.
    source : str
        Where its weights come from.
    """

    load: Callable[[EstimatorOptions], PoseEstimator]
    layout: str
    in_3d: bool
    licence: str
    source: str


def _movenet(options: EstimatorOptions) -> PoseEstimator:
    (path,) = find_weights(MOVENET, options.folder)
    if options.size is None:
        return MoveNet(path, threads=options.threads)
    return MoveNet(path, size=options.size, threads=options.threads)


ESTIMATORS = {
    "movenet": Estimator(_movenet, "coco_17", False, MOVENET.licence, "npm"),
}
"""All estimators, by name."""


def load_estimator(
    name: str = DEFAULT_ESTIMATOR,
    *,
    size: int | None = None,
    threads: int = 1,
    folder: Path | None = None,
) -> PoseEstimator:
    """Load an estimator.

    Parameters
    ----------
    name : str
        One of `ESTIMATORS`.
    size : int, optional
        Length of the longer side of the network's input, px; default: the estimator's own.
    threads : int
        Threads of one image.
    folder : Path, optional
        Folder of the weights; default: `stcalib_ros.estimation.weights.models_folder`.

    Raises
    ------
    InputError
        There is no such estimator, a Python package or its weights are missing, or it does not take
        such a size.
    """
    try:
        estimator = ESTIMATORS[name]
    except KeyError:
        raise InputError(
            f"no estimator of the name {name!r}: there are {', '.join(ESTIMATORS)}"
        ) from None
    return estimator.load(EstimatorOptions(size, threads, folder))
