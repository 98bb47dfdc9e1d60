"""Other people's data sets in their official file layouts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stcalib_ros.core.errors import InputError
from stcalib_ros.io.datasets.alphapose import pose_detections
from stcalib_ros.io.datasets.easymocap import read_easymocap
from stcalib_ros.io.datasets.form import Dataset, DatasetOptions, arrays_of, noisy_detections
from stcalib_ros.io.datasets.mmptrack import read_mmptrack
from stcalib_ros.io.datasets.panoptic import read_panoptic
from stcalib_ros.io.json_files import MALFORMED

__all__ = ["DATASETS", "Dataset", "DatasetOptions", "read_dataset"]

DATASETS: Mapping[str, Callable[[Path, DatasetOptions], Dataset]] = {
    "panoptic": read_panoptic,
    "easymocap": read_easymocap,
    "mmptrack": read_mmptrack,
}
"""Readers by the name of the layout."""


def read_dataset(name: str, path: Path, options: DatasetOptions) -> dict[str, NDArray[Any]]:
    """Arrays of a multi-view file (see `stcalib_ros.io.convert.convert_npz`) of a data set.

    The poses are those of a detector, and of a lifter if there is one, where `options.poses` names
    them; else the true 3D joints of the data set with Gaussian noise, as in the paper's own
    experiments.

    Raises
    ------
    InputError
        A file is missing or has another form, or the data set has no poses and none are given.
    """
    try:
        return _arrays(DATASETS[name](path, options), options)
    except MALFORMED as error:
        raise InputError(
            f"{path} is not a scene of {name} ({type(error).__name__}: {error})"
        ) from error


def _arrays(dataset: Dataset, options: DatasetOptions) -> dict[str, NDArray[Any]]:
    dataset.require_cameras()
    if options.poses is not None:
        return arrays_of(dataset, pose_detections(dataset, options.poses))
    if not dataset.joint_names:
        raise InputError(
            f"{dataset.path} has no poses: give those of a detector, and of a lifter if there is "
            "one, with --poses"
        )
    rng = np.random.default_rng(options.seed)
    return arrays_of(dataset, noisy_detections(dataset, options.sigma_px, rng))
