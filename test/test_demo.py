"""The demo does what it says, and says what it does."""

from __future__ import annotations

import dataclasses
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from stcalib_ros import demo
from stcalib_ros.commands.terminal import WIDTH
from stcalib_ros.core.evaluation.metrics import evaluate
from stcalib_ros.core.model.calibration import Calibration, Status
from stcalib_ros.core.stages import Stages
from stcalib_ros.io.results import read_result

ROOT = Path(__file__).parents[1]
FILM = ROOT / "examples" / "film"
TRUTH = Path(demo.__file__).parent / "data" / "demo" / "balance_truth.yaml"


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path]:
    """What it prints, and the folder that it fills."""
    folder = tmp_path_factory.mktemp("demo")
    (folder / "examples").symlink_to(ROOT / "examples")
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "stcalib_ros.demo",
            "--output-dir",
            "out",
            "--film",
            "examples/film",
        ],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout, folder / "out"


def test_it_keeps_its_promises(shown: tuple[str, Path]) -> None:
    text, folder = shown
    assert text.count("  kept\n") == 4
    assert "MISSED" not in text
    evaluation = evaluate(read_result(folder / "demo.yaml"), read_result(TRUTH))
    assert evaluation.E_R <= 0.07
    assert evaluation.centre_max <= 0.25
    assert max(abs(c.offset_s) for c in evaluation.cameras) <= 0.05
    assert evaluation.precision == evaluation.recall == 1.0
    assert f"{evaluation.E_R:.3f} rad" in text


def test_the_film_comes_out_right(shown: tuple[str, Path]) -> None:
    _, folder = shown
    found = read_result(folder / "film.yaml")
    evaluation = evaluate(found, read_result(FILM / "truth.yaml"), fps=15.0)
    assert evaluation.E_R < 0.005
    assert evaluation.E_t < 0.01
    assert max(abs(c.offset_frames) for c in evaluation.cameras) < 0.1
    assert len(found.cameras) == 6
    assert len(found.persons) == 3


def test_it_writes_what_it_says(shown: tuple[str, Path]) -> None:
    text, folder = shown
    named = {"demo.html", "demo.png", "demo.yaml", "film.html", "film.jpg"}
    assert {p.name for p in folder.iterdir()} == named | {"film.yaml"}
    for name in named:
        assert f"out/{name}  " in text
    assert (folder / "demo.png").read_bytes().startswith(b"\x89PNG")
    assert "Calibrated" in (folder / "demo.html").read_text()


def test_everybody_is_there_once_and_is_said_to_be_what_they_are(shown: tuple[str, Path]) -> None:
    text, folder = shown
    said = re.findall(r"^Person \d+ is (.*)\.$", text, re.MULTILINE)
    assert sorted(said) == ["the bystander", "the man", "the woman, who is computer-generated"]
    assert len(read_result(folder / "demo.yaml").persons) == 3
    assert "calibrated from 3 people" in text


def test_it_fits_into_a_terminal_and_ends_with_how_to_look_at_it(shown: tuple[str, Path]) -> None:
    text, _ = shown
    assert max(map(len, text.splitlines())) <= WIDTH
    assert text.splitlines()[-1].endswith("open out/demo.html")


def test_it_is_honest_about_the_truth(shown: tuple[str, Path]) -> None:
    assert "only good to 2-3 degrees" in shown[0]


def estimate(**changes: object) -> Calibration:
    return dataclasses.replace(read_result(TRUTH), **changes)


def test_missed_promises_are_said() -> None:
    truth = read_result(TRUTH)
    cameras = list(truth.cameras)
    cameras[1] = dataclasses.replace(cameras[1], time_offset_s=0.0)
    swapped = (truth.persons[0], dataclasses.replace(truth.persons[1], tracks={"cam01": (2,)}))
    wrong = estimate(cameras=tuple(cameras), persons=swapped)
    text = demo.errors_text(evaluate(wrong, truth, fps=60.0), wrong, truth)
    missed = [line.split("  ")[0] for line in text.splitlines() if line.endswith("MISSED")]
    assert missed == ["clock offset, largest", "people recognised in all cameras"]
    assert demo.persons_right(wrong, truth) == (1, 3)
    assert demo.people_text(wrong, truth).splitlines()[1] == "Person 1 mixes up several people."


def test_a_refused_calibration_is_no_demo(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(*_: object, **__: object) -> Stages:
        refused = estimate(status=Status.DEGENERATE, message="nobody moves")
        return Stages(None, (), (), (), (), refused)

    monkeypatch.setattr(demo, "run_stages", refuse)
    assert demo.main(["--output-dir", str(tmp_path / "out")]) == 3
    assert "(DEGENERATE): nobody moves" in capsys.readouterr().err
    assert list((tmp_path / "out").iterdir()) == []


def test_without_matplotlib(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert demo.main(["--output-dir", str(tmp_path / "out")]) == 2
    assert "pip install 'stcalib-ros[report]'" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_an_impossible_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").touch()
    assert demo.main(["--output-dir", str(tmp_path / "file" / "out")]) == 2
    assert "choose another --output-dir" in capsys.readouterr().err


def test_interrupted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupt(*_: object, **__: object) -> Stages:
        raise KeyboardInterrupt

    monkeypatch.setattr(demo, "run_stages", interrupt)
    assert demo.main(["--output-dir", str(tmp_path)]) == 130
    assert capsys.readouterr().err.splitlines()[-1] == "demo: interrupted"
    assert os.listdir(tmp_path) == []
