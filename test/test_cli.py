from __future__ import annotations

import dataclasses
import json
import math
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exclusion_helpers import left_out

import stcalib_ros
from stcalib_ros.cli import main, run_command
from stcalib_ros.commands.terminal import ProgressPrinter, calibration_text
from stcalib_ros.core.errors import CalibrationError, Cancelled, InputError
from stcalib_ros.core.model.calibration import Calibration, Status
from stcalib_ros.core.model.recording import Recording
from stcalib_ros.core.model.rejection import Rejection, RejectionReason, Remark, RemarkCode
from stcalib_ros.core.model.skeleton import common_skeleton
from stcalib_ros.core.options import Options
from stcalib_ros.core.stages import Stages
from stcalib_ros.core.synthetic import SceneOptions, simulate
from stcalib_ros.io.bag import read_bag
from stcalib_ros.io.results import read_result, write_result

DEMO = Path(stcalib_ros.__file__).parent / "data" / "demo"
BAG, TRUTH = str(DEMO / "balance.mcap"), str(DEMO / "balance_truth.yaml")
COMMANDS = ("calibrate", "clocks", "doctor", "evaluate", "people", "simulate", "convert", "export")

Solver = Callable[..., Calibration]


def stcalib(*arguments: str, **settings: Any) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "stcalib_ros", *arguments],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
        **settings,
    )


@pytest.fixture
def solve(monkeypatch: pytest.MonkeyPatch) -> Callable[[Solver], None]:
    """Put a solver in the place of the real one."""

    def use(solver: Solver) -> None:
        def run_stages(*arguments: Any, executor: Executor | None, **settings: Any) -> Stages:
            assert executor is None
            calibration = solver(*arguments, **settings)
            skeleton = common_skeleton(read_bag(BAG))
            return Stages(skeleton, (), (), (), (), calibration)

        monkeypatch.setattr("stcalib_ros.core.pipeline.run_stages", run_stages)

    return use


def truth(**changes: Any) -> Calibration:
    return dataclasses.replace(read_result(TRUTH), **changes)


def found(recording: Recording, options: Options, *, progress: Any) -> Calibration:
    for stage in ("lifting", "solving"):
        for fraction in (0.0, 0.5, 1.0):
            progress(stage, fraction)
    missing = (left_out("cam05", "saw nobody"),)
    least = Remark(RemarkCode.RECORD_LONGER)
    return truth(message="Found.", uncalibrated=missing, remarks=(least,))


