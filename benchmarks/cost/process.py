"""Memory and CPU time of a process and of those that it started, from ``/proc``."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

_TICK_S = 1.0 / os.sysconf("SC_CLK_TCK")
_MB = 1024.0
"""Kilobytes of ``/proc`` in the unit of memory, MiB."""


@dataclass(frozen=True, slots=True)
class Usage:
    """Memory and CPU time of a process.

    Attributes
    ----------
    own_mb, own_peak_mb : float
        Resident memory of the process itself, now and at most.
    all_mb : float
        Resident memory of it and its descendants; shared pages count once for each.
    cpu_s : float
        CPU time of all of them since the start.
    """

    own_mb: float
    own_peak_mb: float
    all_mb: float
    cpu_s: float


def usage(pid: int) -> Usage:
    """Return the memory and CPU time of a running process."""
    own = _memory_mb(pid, "VmRSS")
    others = list(_descendants(pid))
    return Usage(
        own_mb=own,
        own_peak_mb=_memory_mb(pid, "VmHWM"),
        all_mb=own + sum(_memory_mb(p, "VmRSS") for p in others),
        cpu_s=sum(_cpu_s(p) for p in (pid, *others)),
    )


def _memory_mb(pid: int, key: str) -> float:
    """Return a field of ``status`` in MiB; 0 for a process that has ended meanwhile."""
    try:
        status = Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return 0.0
    lines = [line for line in status.splitlines() if line.startswith(f"{key}:")]
    return int(lines[0].split()[1]) / _MB if lines else 0.0


def _fields(pid: int) -> list[str]:
    """Return the fields of ``stat`` after the name of the command; the first is the state."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return []


def _cpu_s(pid: int) -> float:
    """Return user and system time, s, including that of children that have ended."""
    fields = _fields(pid)
    return sum(int(f) for f in fields[11:15]) * _TICK_S


def _descendants(pid: int) -> Iterator[int]:
    parents = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit() and (fields := _fields(int(entry.name))):
            parents.setdefault(int(fields[1]), []).append(int(entry.name))
    waiting = list(parents.get(pid, ()))
    while waiting:
        child = waiting.pop()
        yield child
        waiting += parents.get(child, ())
