"""Stamps against the times at which a recorder received the images.

A recorder has one clock for all cameras. Networks delay messages, some by a lot and none by less
than the quickest: the least delay in a second changes where the clock of a camera is set, and where
images are lost and numbered as if they were not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.model.lifted import LiftedCamera
from stcalib_ros.core.model.rejection import Remark, RemarkCode
from stcalib_ros.core.validation.block_contrast import largest_contrast
from stcalib_ros.core.validation.thresholds import (
    DELAY_STDDEV_S,
    MIN_CHANGE_SIGNIFICANCE,
    MIN_DELAY_CHANGE_S,
    MIN_STEADINESS_WINDOWS,
    SUDDEN_FRACTION,
)

_WINDOW_S, _MAX_WINDOWS = 1.0, 120
"""Seconds, and count. The least delay is taken over so much, as a burst of a network lasts for
less, and over more where there would be more windows: cost grows with the square of them. Chosen.
"""


@dataclass(frozen=True, slots=True)
class StampJump:
    """Stamps of one camera that are off during a part of the recording.

    Attributes
    ----------
    begin_s, end_s : float
        That part, seconds after the first image; of two parts of the recording, the later one.
    size_s : float
        By how much.
    sudden : bool
        From one moment to the next. Otherwise messages may also have been delayed more and more, as
        those of a pose estimator that is too slow are.
    """

    begin_s: float
    end_s: float
    size_s: float
    sudden: bool


def stamp_jumps(cameras: Sequence[LiftedCamera]) -> dict[int, StampJump]:
    """Return the cameras whose stamps change against the times of receipt, by position.

    None where half of the cameras do: the clock of the recorder was set.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
    """
    found = {c: jump for c, one in enumerate(cameras) if (jump := _jump(one)) is not None}
    return {} if len(found) > 1 and len(found) >= len(cameras) / 2 else found


def receipt_remarks(cameras: Sequence[LiftedCamera]) -> tuple[Remark, ...]:
    """Return remarks on cameras whose stamps jump against the times of receipt.

    Parameters
    ----------
    cameras : sequence of LiftedCamera
        Those of a calibration that can be used.
    """
    return tuple(
        Remark(
            RemarkCode.STAMPS_JUMP,
            (cameras[c].name,),
            {"begin_s": jump.begin_s, "end_s": jump.end_s, "jump_ms": 1e3 * jump.size_s},
        )
        for c, jump in stamp_jumps(cameras).items()
        if jump.sudden
    )


def _jump(camera: LiftedCamera) -> StampJump | None:
    """The largest change of the least delay; None if it is small or may be chance."""
    if camera.received is None or len(camera.received) != len(camera.stamps):
        return None
    since = camera.stamps - camera.stamps[0]
    known = np.isfinite(camera.received)
    window_s = max(_WINDOW_S, float(since[-1]) / _MAX_WINDOWS)
    windows, number = np.unique((since[known] / window_s).astype(np.int64), return_inverse=True)
    if len(windows) < MIN_STEADINESS_WINDOWS:
        return None
    least = np.full(len(windows), np.inf)
    np.minimum.at(least, number, (camera.received - camera.stamps)[known])
    information = np.full((len(windows), 1, 1), DELAY_STDDEV_S**-2)
    found = largest_contrast(
        windows.astype(np.float64), least[:, None], information, least_inflation=1.0
    )
    if found.significance < MIN_CHANGE_SIGNIFICANCE or found.size < MIN_DELAY_CHANGE_S:
        return None
    begin, end = found.begin, found.end
    if begin == 0:
        begin, end = end, len(windows)
    # The window before the last one of the other part is wholly before the jump.
    across = abs(float(least[min(begin + 1, end - 1)] - least[max(begin - 2, 0)]))
    return StampJump(
        float(windows[begin]) * window_s,
        float(windows[end - 1] + 1) * window_s,
        found.size,
        across > SUDDEN_FRACTION * found.size,
    )
