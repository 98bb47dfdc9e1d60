"""Intrinsics as OpenCV writes them down."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from stcalib_ros.core.model.camera_info import coefficient_counts
from stcalib_ros.core.model.recording import Intrinsics, LensModel
from stcalib_ros.io.limits import PLUMB_BOB_COEFFICIENTS


def opencv_intrinsics(image_size: Sequence[int], K: ArrayLike, dist: ArrayLike) -> Intrinsics:
    """Return intrinsics from OpenCV's matrix and coefficients.

    Parameters
    ----------
    image_size : (int, int)
        Width and height, px.
    K : (3, 3) array_like
        Pinhole matrix, px.
    dist : (N,) array_like
        Distortion coefficients: up to five are those of plumb_bob, more of the rational model.
        Those that are missing are 0.
    """
    width, height = (int(n) for n in image_size)
    D = np.asarray(dist, dtype=np.float64).ravel()
    is_plumb_bob = D.size <= PLUMB_BOB_COEFFICIENTS
    model = LensModel.PLUMB_BOB if is_plumb_bob else LensModel.RATIONAL_POLYNOMIAL
    whole = next((n for n in sorted(coefficient_counts(model)) if n >= D.size), D.size)
    D = np.pad(D, (0, whole - D.size))
    return Intrinsics(width, height, model, np.asarray(K, dtype=np.float64), D)


def fisheye_intrinsics(image_size: Sequence[int], K: ArrayLike, dist: ArrayLike) -> Intrinsics:
    """Return intrinsics from matrix and coefficients of OpenCV's fisheye model.

    Parameters
    ----------
    image_size : (int, int)
        Width and height, px.
    K : (3, 3) array_like
        Pinhole matrix, px.
    dist : (N,) array_like
        Distortion coefficients; zeros beyond the fourth are left out, and those that are missing
        are 0.
    """
    width, height = (int(n) for n in image_size)
    n = max(coefficient_counts(LensModel.EQUIDISTANT))
    D = np.trim_zeros(np.asarray(dist, dtype=np.float64).ravel(), "b")
    D = np.pad(D, (0, max(n - D.size, 0)))
    return Intrinsics(width, height, LensModel.EQUIDISTANT, np.asarray(K, dtype=np.float64), D)
