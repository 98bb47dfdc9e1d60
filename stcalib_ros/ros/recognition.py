"""Which keypoints of an image are those of which person in 3D; knows no ROS."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from stcalib_ros.core.geometry.lens import project
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.calibration import CameraCalibration
from stcalib_ros.core.model.keypoint_layouts import Layout
from stcalib_ros.io.message_types import NO_TRACK
from stcalib_ros.io.messages import PoseImage
from stcalib_ros.ros.limits import MAX_MISSED_WIDTH


@dataclass(frozen=True, slots=True, eq=False)
class SeenImage:
    """The keypoints of people who were recognised in one image of one camera.

    Attributes
    ----------
    time_s : float
        Seconds since the Unix epoch, reference clock.
    pixels : (M, 2) ndarray
        Keypoints.
    errors_px : (M,) ndarray
        Their distances from where the people in 3D project to.
    tracks : tuple of (int, int)
        Ids of the camera's own tracker, each with the person's place in the sequence of people.
    """

    time_s: float
    pixels: Float64Array
    errors_px: Float64Array
    tracks: tuple[tuple[int, int], ...]


def recognise(
    image: PoseImage,
    time_s: float,
    camera: CameraCalibration,
    people: Sequence[Float64Array],
    layout: Layout,
    *,
    min_score: float,
) -> SeenImage:
    """Match the persons of an image with people in 3D, by where these project to.

    Parameters
    ----------
    image : PoseImage
    time_s : float
        Of the image, seconds since the Unix epoch, reference clock.
    camera : CameraCalibration
    people : sequence of (J, 3) ndarray
        Joints at that time, reference frame; NaN where unknown.
    layout : Layout
        Of the people.
    min_score : float
        Joints with a lower score are not used.
    """
    names = [n for n in layout.joint_names if n in image.layout.joint_names]
    observed = np.where(image.joint_scores[..., None] >= min_score, image.keypoints, np.nan)
    observed = observed[:, [image.layout.index(n) for n in names]].astype(float)
    joints = np.stack(people)[:, [layout.index(n) for n in names]] if people else np.zeros(0)
    if not people or not len(observed) or not names:
        return SeenImage(time_s, np.zeros((0, 2)), np.zeros(0), ())
    expected = project((joints - camera.t_ref_cam) @ camera.R_ref_cam, camera.intrinsics)
    errors = np.linalg.norm(observed[None] - expected[:, None], axis=-1)
    whose, which = _matched(errors, MAX_MISSED_WIDTH * camera.intrinsics.width)
    pixels, missed = observed[which].reshape(-1, 2), errors[whose, which].ravel()
    known = np.isfinite(missed)
    tracks = [
        (int(image.track_ids[p]), int(person))
        for person, p in zip(whose, which, strict=True)
        if image.track_ids[p] != NO_TRACK
    ]
    return SeenImage(time_s, pixels[known], missed[known], tuple(tracks))


def _matched(errors: Float64Array, most: float) -> tuple[list[int], list[int]]:
    """Return rows and columns of the best assignment by the medians of errors (N, P, J)."""
    known = np.isfinite(errors)
    filled = np.where(known, errors, np.inf)
    cost = np.sort(filled, axis=-1)
    middle = np.maximum(known.sum(-1) - 1, 0) // 2
    median = np.take_along_axis(cost, middle[..., None], axis=-1)[..., 0]
    rows, columns = linear_sum_assignment(np.minimum(median, most))
    near = median[rows, columns] < most
    return list(rows[near]), list(columns[near])
