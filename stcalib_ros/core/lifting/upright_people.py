"""Focal length of one camera by the people who stand and walk upright before it."""

from __future__ import annotations

from dataclasses import dataclass

from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.skeleton import Skeleton


@dataclass(frozen=True, slots=True)
class FocalPrior:
    """What upright people say about the focal length of a camera.

    Attributes
    ----------
    log_ratio : float
        Logarithm of the focal length over that of `LiftedCamera.intrinsics`.
    stddev : float
        Its standard deviation.
    """

    log_ratio: float
    stddev: float


def focal_length_prior(camera: LiftedCamera, skeleton: Skeleton) -> FocalPrior | None:
    """Return the focal length by upright people; None where they do not determine it.

    Parameters
    ----------
    camera : LiftedCamera
    skeleton : Skeleton
    """
    del camera, skeleton
    return None
