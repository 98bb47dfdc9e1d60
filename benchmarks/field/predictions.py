"""How often `stcalib doctor` is right about the recordings of the field.

    python -m benchmarks.field.predictions               all members, one seed
    python -m benchmarks.field.predictions --seeds 3

Every recording is examined, and calibrated. Printed is how often "will calibrate" and "will not"
were true, and what went otherwise; and the time of both. Exit status 0.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Sequence

from benchmarks.field.__main__ import MEMBERS
from benchmarks.field.case import Case
from stcalib_ros.core.diagnosis.examine import examine
from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.calibration import Status
from stcalib_ros.core.pipeline import calibrate
from stcalib_ros.threads import use_one_thread


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark and print what it finds."""
    use_one_thread()
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--seeds", type=int, default=1, help="seeds of each member (default: 1)")
    args = parser.parse_args(argv)
    counted: Counter[tuple[str, str]] = Counter()
    same_cameras = 0
    for member in MEMBERS:
        for seed in range(args.seeds if member.kind != "H" else 0):
            said, found, line = compared(member.make(seed))
            counted["will" if said else "", "did" if found else ""] += 1
            same_cameras += bool(said) and said == found
            mark = " " if bool(said) == bool(found) else "!"
            print(f"{mark} {member.kind}  {member.name:36s} {line}", flush=True)
    return _summary(counted, same_cameras)


def compared(case: Case) -> tuple[set[str], set[str], str]:
    """Return the cameras that were expected, those that were calibrated, and both in a line."""
    begin = time.process_time()
    predicted = examine(case.recording, case.options)
    examined_s = time.process_time() - begin
    reasons = [one.reason.value for one in predicted.reasons]
    try:
        result = calibrate(case.recording, case.options)
        good = result.status is Status.OK
        names = {camera.name for camera in result.cameras} if good else set()
        why = [one.reason.value for one in result.reasons]
    except InputError as error:
        names, why = set(), [str(error)[:60]]
    solved_s = time.process_time() - begin - examined_s
    said = set(predicted.calibrated)
    least = min((fit.fitting for fit in predicted.fits.values()), default=float("nan"))
    line = (
        f"said {len(said)} {','.join(reasons) or '-'} ({least:.2f}), found {len(names)} "
        f"{','.join(why) or '-'}; {examined_s:.1f} s, {solved_s:.1f} s"
    )
    return said, names, line


def _summary(counted: Counter[tuple[str, str]], same_cameras: int) -> int:
    will, will_not = (
        sum(n for (s, _), n in counted.items() if bool(s) is w) for w in (True, False)
    )
    print(f"\n'will calibrate' was true {counted['will', 'did']} of {will} times", end="")
    print(f" ({same_cameras} with these cameras)")
    print(f"'will not' was true {will_not - counted['', 'did']} of {will_not} times")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
