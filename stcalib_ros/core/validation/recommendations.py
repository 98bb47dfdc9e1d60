"""Which camera of a calibration is known least, and what would make it known better."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stcalib_ros.core.bundle.iteration import Iteration
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.refinement.limits import MAX_SKEW_STDDEV
from stcalib_ros.core.validation.camera_checks import (
    MAX_CENTRE_STDDEV,
    MAX_OFFSET_STDDEV_FRAMES,
    MAX_ROTATION_STDDEV,
    CameraChecks,
)
from stcalib_ros.core.validation.motion_ambiguity import on_a_line

_LITTLE_SHARED = 0.6


def least_constrained_camera(
    names: Sequence[str], found: Sequence[CameraChecks], last: Iteration
) -> str:
    """Name the camera that is known least, with its deviations and what would help.

    Parameters
    ----------
    names : sequence of str
        Of the cameras of the rig, the reference first.
    found : sequence of CameraChecks
    last : Iteration
    """
    weak = max(range(1, len(found)), key=lambda i: max(_levels(found[i])))
    one = found[weak]
    parts = [
        f"rotation to {np.degrees(one.rotation_stddev):.2g} degrees",
        f"position to {100 * one.centre_stddev:.2g} % of its distance from the people",
    ]
    if not last.rig.synchronised:
        stddev_ms = 1e3 * one.offset_stddev_frames * last.observations.step_s
        parts.append(f"clock to {stddev_ms:.2g} ms")
    known = f"least is known of {names[weak]} ({', '.join(parts)})"
    return f"{known}: {_help(names, found, last, weak)}"


def _levels(one: CameraChecks) -> tuple[float, float, float]:
    """Deviations of rotation, position and clock as shares of what is bearable."""
    return (
        one.rotation_stddev / MAX_ROTATION_STDDEV,
        one.centre_stddev / MAX_CENTRE_STDDEV,
        one.offset_stddev_frames / MAX_OFFSET_STDDEV_FRAMES,
    )


def _help(names: Sequence[str], found: Sequence[CameraChecks], last: Iteration, weak: int) -> str:
    """What would help a camera most."""
    own = found[weak].shared_s
    usual = float(np.median([one.shared_s for i, one in enumerate(found) if i != weak]))
    if own < _LITTLE_SHARED * usual:
        common = shared_s(last)[weak]
        seen = [i for i in range(len(names)) if i != weak and common[i] > 0]
        partner = min(seen, key=lambda i: common[i])
        return (
            f"it shares {own:.1f} s of people's motion with the others, who share {usual:.1f} s; "
            f"let people walk where it and {names[partner]} see them ({common[partner]:.1f} s)"
        )
    *place, clock = _levels(found[weak])
    if clock > max(place):
        return "people who move faster in its view would tell its clock better"
    if on_a_line(last):
        return "everybody stays on one line; people who walk across it would tell more"
    return "a clip twice as long would make that about 30 % less"


def shared_s(last: Iteration) -> Float64Array:
    """Time (C, C) for which two cameras see somebody together, summed over persons, seconds."""
    seen = last.state.used.any(2).astype(float)
    return np.asarray(seen.T @ seen * last.observations.step_s)


def unobservable_clock_skews(last: Iteration) -> str:
    """Why clock rates are not estimated; empty where they are, or clocks are known.

    The deviation of a slope falls with the length to the power of one and a half.
    """
    if last.clock_skews is None:
        return ""
    untold = last.clock_skews.stddev[1:][last.clock_skews.skew[1:] == 0.0]
    o = last.observations
    length_s = float(np.ptp(o.knot)) * o.step_s
    if not len(untold) or not np.isfinite(untold).all():
        return "" if not len(untold) else f"clock rates cannot be told from {length_s:.0f} s"
    ppm, needed = 1e6 * float(untold.max()), 1e6 * MAX_SKEW_STDDEV
    enough_s = length_s * (ppm / needed) ** (2.0 / 3.0)
    return (
        f"clock rates are left out: {length_s:.0f} s tell them to {ppm:.0f} ppm, {needed:.0f} are "
        f"needed, for which about {enough_s:.0f} s would do"
    )
