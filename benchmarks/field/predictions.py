"""How often `stcalib doctor` is right about the recordings of the field.

    python -m benchmarks.field.predictions               all members, one seed
    python -m benchmarks.field.predictions --seeds 3

Every recording is examined, and calibrated. Printed is how often "will calibrate" and "will not"
were true, how many cameras were left out against the prediction, and how many of these were in
doubt; and the time of both. Exit status 0.
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
    counted: Counter[str] = Counter()
    for member in MEMBERS:
        for seed in range(args.seeds if member.kind != "H" else 0):
            said, doubted, found, line = compared(member.make(seed))
            counted[f"{bool(said)} {bool(found)}"] += 1
            if said and found:
                counted["same"] += said == found
                counted["missing"] += len(said - found)
                counted["missing, in doubt"] += len((said - found) & doubted)
                counted["found, in doubt"] += len(found & doubted)
            mark = " " if bool(said) == bool(found) else "!"
            print(f"{mark} {member.kind}  {member.name:36s} {line}", flush=True)
    _print_summary(counted)
    return 0


def compared(case: Case) -> tuple[set[str], set[str], set[str], str]:
    """Return the cameras expected, in doubt, and calibrated, and all of it in a line."""
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
    said, doubted = set(predicted.calibrated), set(predicted.doubtful)
    line = (
        f"said {len(said)} ({len(doubted)} in doubt) {','.join(reasons) or '-'}, found "
        f"{len(names)} {','.join(why) or '-'}; {examined_s:.1f} s, {solved_s:.1f} s"
    )
    return said, doubted, names, line


def _print_summary(counted: Counter[str]) -> None:
    true, false = counted["True True"], counted["True False"]
    print(f"\n'will calibrate' was true {true} of {true + false} times", end="")
    print(f" ({counted['same']} with just these cameras)")
    not_true, not_false = counted["False False"], counted["False True"]
    print(f"'will not' was true {not_true} of {not_true + not_false} times")
    print(
        f"{counted['missing']} cameras were left out of those expected, "
        f"{counted['missing, in doubt']} of them in doubt; {counted['found, in doubt']} in doubt "
        "were calibrated"
    )


if __name__ == "__main__":
    raise SystemExit(main())
