"""What people in the field record, and what a calibration says of it.

    python -m benchmarks.field                       all members, three seeds each
    python -m benchmarks.field --kind B --seeds 1    one kind
    python -m benchmarks.field --only "frozen stream"

Every recording goes through a bag, as a user has it. Answers: "good" (all cameras, and right), "one
side" (right for a side of a change that is named), "left out" (right without the camera that is
named), "refused" (what is wrong is named), "unnamed" (refused, or a camera left out, for another
reason) and "WRONG" (called good, and not). Exit status 1 if any answer is not right.
"""

from __future__ import annotations

import argparse
import math
import resource
import signal
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NoReturn

from benchmarks.field.bags import BAGS
from benchmarks.field.case import CODES, Answer, Member
from benchmarks.field.clocks import CLOCKS
from benchmarks.field.inputs import INPUTS
from benchmarks.field.judge import INPUT_ERROR, Finding, judge
from benchmarks.field.views import VIEWS
from stcalib_ros.core.errors import CalibrationError, InputError
from stcalib_ros.core.model.recording import Recording
from stcalib_ros.core.pipeline import calibrate
from stcalib_ros.io.bag import read_bag
from stcalib_ros.io.bag_writer import write_bag
from stcalib_ros.threads import use_one_thread

MEMBERS = tuple(sorted((*CLOCKS, *VIEWS, *INPUTS, *BAGS), key=lambda member: member.kind))
"""All members, by kind."""

_MEMORY = 3 * 2**30
"""Bytes of address space of a calibration; several times what the longest clip takes."""
_TIME_S = 300
"""Seconds after which a calibration is given up; thirty times the usual."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark and print the table.

    Returns
    -------
    int
        0 if all answers are right, else 1.
    """
    args = _arguments(argv)
    chosen = [
        member
        for member in MEMBERS
        if args.kind in (None, member.kind) and args.only in (None, member.name)
    ]
    total: Counter[str] = Counter()
    print(_HEADING)
    with ProcessPoolExecutor(args.jobs, initializer=_limit) as pool:
        numbers = [MEMBERS.index(member) for member in chosen for _ in range(args.seeds)]
        seeds = [seed for _ in chosen for seed in range(args.seeds)]
        found = pool.map(run, numbers, seeds)
        for member in chosen:
            findings = [next(found) for _ in range(args.seeds)]
            total.update("right" if f.answer in member.right else f.answer.value for f in findings)
            print(_line(member, findings), flush=True)
    counts = ", ".join(f"{n} {answer}" for answer, n in total.most_common())
    print(f"\n{sum(total.values())} recordings of {len(chosen)} members: {counts}")
    return 0 if set(total) == {"right"} else 1


def run(number: int, seed: int) -> Finding:
    """Make, write, read, calibrate and judge one recording of a member."""
    member = MEMBERS[number]
    case = member.make(seed)
    signal.alarm(_TIME_S)
    try:
        with tempfile.TemporaryDirectory() as folder:
            write = member.door or _as_usual
            recording = read_bag(write(case.recording, Path(folder)), warn=_ignore)
        return judge(case, calibrate(recording, case.options), CODES[member.kind])
    except InputError as error:
        return Finding(Answer.REFUSED, said=f"{INPUT_ERROR}: {error}")
    except (CalibrationError, MemoryError, TimeoutError) as error:
        return Finding(Answer.UNNAMED, said=f"{type(error).__name__}: {error}")
    finally:
        signal.alarm(0)


def _as_usual(recording: Recording, folder: Path) -> Path:
    path = folder / "walk.mcap"
    write_bag(recording, path)
    return path


def _ignore(_line: str) -> None:
    """Warnings of the reader are no answer."""


def _limit() -> None:
    """Limit the memory and the time of a process."""
    use_one_thread()
    resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, _MEMORY))
    signal.signal(signal.SIGALRM, _give_up)


def _give_up(*_: object) -> NoReturn:
    raise TimeoutError(f"given up after {_TIME_S} s")


_HEADING = (
    f"{'':2s} {'recording':34s} {'answers':30s} {'':4s} {'rotation':>9s} {'position':>9s} "
    f"{'sigmas':>7s} {'clock ms':>9s} {'scale':>6s}  said"
)


def _line(member: Member, findings: Sequence[Finding]) -> str:
    answers = ", ".join(finding.answer.value for finding in findings)
    right = all(finding.answer in member.right for finding in findings)
    worst = [
        max((getattr(finding, name) for finding in findings), key=_size)
        for name in ("rotation_rad", "position", "deviations", "worst_ms", "scale")
    ]
    rotation, position, deviations, worst_ms, scale = worst
    said = next((f.said for f in findings if f.answer not in member.right), findings[0].said)
    return (
        f"{member.kind:2s} {member.name:34s} {answers:30s} {'' if right else 'MISS':4s} "
        f"{rotation:9.5f} {position:9.5f} {deviations:7.1f} {worst_ms:9.2f} {scale:6.3f}  {said}"
    )


def _size(value: float) -> float:
    """Order values with NaN as the smallest."""
    return value if math.isfinite(value) else -1.0


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.field",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--kind", choices=sorted({m.kind for m in MEMBERS}), help="one kind only")
    parser.add_argument("--only", choices=[m.name for m in MEMBERS], help="one member only")
    parser.add_argument("--seeds", type=int, default=3, help="recordings of each (default: 3)")
    parser.add_argument("--jobs", type=int, default=1, help="processes (default: 1)")
    return parser.parse_args(argv)


if __name__ == "__main__":
    sys.exit(main())
