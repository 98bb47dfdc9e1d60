"""Observations of the live node, and the table made from them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from benchmarks.cost.process import Usage
from benchmarks.live.player import Sent
from benchmarks.table import Row

MINUTE_S = 60.0
"""Seconds over which the node reports its delays."""
MAX_DELAY_MS = 20.0
"""Largest accepted p99 of a delay in the worst minute, ms: within one frame at 30 Hz."""
MAX_MB = 600.0
"""Largest accepted resident memory of node and solver together, MB."""
MAX_RESULT_S = 0.3
"""Largest accepted time from the end of a solve to the arrival of its result, s."""
MAX_STOP_S = 2.0
"""Largest accepted time from SIGINT to the end of the process, s."""
MAX_GROWTH_MB_PER_MIN = 1.0
"""Largest accepted growth of memory between solves, MB/min."""
_MIN_SPAN_S = 120.0
"""Seconds between solves below which growth of memory is not assessed."""


@dataclass(frozen=True, slots=True)
class Sample:
    """State of the node at one time; `load` holds delays over its last minute, milliseconds."""

    at_s: float
    solving: bool
    usage: Usage
    messages: int
    load: dict[str, float]


@dataclass(frozen=True, slots=True)
class Solve:
    """One calibration: how long it took, and how long after that its result arrived."""

    run_id: str
    status: str
    took_s: float
    delay_s: float


@dataclass(frozen=True, slots=True)
class Observed:
    """One run of the benchmark.

    Attributes
    ----------
    sent : dict of str to Sent
        Messages sent, by camera.
    received, dropped, buffered : dict of str to int
        Messages of poses by camera, as the node counts them at the end.
    lost : int
        Messages that never arrived, by gaps in their sequence numbers.
    solves : list of Solve
    samples : list of Sample
        One a second.
    exit_status : int
    stop_s : float
        Seconds from SIGINT to the end of the process.
    """

    sent: dict[str, Sent]
    received: dict[str, int]
    dropped: dict[str, int]
    buffered: dict[str, int]
    lost: int
    solves: list[Solve]
    samples: list[Sample]
    exit_status: int
    stop_s: float


def rows(seen: Observed) -> tuple[Row, ...]:
    """Return the rows of the table."""
    return (*_messages(seen), *_delays(seen.samples), *_solves(seen), *_resources(seen.samples))


def _messages(seen: Observed) -> tuple[Row, ...]:
    sent = sum(s.images for s in seen.sent.values())
    late = sum(s.late for s in seen.sent.values())
    missing = sent - sum(seen.received.values())
    gone = sum(s.in_window - seen.buffered[n] for n, s in seen.sent.items())
    buffered, dropped = sum(seen.buffered.values()), sum(seen.dropped.values())
    return (
        Row("sent", f"{sent} messages of poses, {late} of them late", "", None),
        Row("not received", f"{missing} (the node says {seen.lost})", "0", missing == 0),
        Row("dropped", str(dropped), "0", dropped == 0),
        Row("in the buffers", f"{buffered} images, {gone} too few", "all", gone == 0),
    )


def _delays(samples: Sequence[Sample]) -> tuple[Row, ...]:
    """Delays of the worst minute, or of the last sample if there was no full minute."""
    begin = next((s.at_s for s in samples if s.messages), math.inf)
    whole = [s for s in samples if s.at_s >= begin + MINUTE_S] or list(samples[-1:])
    table = []
    for name in ("delay", "hold"):
        worst = max((s.load[f"{name}_p99_ms"] for s in whole), default=math.nan)
        usual = float(np.median([s.load[f"{name}_p99_ms"] for s in whole])) if whole else math.nan
        longest = max((s.load[f"{name}_max_ms"] for s in whole), default=math.nan)
        text = f"p99 {worst:.2f} in the worst minute, {usual:.2f} usual, max {longest:.0f}"
        table.append(Row(f"{name} ms", text, f"p99 <= {MAX_DELAY_MS:g}", worst <= MAX_DELAY_MS))
    return tuple(table)


def _solves(seen: Observed) -> tuple[Row, ...]:
    took = [s.took_s for s in seen.solves]
    good = [s for s in seen.solves if s.status == "OK"]
    worst = float(np.max([s.delay_s for s in good])) if good else math.nan
    text = f"{len(good)} of {len(took)} OK, {np.median(took) if took else math.nan:.1f} s each"
    stopped = seen.exit_status == 0 and seen.stop_s <= MAX_STOP_S
    return (
        Row("solves", text, "all OK", bool(good) and len(good) == len(took)),
        Row(
            "result s",
            f"{worst:.3f} after the solve, longest",
            f"<= {MAX_RESULT_S:g}",
            worst <= MAX_RESULT_S,
        ),
        Row(
            "stop s",
            f"{seen.stop_s:.2f}, exit status {seen.exit_status}",
            f"<= {MAX_STOP_S:g}, 0",
            stopped,
        ),
    )


def _resources(samples: Sequence[Sample]) -> tuple[Row, ...]:
    peak = max((s.usage.all_mb for s in samples), default=math.nan)
    own = max((s.usage.own_peak_mb for s in samples), default=math.nan)
    growth, spans = _growth(samples)
    idle, busy = (_cpu_share(samples, solving) for solving in (False, True))
    flat = abs(growth) <= MAX_GROWTH_MB_PER_MIN if spans >= _MIN_SPAN_S else None
    return (
        Row(
            "memory MB",
            f"{peak:.0f} with the solver, {own:.0f} without, at most",
            f"<= {MAX_MB:g}",
            peak <= MAX_MB,
        ),
        Row(
            "growth MB/min",
            f"{growth:+.2f} over {spans:.0f} s, between solves",
            f"<= {MAX_GROWTH_MB_PER_MIN:g}",
            flat,
        ),
        Row("CPU", f"{idle:.0%} idle, {busy:.0%} with a solve", "", None),
    )


def _growth(samples: Sequence[Sample]) -> tuple[float, float]:
    """Slope of the memory between solves after the first, MB/min, and its time span, s."""
    first = next((k for k, s in enumerate(samples) if s.solving), len(samples))
    settled = [s for s in samples[first:] if not s.solving]
    if len(settled) < 2:
        return math.nan, 0.0
    at = np.array([s.at_s for s in settled])
    slope = np.polyfit((at - at[0]) / MINUTE_S, [s.usage.all_mb for s in settled], 1)[0]
    return float(slope), float(at[-1] - at[0])


def _cpu_share(samples: Sequence[Sample], solving: bool) -> float:
    """CPU seconds per second while a solve is under way, or while none is."""
    pairs = [
        (b.usage.cpu_s - a.usage.cpu_s, b.at_s - a.at_s)
        for a, b in pairwise(samples)
        if a.solving == b.solving == solving
    ]
    cpu, wall = (sum(column) for column in zip(*pairs, strict=True)) if pairs else (math.nan, 1.0)
    return cpu / wall