@pytest.mark.parametrize("arguments", [["--help"], ["calibrate", "--help"]])
def test_help_is_quick_since_it_imports_little(arguments: list[str]) -> None:
    code = (
        "import sys\nfrom stcalib_ros.cli import main\n"
        f"try:\n    main({arguments})\nexcept SystemExit as end:\n    assert end.code == 0\n"
        "assert not {'numpy', 'scipy', 'cv2', 'mcap', 'yaml'} & set(sys.modules)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert all(name in done.stdout for name in COMMANDS if len(arguments) == 1)


@pytest.mark.parametrize(
    "arguments", [["calibrate", BAG, "-o", "a.yaml"], ["simulate", "a.mcap", "--truth", "t.yaml"]]
)
def test_bags_need_a_package_that_no_distribution_has(arguments: list[str]) -> None:
    code = (
        "import sys\nsys.modules['mcap'] = None\nfrom stcalib_ros.cli import main\n"
        f"sys.exit(main({arguments}))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    said = r"stcalib: bags need the Python package mcap\S*: install it with pip install mcap\n"
    assert (done.returncode, bool(re.fullmatch(said, done.stderr))) == (2, True), done.stderr


@pytest.mark.parametrize("name", COMMANDS)
def test_help_of_a_command(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main([name, "--help"])
    assert end.value.code == 0
    text = capsys.readouterr().out
    assert f"stcalib {name} " in text
    assert "exit status:" in text


@pytest.mark.parametrize("arguments", [[], ["fly"], ["calibrate", BAG], ["evaluate", TRUTH]])
def test_unusable_arguments(arguments: list[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main(arguments)
    assert end.value.code == 2


def test_calibrate(
    tmp_path: Path, solve: Callable[[Solver], None], capsys: pytest.CaptureFixture[str]
) -> None:
    solve(found)
    assert main(["calibrate", BAG, "--output", str(tmp_path / "out.yaml")]) == 0
    assert read_result(tmp_path / "out.yaml").message == "Found."
    assert [p.name for p in tmp_path.iterdir()] == ["out.yaml"]
    out, err = capsys.readouterr()
    assert err.splitlines() == ["reading the bag", "lifting", "solving"]
    assert "4 of 5 cameras calibrated from 3 people" in out
    assert "-317.00 ms +- 0.00" in out
    assert "\nA recording twice as long would reduce these uncertainties by about 30 %.\n" in out
    assert "NOT calibrated: cam05: saw nobody" in out
    assert "T_ref_cam" in out
    assert "t_ref = t_cam + offset" in out
    assert f"Written to {tmp_path / 'out.yaml'}" in out


def test_quiet(
    tmp_path: Path, solve: Callable[[Solver], None], capsys: pytest.CaptureFixture[str]
) -> None:
    solve(found)
    assert main(["calibrate", BAG, "-o", str(tmp_path / "out.yaml"), "-q"]) == 0
    assert capsys.readouterr() == ("", "")


def test_json(
    tmp_path: Path, solve: Callable[[Solver], None], capsys: pytest.CaptureFixture[str]
) -> None:
    solve(found)
    assert main(["calibrate", BAG, "-o", str(tmp_path / "out.yaml"), "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert (content["status"], content["reasons"]) == ("OK", [])
    assert content["uncalibrated"]["cam05"]["code"] == "UNSPECIFIED"
    assert content["remarks"][0]["code"] == "RECORD_LONGER"
    assert len(content["cameras"]) == 4


def test_json_of_a_refusal(
    tmp_path: Path, solve: Callable[[Solver], None], capsys: pytest.CaptureFixture[str]
) -> None:
    few = Rejection(RejectionReason.TOO_FEW_CAMERAS, measured=1.0, limit=2.0, unit="cameras")
    refused = truth(status=Status.INSUFFICIENT_DATA, cameras=(), rejections=(few,))
    solve(lambda *_, **__: dataclasses.replace(refused, reprojection_rms_px=math.nan))
    assert main(["calibrate", BAG, "-o", str(tmp_path / "out.yaml"), "--json"]) == 3
    out, err = capsys.readouterr()
    content = json.loads(out)
    assert (content["status"], content["cameras"]) == ("INSUFFICIENT_DATA", {})
    assert content["reprojection_rms_px"] is None
    (reason,) = content["reasons"]
    assert (reason["code"], reason["measured"], reason["limit"]) == ("TOO_FEW_CAMERAS", 1, 2)
    assert "stcalib: no trustworthy calibration (INSUFFICIENT_DATA)" in err


def test_arguments_take_precedence_over_the_configuration(
    tmp_path: Path, solve: Callable[[Solver], None]
) -> None:
    seen: list[tuple[list[str], Options]] = []

    def look(recording: Recording, options: Options, *, progress: Any) -> Calibration:
        seen.append(([c.name for c in recording.cameras], options))
        return truth()

    solve(look)
    config = tmp_path / "config.yaml"
    config.write_text("{seed: 5, offset_range_s: 1.5, reference: cam01, cameras: [cam03, cam01]}")
    arguments = ["calibrate", BAG, "-o", str(tmp_path / "out.yaml"), "-c", str(config)]
    assert main([*arguments, "--seed", "9", "--reference", "cam03"]) == 0
    names, options = seen[0]
    assert names == ["cam03", "cam01"]
    assert (options.seed, options.offset_range_s, options.reference) == (9, 1.5, "cam03")


def test_rejected_calibration(
    tmp_path: Path, solve: Callable[[Solver], None], capsys: pytest.CaptureFixture[str]
) -> None:
    solve(lambda *_, **__: truth(status=Status.DEGENERATE, message="Nobody moves."))
    output = tmp_path / "out.yaml"
    output.write_text("old")
    assert main(["calibrate", BAG, "--output", str(output), "--quiet"]) == 3
    assert output.read_text() == "old"
    rejected = tmp_path / "out.rejected.yaml"
    assert read_result(rejected).status is Status.DEGENERATE
    assert capsys.readouterr().err == (
        "stcalib: no trustworthy calibration (DEGENERATE): Nobody moves. "
        f"(what was found, not to be used, is in {rejected})\n"
    )


def test_rejected_without_poses(tmp_path: Path, solve: Callable[[Solver], None]) -> None:
    solve(lambda *_, **__: truth(status=Status.INSUFFICIENT_DATA, cameras=()))
    assert main(["calibrate", BAG, "--output", str(tmp_path / "out.yaml")]) == 3
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("error", "status"),
    [(CalibrationError("no way"), 3), (Cancelled("stopped"), 3), (KeyboardInterrupt(), 130)],
)
def test_failure(
    tmp_path: Path,
    solve: Callable[[Solver], None],
    error: BaseException,
    status: int,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def fail(*_: object, **__: object) -> Calibration:
        raise error

    solve(fail)
    assert main(["calibrate", BAG, "--output", str(tmp_path / "out.yaml"), "--quiet"]) == status
    assert capsys.readouterr().err == f"stcalib: {str(error) or 'interrupted'}\n"
    assert list(tmp_path.iterdir()) == []


def test_output_is_tried_before_the_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    missing = str(tmp_path / "missing.mcap")
    for output, reason in (
        (tmp_path, "it is a folder; name a file"),
        (tmp_path / "no" / "out.yaml", "no such folder"),
        (Path("/proc/out.yaml"), "choose another folder"),
    ):
        assert main(["calibrate", missing, "--output", str(output)]) == 2
        error = capsys.readouterr().err
        assert error.startswith(f"stcalib: cannot write {output}: ")
        assert reason in error
    assert list(tmp_path.iterdir()) == []


def test_ctrl_c_leaves_nothing(tmp_path: Path) -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "stcalib_ros", "calibrate", BAG, "-o", str(tmp_path / "out.yaml")],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stderr is not None
    assert process.stderr.readline() == "reading the bag\n"
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert err.splitlines()[-1] == "stcalib: interrupted"
    assert "Traceback" not in err
    assert out == ""
    assert list(tmp_path.iterdir()) == []


def test_a_closed_pipe_is_no_error() -> None:
    done = stcalib("evaluate", TRUTH, "--truth", TRUTH)
    assert done.returncode == 0
    process = subprocess.Popen(
        [sys.executable, "-m", "stcalib_ros", "evaluate", TRUTH, "--truth", TRUTH],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    assert process.stderr.read() == ""
    process.stderr.close()
    process.wait(timeout=60)


def test_evaluate(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cameras = list(truth().cameras)
    cameras[2] = dataclasses.replace(cameras[2], time_offset_s=cameras[2].time_offset_s + 0.03)
    write_result(truth(cameras=tuple(cameras)), tmp_path / "out.yaml")
    arguments = ["evaluate", str(tmp_path / "out.yaml"), "--truth", TRUTH]
    assert main(arguments) == 0
    text = capsys.readouterr().out
    assert "E_delta  10.00 ms\n" in text
    assert "100.0% of 13 matches" in text
    assert main([*arguments, "--fps", "60"]) == 0
    assert "E_delta  10.00 ms (0.600 frames)\n" in capsys.readouterr().out
    assert main([*arguments, "--json"]) == 0
    values = json.loads(capsys.readouterr().out)
    assert values["E_delta_s"] == pytest.approx(0.01)
    assert values["E_R"] == pytest.approx(0.0)
    assert values["E_delta"] is None
    assert values["precision"] == 1.0
    assert [c["name"] for c in values["cameras"]] == ["cam01", "cam02", "cam03", "cam04"]


def test_evaluate_a_rejected_result(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_result(truth(status=Status.NOT_CONVERGED), tmp_path / "out.yaml")
    assert main(["evaluate", str(tmp_path / "out.yaml"), "--truth", TRUTH]) == 0
    assert "not to be used: its status is NOT_CONVERGED" in capsys.readouterr().err


def test_evaluate_unusable_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["evaluate", str(tmp_path / "a.yaml"), "--truth", TRUTH]) == 2
    assert "no such file" in capsys.readouterr().err
    write_result(truth(cameras=truth().cameras[:1]), tmp_path / "a.yaml")
    assert main(["evaluate", str(tmp_path / "a.yaml"), "--truth", TRUTH]) == 2
    assert "two cameras in common" in capsys.readouterr().err


class Terminal:
    def __init__(self) -> None:
        self.text = ""

    def isatty(self) -> bool:
        return True

    def write(self, text: str) -> None:
        self.text += text

    def flush(self) -> None:
        pass


def test_progress_on_a_terminal_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    terminal: Any = Terminal()
    progress = ProgressPrinter(terminal)
    for fraction in (0.0, 0.001, 0.5, 1.0):
        progress("solving", fraction)
    progress.warn("odd")
    progress.close()
    assert "\n" not in terminal.text
    shown = terminal.text.split("\r\x1b[K")
    assert shown[1:] == [
        "[........................] solving",
        "[############............] solving",
        "[########################] solving",
        "",
    ]
    assert capsys.readouterr().err == "stcalib: warning: odd\n"


def test_text_without_scale_and_with_drift() -> None:
    cameras = list(truth().cameras)
    cameras[1] = dataclasses.replace(
        cameras[1], clock_skew=2.5e-5, covariance=np.full((6, 6), math.nan)
    )
    text = calibration_text(truth(metric=False, cameras=tuple(cameras)))
    assert "position x y z [baselines]" in text
    assert "-317.00 ms +- 0.00, +25.00 ppm\n" in text
    assert "nan" not in text.split("\n\n")[1]
    assert "distances between the first two cameras" in text


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (OSError(28, "No space left on device"), "[Errno 28] No space left on device"),
        (
            PermissionError(13, "Permission denied", "/a\x1b[31m"),
            "Permission denied: '/a\\x1b[31m'",
        ),
        (MemoryError(), "out of memory: use a shorter part of the data"),
        (InputError("a\x1b[31mb\nc"), "stcalib: a?[31mb?c"),
        (InputError("x" * 10_000), "x..."),
    ],
)
def test_every_error_is_one_printable_line(
    error: Exception, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail() -> None:
        raise error

    assert run_command("stcalib", fail) == 2
    printed = capsys.readouterr().err
    assert said in printed
    assert printed.count("\n") == 1
    assert len(printed) < 5100


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
def test_a_full_disk_below_standard_output(tmp_path: Path) -> None:
    truth = str(tmp_path / "truth.yaml")
    write_result(simulate(SceneOptions(n_cameras=2, n_frames=4)).truth, truth)
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "stcalib_ros", "evaluate", truth, "--truth", truth],
            cwd=Path(__file__).parents[1],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert (done.returncode, done.stderr) == (2, "stcalib: [Errno 28] No space left on device\n")
