"""One thread of linear algebra, unless the user says else."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from stcalib_ros import threads
from stcalib_ros.threads import use_one_thread


@pytest.mark.parametrize(("given", "used"), [({}, "1"), ({"OMP_NUM_THREADS": "3"}, "3")])
def test_what_the_user_says_stays(
    monkeypatch: pytest.MonkeyPatch, given: dict[str, str], used: str
) -> None:
    for name in threads._VARIABLES:
        monkeypatch.delenv(name, raising=False)
    for name, value in given.items():
        monkeypatch.setenv(name, value)
    use_one_thread()
    assert os.environ["OMP_NUM_THREADS"] == used
    assert os.environ["OPENBLAS_NUM_THREADS"] == "1"
    monkeypatch.undo()


@pytest.mark.parametrize("module", ["stcalib_ros.cli", "stcalib_ros.commands.jobs"])
def test_it_is_said_before_numpy_is_imported(module: str) -> None:
    code = f"import sys, {module}; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
