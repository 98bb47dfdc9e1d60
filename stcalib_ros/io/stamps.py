"""Stamps of serialised messages, and their correction to the reference clock; knows no ROS."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.core.model.clocks import clock_correction
from stcalib_ros.io.messages import NS

_STAMP_AT = 4
_STAMP_END = 12
_FORMS = {0: ">iI", 1: "<iI", 6: ">iI", 7: "<iI"}
"""By the encapsulation: plain CDR and plain CDR 2, big and little endian."""

_MAX_NS = 2**31 * NS
_MAX_OFFSET_S = 2.0**31
"""Seconds. No two times that stamps can hold are further apart, so that no clock is; beyond, a
corrected time has no number either."""


@dataclass(frozen=True, slots=True)
class ClockCorrection:
    """What to add to the stamps of one camera: t_ref = t_cam + offset + skew (t_cam - epoch).

    Attributes
    ----------
    offset_s : float
    skew : float
    epoch_ns : int
        By the camera's clock, nanoseconds.

    Raises
    ------
    InputError
        The offset or the skew is not finite, or more than any two stamps can differ by, or the
        clock would stand still or run backwards.

    Examples
    --------
    >>> ClockCorrection(-0.25).apply(1_760_000_000_000_000_001)
    1759999999750000001
    """

    offset_s: float
    skew: float = 0.0
    epoch_ns: int = 0

    def __post_init__(self) -> None:
        if not abs(self.offset_s) < _MAX_OFFSET_S or not abs(self.skew) < 1.0:
            raise InputError(f"no clock: offset {self.offset_s} s, skew {self.skew}")

    def apply(self, stamp_ns: int) -> int:
        """Stamp by the reference clock, nanoseconds; integers, so that nothing is rounded away."""
        since_epoch_ns = float(stamp_ns - self.epoch_ns)
        return stamp_ns + round(clock_correction(self.offset_s * NS, self.skew, since_epoch_ns))

    def camera_time(self, reference_s: float) -> float:
        """Return the camera's stamp, seconds, of a time by the reference clock.

        Examples
        --------
        >>> ClockCorrection(1.0, skew=0.5).camera_time(4.0)
        2.0
        """
        epoch_s = self.epoch_ns / NS
        return epoch_s + (reference_s - epoch_s - self.offset_s) / (1.0 + self.skew)


SAME_CLOCK = ClockCorrection(0.0)
"""Of a camera whose clock is the reference, or whose offset is not known."""


def corrections_of(calibration: Calibration) -> dict[str, ClockCorrection]:
    """Corrections by camera name."""
    epoch_ns = round(calibration.epoch_s * NS) if math.isfinite(calibration.epoch_s) else 0
    return {
        camera.name: ClockCorrection(camera.time_offset_s, camera.clock_skew, epoch_ns)
        for camera in calibration.cameras
    }


def stamp_of(data: bytes) -> int:
    """Stamp of a serialised message that begins with a ``std_msgs/Header``, nanoseconds.

    Raises
    ------
    InputError
        The message is too short or serialised in another way.
    """
    sec, nanosec = struct.unpack_from(_form(data), data, _STAMP_AT)
    return int(sec) * NS + int(nanosec)


def with_stamp(data: bytes, stamp_ns: int) -> bytes:
    """The same message with another stamp; all other bytes stay. Copies once.

    Raises
    ------
    InputError
        As of `stamp_of`, or a stamp cannot hold that time.
    """
    if not 0 <= stamp_ns < _MAX_NS:
        raise InputError(f"no stamp can hold {stamp_ns / NS:.3f} s")
    stamp = struct.pack(_form(data), *divmod(stamp_ns, NS))
    return b"".join((data[:_STAMP_AT], stamp, memoryview(data)[_STAMP_END:]))


def _form(data: bytes) -> str:
    form = _FORMS.get(int.from_bytes(data[:2], "big")) if len(data) >= _STAMP_END else None
    if form is None:
        raise InputError(
            f"{len(data)} bytes that begin with {data[:4].hex(' ') or 'nothing'} are not a message "
            "in plain CDR with a header"
        )
    return form


class Restamper:
    """Corrects the stamps of one topic; what goes out never goes back unless what comes in does.

    Attributes
    ----------
    correction : ClockCorrection or None
        None: not known. May be replaced at any time.
    relayed, dropped : int
        Messages since the start.
    problem : str
        Why the last message was dropped.
    """

    def __init__(self) -> None:
        self.correction: ClockCorrection | None = None
        self.relayed = self.dropped = 0
        self.problem = ""
        self._last_in_ns = self._last_out_ns = 0

    def __call__(self, data: bytes) -> bytes | None:
        """Message with its corrected stamp; None if it is to be dropped.

        A stamp of zero says that there is none, and stays.
        """
        try:
            out = self._restamped(data)
        except InputError as error:
            self.dropped += 1
            self.problem = str(error)
            return None
        self.relayed += 1
        return out

    def again(self, data: bytes) -> bytes | None:
        """Message that was sent before, by a new correction: its stamp may go back."""
        self._last_in_ns = self._last_out_ns = 0
        return self(data)

    def _restamped(self, data: bytes) -> bytes:
        if self.correction is None:
            raise InputError("the offset of its camera is not known")
        stamp_ns = stamp_of(data)
        if stamp_ns == 0:
            return data
        out_ns = self.correction.apply(stamp_ns)
        out = with_stamp(data, out_ns)
        advance_ns, self._last_in_ns = stamp_ns - self._last_in_ns, stamp_ns
        if advance_ns >= 0 and out_ns < self._last_out_ns + (advance_ns > 0):
            behind_s = (self._last_out_ns - out_ns) / NS
            raise InputError(
                f"since the offset has become smaller, the stamp would go back by {behind_s:.3f} s"
            )
        self._last_out_ns = out_ns
        return out


def describe(correction: ClockCorrection) -> str:
    """Say how a clock is corrected.

    Examples
    --------
    >>> describe(ClockCorrection(0.3, 2e-6))
    '+300.000 ms, +2.00 ppm'
    """
    skew = f", {correction.skew * 1e6:+.2f} ppm" if correction.skew else ""
    return f"{correction.offset_s * 1e3:+.3f} ms{skew}"


def changes(
    before: Mapping[str, ClockCorrection], after: Mapping[str, ClockCorrection]
) -> dict[str, str]:
    """What is new, in words, by camera name; cameras that stay as they are are left out."""
    out = {}
    for name in (*after, *(n for n in before if n not in after)):
        if before.get(name) != after.get(name):
            out[name] = describe(after[name]) if name in after else "no longer known"
    return out
