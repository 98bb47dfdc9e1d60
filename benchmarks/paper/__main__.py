"""The paper's experiments.

    python -m benchmarks.paper all               everything, into out/; goes on where it stopped
    python -m benchmarks.paper table3            one experiment
    python -m benchmarks.paper all --reduced     the reduced set against baseline.json
    python -m benchmarks.paper report            docs/results.md and its figure from out/

Exit status 1 if the reduced set is worse than the baseline beyond its noise.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from benchmarks.paper import gate
from benchmarks.paper.experiments import EXPERIMENTS
from benchmarks.paper.report import write_report
from benchmarks.paper.run import Row, run_tasks
from benchmarks.paper.tables import tables

OUT = Path("out") / "paper"
_SPREAD_TRIALS = 5
"""Trials that the standard deviations of the baseline are computed from."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the requested experiments.

    Returns
    -------
    int
        0, or 1 if accuracy got worse.
    """
    args = _arguments(argv)
    if args.experiment == "report":
        write_report(args.out)
        return 0
    names = list(EXPERIMENTS) if args.experiment == "all" else [args.experiment]
    if args.update_baseline:
        return _update_baseline(names, args.jobs)
    if args.reduced:
        return _reduced(names, args)
    found = {name: _whole(name, args) for name in names}
    for name, rows in found.items():
        print(f"\n## {EXPERIMENTS[name].title}\n\n{tables(name, rows)}")
    _write_json(args.json, found)
    return 0


def _whole(name: str, args: argparse.Namespace) -> list[Row]:
    experiment = EXPERIMENTS[name]
    jobs = 1 if experiment.by_time else args.jobs
    store: Path = args.out / f"{name}.jsonl"
    if args.again:
        store.unlink(missing_ok=True)
    return run_tasks(experiment.tasks(), store, jobs=jobs, name=name)


def _reduced(names: Sequence[str], args: argparse.Namespace) -> int:
    """Trial 0 of the reduced set, beside the baseline."""
    found = _reduced_rows(names, 0, args.jobs)
    for name, rows in found.items():
        print(f"\n## {EXPERIMENTS[name].title} (reduced)\n\n{tables(name, rows)}")
    _write_json(args.json, found)
    baseline = {k: v for k, v in gate.read_baseline().items() if k.split("; ")[0] in found}
    worse = gate.regressions(_averages(found), baseline)
    print("\nworse than the baseline:" if worse else "\nas good as the baseline")
    print("".join(f"  {line}\n" for line in worse), end="")
    return 1 if worse else 0


def _update_baseline(names: Sequence[str], jobs: int) -> int:
    """Measure the reduced set on several trials and write the baseline of these experiments."""
    trials = [_averages(_reduced_rows(names, k, jobs)) for k in range(_SPREAD_TRIALS)]
    kept = {k: v for k, v in gate.read_baseline().items() if k.split("; ")[0] not in names}
    text = json.dumps(kept | gate.make_baseline(trials), indent=1, sort_keys=True)
    gate.BASELINE.write_text(text + "\n", encoding="utf-8")
    print(f"written to {gate.BASELINE}")
    return 0


def _reduced_rows(names: Sequence[str], trial: int, jobs: int) -> dict[str, list[Row]]:
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        for name in names:
            if tasks := EXPERIMENTS[name].reduced(trial):
                store = Path(folder) / f"{name}.jsonl"
                found[name] = run_tasks(tasks, store, jobs=jobs, name=name)
    return found


def _averages(found: dict[str, list[Row]]) -> dict[str, dict[str, float]]:
    out: dict[str, dict[str, float]] = {}
    for name, rows in found.items():
        out |= gate.averages(name, rows)
    return out


def _write_json(path: Path | None, found: dict[str, list[Row]]) -> None:
    if path is not None:
        path.write_text(json.dumps(found, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.paper", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("experiment", choices=[*EXPERIMENTS, "all", "report"])
    parser.add_argument("--reduced", action="store_true", help="few trials, against the baseline")
    parser.add_argument("--json", type=Path, metavar="OUT", help="the rows as JSON")
    parser.add_argument("--jobs", type=int, default=2, metavar="N", help="processes (default 2)")
    parser.add_argument("--again", action="store_true", help="do not go on, begin again")
    parser.add_argument("--update-baseline", action="store_true", help="write baseline.json anew")
    parser.add_argument("--out", type=Path, default=OUT, metavar="DIR", help="default: %(default)s")
    return parser.parse_args(argv)


if __name__ == "__main__":
    sys.exit(main())
