"""Left and right of one person, where an estimator exchanges them now and then.

Two explanations are followed: sides are as found, or exchanged. The more probable one holds, by the
motion of the joints and by how often exchanges begin and end (a hidden Markov model of two states;
A. J. Viterbi, "Error bounds for convolutional codes", 1967). The longer an exchange seems to last,
the less it is believed: estimators are mostly right, and somebody may have turned round unseen.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.model.arrays import Float64Array, IntArray
from stcalib_ros.core.model.keypoint_layouts import DETAILS, Layout
from stcalib_ros.core.model.skeleton import mirrored_joints
from stcalib_ros.estimation.limits import (
    BODY_BEGINS_PER_S,
    BODY_ENDS_PER_S,
    EXPECTATION_NOISE,
    INDEPENDENT_JOINTS,
    LEAST_PROBABILITY,
    LIMB_BEGINS_PER_S,
    LIMB_ENDS_PER_S,
    MAX_MISFIT,
    MIN_SIDED_JOINTS,
    SWING_ACCELERATION,
)

_ARM = ("elbow", "wrist", "hand", "pinky", "index", "thumb", "middle", "forefinger", "ring")
_LEG = ("knee", "ankle", "heel", "toe", "foot")


@dataclass(frozen=True, slots=True, eq=False)
class SidedPart:
    """Joints of a layout that change places together.

    Attributes
    ----------
    order : (J,) ndarray of int
        Joint whose place each joint takes where the part is exchanged.
    compared : (n,) ndarray of int
        Joints by which an exchange is seen.
    begins_per_s, ends_per_s : float
        How often an exchange begins, and one that there is ends, 1/s.
    """

    order: IntArray
    compared: IntArray
    begins_per_s: float
    ends_per_s: float


def sided_parts(layout: Layout) -> tuple[SidedPart, ...]:
    """Return the whole body, the arms and the legs of a layout.

    Examples
    --------
    >>> from stcalib_ros.core.model.keypoint_layouts import LAYOUTS
    >>> [len(part.compared) for part in sided_parts(LAYOUTS["coco_17"])]
    [16, 4, 4]
    """
    mirrored = mirrored_joints(layout)
    compared = _compared(layout, mirrored)
    body = SidedPart(mirrored, compared, BODY_BEGINS_PER_S, BODY_ENDS_PER_S)
    return (body, *(_limbs(layout, body.order, words) for words in (_ARM, _LEG)))


def _limbs(layout: Layout, mirrored: IntArray, words: tuple[str, ...]) -> SidedPart:
    of_limb = np.array([any(w in n for w in words) for n in layout.joint_names], dtype=bool)
    order = np.where(of_limb, mirrored, np.arange(layout.n_joints))
    return SidedPart(order, _compared(layout, order), LIMB_BEGINS_PER_S, LIMB_ENDS_PER_S)


def _compared(layout: Layout, order: IntArray) -> IntArray:
    detail = np.array([name in DETAILS for name in layout.joint_names], dtype=bool)
    return np.flatnonzero((order != np.arange(layout.n_joints)) & ~detail)


def new_sides(parts: tuple[SidedPart, ...]) -> Sides:
    """Return the sides of somebody who is seen for the first time: they are taken to be right."""
    return Sides(parts, [-math.log(part.begins_per_s / part.ends_per_s) for part in parts])


@dataclass(slots=True, eq=False)
class Sides:
    """Which parts of one person are exchanged in what the estimator finds, image after image.

    Attributes
    ----------
    parts : tuple of SidedPart
    surplus : list of float
        Negative log likelihood of each part being exchanged, less that of its being right.
    """

    parts: tuple[SidedPart, ...]
    surplus: list[float]

    def follow(
        self, found: Float64Array, expected: Float64Array, size: float, gap_s: float
    ) -> tuple[IntArray, IntArray]:
        """Take the next image, and return what to reorder.

        Parameters
        ----------
        found : (J, 2) ndarray
            Keypoints as found, px; NaN where not.
        expected : (J, 2) ndarray
            Where they are expected by the images before, px; NaN where not known.
        size : float
            Size of the person, px.
        gap_s : float
            Time since the image before, seconds.

        Returns
        -------
        order : (J,) ndarray of int
            Index into what was found, of every joint.
        past : (J,) ndarray of int
            The same for what was returned before, by what is known now.
        """
        order, past = np.arange(len(found)), np.arange(len(found))
        for k, part in enumerate(self.parts):
            exchanged, revised = self._take(k, found[order], expected[past], size, gap_s)
            order = order[part.order] if exchanged else order
            past = past[part.order] if revised else past
        return order, past

    def _take(
        self, k: int, found: Float64Array, expected: Float64Array, size: float, gap_s: float
    ) -> tuple[bool, bool]:
        """Return whether a part is exchanged now, and whether the opposite was assumed before."""
        part, before = self.parts[k], self.surplus[k]
        was = before < 0
        plain, swapped = (
            _misfit(part, pose, expected, size, gap_s) for pose in (found, found[part.order])
        )
        same, other = (swapped, plain) if was else (plain, swapped)
        begins = other + _surprise(part.begins_per_s * gap_s)
        ends = before + other + _surprise(part.ends_per_s * gap_s)
        lasts = before + same + part.ends_per_s * gap_s
        after = self.surplus[k] = min(lasts, begins) - min(same, ends)
        is_now = after < 0
        was_then = lasts < begins if is_now else ends < same
        return is_now, was_then != was


def _misfit(
    part: SidedPart, found: Float64Array, expected: Float64Array, size: float, gap_s: float
) -> float:
    """Negative log likelihood of the joints of a part, up to a constant."""
    away = np.linalg.norm(found[part.compared] - expected[part.compared], axis=-1) / size
    known = away[np.isfinite(away)]
    if len(known) < MIN_SIDED_JOINTS:
        return 0.0
    sigma = EXPECTATION_NOISE + 0.5 * SWING_ACCELERATION * gap_s**2
    misfits = np.minimum(0.5 * (known / sigma) ** 2, MAX_MISFIT)
    return INDEPENDENT_JOINTS * float(misfits.mean())


def _surprise(probability: float) -> float:
    """Negative logarithm of a probability, which is at most one half."""
    return -math.log(min(max(probability, LEAST_PROBABILITY), 0.5))
