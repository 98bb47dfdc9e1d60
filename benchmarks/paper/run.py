"""Tasks of the experiments: run side by side, kept as they finish, not run twice.

A task gives rows, plain dictionaries. They are appended to ``out/EXPERIMENT.jsonl`` with the key of
the task, so that an experiment that was interrupted goes on where it stopped.
"""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchmarks.table import finite
from stcalib_ros.core.evaluation.stage_errors import Errors

Row = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Task:
    """One piece of an experiment.

    Attributes
    ----------
    key : str
        Unique in the experiment.
    function : callable
        Gives rows; of a module, so that another process finds it.
    arguments : tuple
    """

    key: str
    function: Callable[..., list[Row]]
    arguments: tuple[Any, ...]


def run_tasks(tasks: Sequence[Task], store: Path, *, jobs: int, name: str) -> list[Row]:
    """Rows of all tasks, in their order; those that are in the store already are not run again."""
    done = dict(stored(store))
    left = [task for task in tasks if task.key not in done]
    store.parent.mkdir(parents=True, exist_ok=True)
    began = time.monotonic()
    with store.open("a", encoding="utf-8") as file:
        if cut_off(store):
            file.write("\n")
        for n, (task, rows) in enumerate(_finished(left, jobs), 1):
            done[task.key] = rows
            file.write(json.dumps({"key": task.key, "rows": [finite(row) for row in rows]}) + "\n")
            file.flush()
            elapsed = time.monotonic() - began
            progress = f"{name}: {n} of {len(left)} in {elapsed:.0f} s, {task.key}"
            print(progress, file=sys.stderr, flush=True)
    return [row for task in tasks for row in done[task.key]]


def cut_off(store: Path) -> bool:
    """Whether the last line of a store has no end, as after a run that was killed."""
    content = store.read_bytes()
    return bool(content) and not content.endswith(b"\n")


def stored(store: Path) -> Iterator[tuple[str, list[Row]]]:
    """Keys and rows of the tasks of a store; a line that was cut off is left out."""
    if not store.exists():
        return
    for line in store.read_text(encoding="utf-8").splitlines():
        try:
            entry = json.loads(line)
        except ValueError:
            continue
        yield entry["key"], entry["rows"]


def _finished(tasks: Sequence[Task], jobs: int) -> Iterator[tuple[Task, list[Row]]]:
    if jobs == 1:
        for task in tasks:
            yield task, task.function(*task.arguments)
        return
    with ProcessPoolExecutor(jobs) as pool:
        running = {pool.submit(task.function, *task.arguments): task for task in tasks}
        for future in as_completed(running):
            yield running[future], future.result()


def row(scene: str, method: str, stage: str, trial: int, errors: Errors | None, **more: Any) -> Row:
    """Return one row: the run and its errors (None: it failed)."""
    figures = {} if errors is None else asdict(errors)
    return {"scene": scene, "method": method, "stage": stage, "trial": trial} | figures | more


def figures(rows: Sequence[Row], name: str) -> list[float]:
    """One figure of many rows; those that have none are left out."""
    return [float(r[name]) for r in rows if r.get(name) is not None and math.isfinite(r[name])]
