"""What several benchmarks' tests share."""

from collections.abc import Callable

import pytest

from benchmarks.accuracy import cramer_rao, lenses, measure
from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.core.synthetic import Scene, simulate


@pytest.fixture
def play(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[Calibration], Calibration]], None]:
    """Let the calibration return what a function makes of the truth."""

    def play_with(answer: Callable[[Calibration], Calibration]) -> None:
        truths = []

        def simulated(*args, **kwargs) -> Scene:
            scene = simulate(*args, **kwargs)
            truths.append(scene.truth)
            return scene

        for benchmark in (cramer_rao, lenses, measure):
            monkeypatch.setattr(benchmark, "simulate", simulated)
        monkeypatch.setattr(measure, "calibrate", lambda *_: answer(truths[-1]))

    return play_with
