"""The experiments by name, in the whole set and in the reduced one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from benchmarks.paper.multiview import real_tasks, table1_tasks, table2_tasks
from benchmarks.paper.pairwise import noise_tasks, protocol_tasks, table3_tasks
from benchmarks.paper.run import Task
from benchmarks.paper.scenes import REDUCED
from benchmarks.paper.table4 import table4_tasks, timing_tasks


@dataclass(frozen=True, slots=True)
class Experiment:
    """One of the paper's experiments.

    Attributes
    ----------
    title : str
    tasks : callable
        Tasks of the whole set.
    reduced : callable
        Tasks of the reduced set, from a trial on: trial 0 is compared with the baseline, the others
        say how far chance moves it.
    by_time : bool
        Times are measured: one task at a time.
    """

    title: str
    tasks: Callable[[], list[Task]]
    reduced: Callable[[int], list[Task]]
    by_time: bool = False


def _of_trial(tasks: list[Task], trial: int) -> list[Task]:
    """Tasks of one trial."""
    return [task for task in tasks if task.key.endswith(f" {trial}")]


EXPERIMENTS: Mapping[str, Experiment] = {
    "table1": Experiment(
        "Table I: extrinsics and association, synchronised",
        lambda: table1_tasks(3),
        lambda k: _of_trial(table1_tasks(k + 1, [REDUCED.name]), k),
    ),
    "table2": Experiment(
        "Table II: spatiotemporal calibration, clocks five frames late",
        lambda: table2_tasks(3),
        lambda k: _of_trial(table2_tasks(k + 1, [REDUCED.name]), k),
    ),
    "noise": Experiment(
        "Robustness to noise: sigma 1 to 5 px",
        lambda: noise_tasks("170915_toddler5", (1.0, 2.0, 3.0, 4.0, 5.0), 10, 10),
        lambda k: _of_trial(noise_tasks(REDUCED.name, (3.0,), k + 1, 2), k),
    ),
    "table3": Experiment(
        "Table III: unsynchronised pairs",
        lambda: table3_tasks(10),
        lambda k: _of_trial(table3_tasks(k + 1, [REDUCED.name]), k),
    ),
    "table4": Experiment(
        "Table IV: checkerboards",
        lambda: table4_tasks(100, 3),
        lambda k: _of_trial(table4_tasks(k + 1, 0), k),
    ),
    "protocol": Experiment(
        "The paper's protocol with the full clip, and on single windows of five frames",
        lambda: protocol_tasks(30, 20),
        lambda k: _of_trial(protocol_tasks(k + 1, 10), k),
    ),
    "timing": Experiment(
        "CPU time with and without temporal alignment",
        lambda: timing_tasks(3),
        lambda _: [],
        by_time=True,
    ),
    "real": Experiment("Real recordings", real_tasks, lambda _: []),
}
