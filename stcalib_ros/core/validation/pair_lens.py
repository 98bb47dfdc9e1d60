"""Whether two cameras have the lenses that their CameraInfo describes: by people's limbs.

Two cameras alone find poses that make up for a wrong lens, but then people who walk change their
size. Tried are images of other sizes, of either camera or of both: with the right one limbs keep
their lengths.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.bundle.levenberg_marquardt import adjust
from stcalib_ros.core.bundle.limits import TOLERANCE
from stcalib_ros.core.bundle.motion_filter import depth_variance_ratio
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.recording import Intrinsics
from stcalib_ros.core.model.rejection import Rejection, RejectionReason
from stcalib_ros.core.model.skeleton import Skeleton
from stcalib_ros.core.validation.cross_view import usual_distances
from stcalib_ros.core.validation.limb_lengths import limb_variations
from stcalib_ros.core.validation.thresholds import DEFAULT

_PAIR = 2
"""Count of cameras that cannot be compared with people whom two others see. By definition."""
_SCALES = (0.33, 0.5, 0.67, 0.75, 0.87, 1.15, 1.33, 1.75)
"""Sizes of images that are tried, over those given. Chosen: usual ones, up to those that
registration survives; the nearest one takes away most of what a size in between does."""
_MAX_DEPTH_RATIO = 100.0
"""Ratio of variances along and across the rays. With more, the lengths of limbs are those of noise
in depth. Derived: cameras that see people from eleven degrees apart; 830 of two that stand 30 cm
apart, 3.5 m from people."""
_MIN_WALKED = 0.05
"""Ratio, see `_walked`. Who stays at one place does not change their size, whatever the lens.
Derived: 20 cm at 4 m; people who walk about have 0.2."""
_MAX_POINTS = 6000
"""Joints, count. Of more a regular part is adjusted. Cost alone."""
_STEPS = 12
"""Steps of each adjustment at most. Numerical: usually six."""
_MIN_VARIATION = 0.018
"""Ratio of lengths, RMS. With limbs that vary less nothing is tried. Measured: 0.000 on half of the
good simulated pairs, 0.02 to 0.09 with keypoint bias and on real ones; 0.022 to 0.12 where one or
both images are of another size, or a focal length is 20 % off."""
_MAX_LEFT, _MAX_LEFT_IF_REFUSED = 0.76, 0.6
"""Ratios of variations. Another size has to leave less of the variation; the second where outliers
or limbs speak against the pair anyway, as they do for other reasons. Measured: 0.00 to 0.73 of
images of 1/2, 2/3, 3/4 and of focal lengths that are 20 % off; of right lenses 0.92 and more on 21
good pairs whose limbs vary and 0.79 on one of five seconds, 0.64 and more on real pairs that are
refused."""


class _Trial(NamedTuple):
    """Images of some cameras (positions) of another size, and the variation of limbs with it."""

    cameras: tuple[int, ...]
    scale: float
    variation: float


def pair_lens_faults(
    cameras: Sequence[LiftedCamera], skeleton: Skeleton, last: Iteration
) -> tuple[Rejection | None, ...]:
    """Return which of two cameras have images of another size; None of others, and of more cameras.

    Nothing is said where a lens is estimated: it is the one that lets limbs keep their lengths.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
        All cameras.
    skeleton : Skeleton
    last : Iteration
    """
    C = len(last.rig.cameras)
    is_estimated = last.state.lenses is not None
    if is_estimated or depth_variance_ratio(last.observations, last.state) > _MAX_DEPTH_RATIO:
        return (None,) * C
    if _walked(last) < _MIN_WALKED:
        return (None,) * C
    lenses = [lens for c in last.rig.cameras if (lens := cameras[c].intrinsics) is not None]
    nothing = (None,) * C
    if not C == len(lenses) == _PAIR:
        return nothing
    part = _part(last)
    given = _variation(skeleton, part)
    if not given > _MIN_VARIATION:
        return nothing
    best = min(_trials(skeleton, part, lenses), key=lambda trial: trial.variation)
    most = _MAX_LEFT_IF_REFUSED if _is_refused(last, given) else _MAX_LEFT
    if not best.variation < most * given:
        return nothing
    return tuple(
        _rejection(best.scale, lens, given) if c in best.cameras else None
        for c, lens in enumerate(lenses)
    )


def _walked(last: Iteration) -> float:
    """Return how far a person gets about, over the usual distance from the cameras; median."""
    seen = last.state.triangulated()
    total = np.where(seen[..., None], last.state.X, 0.0).sum(1)
    known = seen.any(1)
    place = total[known] / seen.sum(1)[known, None]
    person = last.observations.person[known]
    spread = [np.ptp(place[person == one], axis=0) for one in np.unique(person)]
    reach = float(np.nanmean(usual_distances(last)))
    return float(np.median(np.linalg.norm(spread, axis=-1))) / reach if spread else 0.0


def _is_refused(last: Iteration, variation: float) -> bool:
    """Whether limbs or outliers are enough to refuse the pair."""
    observed = last.observations.observed.sum((0, 2))
    fraction = last.state.inlier.sum((0, 2)) / np.maximum(observed, 1)
    few = float(fraction.min()) < DEFAULT.min_inlier_fraction
    return few or variation >= DEFAULT.max_limb_variation


def _part(last: Iteration) -> Iteration:
    """Return a round with a part of its images."""
    n, J = last.observations.observed.shape[0::2]
    rows = np.arange(0, n, max(1, n * J // _MAX_POINTS))
    return replace(last, observations=last.observations.only(rows), state=last.state.only(rows))


def _trials(skeleton: Skeleton, part: Iteration, lenses: Sequence[Intrinsics]) -> Iterator[_Trial]:
    for cameras in ((0,), (1,), (0, 1)):
        for scale in _SCALES:
            varied = _resized(part, cameras, scale, lenses)
            yield _Trial(cameras, scale, _variation(skeleton, varied))


def _resized(
    part: Iteration, cameras: Sequence[int], scale: float, lenses: Sequence[Intrinsics]
) -> Iteration:
    """Return a round adjusted as if the images of some cameras had another size."""
    obs = part.observations
    x, focal = obs.x.copy(), obs.focal.copy()
    for c in cameras:
        f, middle = np.diag(lenses[c].K)[:2], lenses[c].K[:2, 2] + 0.5
        x[:, c] = (x[:, c] + (1.0 - scale) * middle / f) / scale
        focal[:, c] *= scale
    changed = replace(obs, x=x, focal=focal)
    state = adjust(changed, part.state, iterations=_STEPS, tolerance=TOLERANCE)
    return part.with_state(changed, state)


def _variation(skeleton: Skeleton, one: Iteration) -> float:
    """Variation of limbs; infinite where it is not known."""
    varied: Float64Array = limb_variations(skeleton, one)
    return float(np.nanmax(varied)) if np.isfinite(varied).any() else np.inf


def _rejection(scale: float, lens: Intrinsics, given: float) -> Rejection:
    size = {"width": scale * lens.width, "height": scale * lens.height}
    values = {"scale_x": scale, "scale_y": scale, "corner_x": 0.0, "corner_y": 0.0}
    return Rejection(RejectionReason.IMAGE_RESIZED, (), given, _MIN_VARIATION, values=size | values)
