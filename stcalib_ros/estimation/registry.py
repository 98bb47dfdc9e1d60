"""The estimators that there are, by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from stcalib_ros.core.errors import InputError
from stcalib_ros.estimation.blazepose import BlazePose
from stcalib_ros.estimation.movenet import MoveNet
from stcalib_ros.estimation.poses import PoseEstimator
from stcalib_ros.estimation.rtmlib_adapter import RTMO, RTMPOSE, RtmlibEstimator
from stcalib_ros.estimation.runtime import require_package
from stcalib_ros.estimation.weights import BLAZEPOSE, MOVENET, Weights, find_weights, models_folder

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
    weights : tuple of Weights
        That ``stcalib models fetch`` brings; empty: it fetches its own when it is first used.
    extra : str
        Name of the optional dependencies that it needs.
    packages : tuple of str
        The modules among them that it imports.
    film_size : int or None
        `EstimatorOptions.size` for films, where accuracy counts more than time.
    """

    load: Callable[[EstimatorOptions], PoseEstimator]
    layout: str
    in_3d: bool
    licence: str
    weights: tuple[Weights, ...]
    extra: str
    packages: tuple[str, ...]
    film_size: int | None = None


def _movenet(options: EstimatorOptions) -> MoveNet:
    (path,) = find_weights("movenet", MOVENET, options.folder)
    if options.size is None:
        return MoveNet(path, threads=options.threads)
    return MoveNet(path, size=options.size, threads=options.threads)


def _blazepose(options: EstimatorOptions) -> BlazePose:
    (path,) = find_weights("blazepose", BLAZEPOSE, options.folder)
    return BlazePose(path, _movenet(options), threads=options.threads)


def _rtmo(options: EstimatorOptions) -> RtmlibEstimator:
    return _rtmlib("rtmo", options)


def _rtmpose(options: EstimatorOptions) -> RtmlibEstimator:
    return _rtmlib("rtmpose", options)


def _rtmlib(name: str, options: EstimatorOptions) -> RtmlibEstimator:
    if options.size is not None:
        raise InputError(f"{name} takes no size of its input, got {options.size}: leave it out")
    folder = models_folder() if options.folder is None else options.folder
    return RtmlibEstimator({"rtmo": RTMO, "rtmpose": RTMPOSE}[name], folder, options.threads)


_LICENCE = "Apache-2.0"
_FILM_SIZE = 512
"""Pixels, longer side of MoveNet's input for films. At its own 256, the film in examples/film comes
out with persons who are mixed up; at 512 all are right, for three times the CPU time
(python -m benchmarks.film.level)."""

_RTMLIB = ("rtmlib", "onnxruntime")

ESTIMATORS = {
    "movenet": Estimator(
        _movenet, "coco_17", False, _LICENCE, (MOVENET,), "movenet", ("onnxruntime",), _FILM_SIZE
    ),
    "blazepose": Estimator(
        _blazepose,
        "blazepose_33",
        True,
        _LICENCE,
        (MOVENET, BLAZEPOSE),
        "blazepose",
        ("onnxruntime", "ai_edge_litert"),
        _FILM_SIZE,
    ),
    "rtmo": Estimator(_rtmo, "coco_17", False, _LICENCE, (), "rtmlib", _RTMLIB),
    "rtmpose": Estimator(_rtmpose, "coco_17", False, _LICENCE, (), "rtmlib", _RTMLIB),
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
    for package in estimator.packages:
        require_package(package, estimator.extra)
    return estimator.load(EstimatorOptions(size, threads, folder))
