"""The paper's method from a bag and a configuration file to a result."""

from __future__ import annotations

from pathlib import Path

import pytest

from stcalib_ros.cli import main
from stcalib_ros.core.evaluation.metrics import evaluate
from stcalib_ros.core.model.calibration import Status
from stcalib_ros.core.synthetic import SceneOptions, simulate
from stcalib_ros.io.bag_writer import write_bag
from stcalib_ros.io.mocap import shipped_clips
from stcalib_ros.io.results import read_result

CONFIG = """
offset_range_s: 0.3
registration: {method: vmf}
vmf: {window: 10, initial: candidates}
"""


def test_the_method_of_the_configuration_file_calibrates(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = SceneOptions(n_cameras=3, n_people=3, n_frames=150, max_offset_frames=5, seed=3)
    scene = simulate(options, clips=shipped_clips())
    bag, config, output = (tmp_path / name for name in ("bag.mcap", "config.yaml", "out.yaml"))
    write_bag(scene.recording, bag)
    config.write_text(CONFIG)
    assert main(["calibrate", str(bag), "-o", str(output), "--config", str(config), "-q"]) == 0
    assert capsys.readouterr().err == ""
    result = read_result(output)
    assert result.status is Status.OK
    found = evaluate(result, scene.truth, fps=30.0)
    assert found.missing == ()
    assert found.E_R < 5e-3
    assert found.E_t < 5e-3
    assert found.E_delta < 0.1
    assert found.precision > 0.95


@pytest.mark.parametrize(
    ("config", "says"),
    [
        ("registration: {method: arcs}", "registration.method must be one of correlation, vmf"),
        ("vmf: {starts: 3}", "unknown option vmf.starts: did you mean n_starts?"),
    ],
)
def test_a_method_that_there_is_not_is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], config: str, says: str
) -> None:
    (tmp_path / "config.yaml").write_text(config)
    arguments = ["calibrate", "x.mcap", "-o", str(tmp_path / "out.yaml"), "--config"]
    assert main([*arguments, str(tmp_path / "config.yaml")]) == 2
    error = capsys.readouterr().err
    assert says in error
    assert error.count("\n") == 1
