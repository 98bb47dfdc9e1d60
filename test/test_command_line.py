"""What all commands have in common: help, mistyped words, how much is printed, completion."""

from __future__ import annotations

import importlib
import io
import itertools
import json
import subprocess
import sys
from pathlib import Path

import pytest

import stcalib_ros as st
from stcalib_ros.cli import _COMMANDS, main
from stcalib_ros.commands.terminal import ProgressPrinter
from stcalib_ros.ros.parameter_specs import calibrator_help, help_asked
from stcalib_ros.ros.pose_estimator_parameters import estimator_help
from stcalib_ros.ros.restamp_parameters import relay_help


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def said(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    with pytest.raises(SystemExit) as end:
        main(arguments)
    assert end.value.code == 2
    return capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["calbrate"], "stcalib: unknown command calbrate: did you mean calibrate?"),
        (
            ["calibrate", "a.mcap", "--outptu", "a.yaml"],
            "stcalib calibrate: unknown option --outptu: did you mean --output?",
        ),
        (
            ["export", "a.yaml", "--format", "kalbir", "--output", "x"],
            "stcalib export: argument -f/--format: unknown value 'kalbir': did you mean kalibr?",
        ),
        (
            ["completion", "powershell"],
            "stcalib completion: argument SHELL: unknown value 'powershell': there are bash",
        ),
    ],
)
def test_mistyped_words(
    arguments: list[str], line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    err = said(arguments, capsys)
    assert err.startswith(line)
    assert err.count("\n") == 1


def test_shortened_options_are_known(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", str(tmp_path / "a.mcap"), "--n-cam", "2", "--n-frames", "20"]) == 0


@pytest.mark.parametrize("name", ["", *sorted(set(_COMMANDS) - {"models"})])
def test_called_bare_a_command_helps(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    err = said([name] if name else [], capsys)
    assert err.startswith(f"usage: stcalib {name}".rstrip())
    assert "exit status:" in err


def test_what_was_written_as_json_or_not_at_all(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag, flags = str(tmp_path / "a.mcap"), ["--n-cameras", "2", "--n-frames", "20"]
    assert main(["simulate", bag, *flags, "--json"]) == 0
    written = json.loads(capsys.readouterr().out)
    assert [camera["images"] for camera in written["cameras"]] == [20, 20]
    assert main(["simulate", bag, *flags, "-q"]) == 0
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize("name", _COMMANDS)
def test_every_command_has_json_quiet_and_verbose(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main([name, "--help"])
    text = capsys.readouterr().out
    assert all(option in text for option in ("--json", "--quiet", "--verbose"))


def test_progress_says_what_is_left() -> None:
    seconds = itertools.chain([0.0, 1.0, 10.0], itertools.repeat(10.0))
    stream = Terminal()
    progress = ProgressPrinter(stream, clock=lambda: next(seconds))
    progress("matching camera pairs", 0.1)
    assert "left" not in stream.getvalue()
    progress("matching camera pairs", 0.25)
    assert "about 30 s left" in stream.getvalue()


def test_verbose_says_how_long_stages_took() -> None:
    seconds = iter([0.0, 2.5, 2.5, 4.0])
    stream = io.StringIO()
    progress = ProgressPrinter(stream, verbose=True, clock=lambda: next(seconds))
    progress("a", 0.0)
    progress("b", 0.0)
    progress.close()
    assert stream.getvalue().splitlines() == ["   2.5 s  a", "   1.5 s  b"]


def test_completions_are_scripts(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("shtab")
    assert main(["completion", "bash"]) == 0
    script = capsys.readouterr().out
    subprocess.run(["bash", "-n"], input=script, text=True, check=True)
    assert "--intrinsics" in script


def test_completions_need_their_package(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "shtab", None)
    assert main(["completion", "bash"]) == 2
    assert "pip install 'stcalib-ros[completion]'" in capsys.readouterr().err


def test_nodes_say_what_they_do() -> None:
    assert help_asked(["--help"])
    assert not help_asked(["--ros-args", "--help"])
    assert "window_s (30.0)" in calibrator_help()
    assert "ros2 run stcalib_ros restamp" in relay_help()
    assert "camera.CAMERA.image_topic ('/CAMERA/image_raw', fixed)" in estimator_help()


def test_a_calibration_prints_as_a_short_table() -> None:
    truth = st.simulate(st.SceneOptions(n_cameras=2, n_frames=20)).truth
    lines = str(truth).splitlines()
    assert lines[0].startswith("OK")
    assert [line.split()[0] for line in lines[1:]] == ["cam0", "cam1"]


def test_every_command_is_a_module() -> None:
    for name in _COMMANDS:
        assert importlib.import_module(f"stcalib_ros.commands.{name}").DESCRIPTION
