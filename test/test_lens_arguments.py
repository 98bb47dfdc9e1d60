"""Lenses on the command line: what is asked for, what is said of them, and their files."""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stcalib_ros
from stcalib_ros.cli import main
from stcalib_ros.commands import calibrate as command
from stcalib_ros.commands.terminal import calibration_text
from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.core.model.lens_knowledge import LensKnowledge, LensStddev
from stcalib_ros.core.model.skeleton import common_skeleton
from stcalib_ros.core.stages import Stages
from stcalib_ros.io.bag import read_bag
from stcalib_ros.io.camera_info_yaml import read_camera_info_yaml, write_camera_info
from stcalib_ros.io.config import Config
from stcalib_ros.io.lens_settings import LensSettings
from stcalib_ros.io.results import read_result, write_result
from stcalib_ros.report.tables import lenses

DEMO = Path(stcalib_ros.__file__).parent / "data" / "demo"
BAG, TRUTH = str(DEMO / "balance.mcap"), str(DEMO / "balance_truth.yaml")
UNKNOWN, REFINE = LensKnowledge.UNKNOWN, LensKnowledge.REFINE


def config(*arguments: str, file: Path | None = None) -> Config:
    parser = argparse.ArgumentParser()
    command.add_arguments(parser)
    given = [] if file is None else ["--config", str(file)]
    return command.config_of(parser.parse_args([BAG, "-o", "out.yaml", *given, *arguments]))


def estimated() -> Calibration:
    """The truth of the demo with the first lens estimated, the second as it was assumed."""
    truth = read_result(TRUTH)
    cameras = list(truth.cameras)
    lens = cameras[0].intrinsics
    scale = np.diag([1.01, 1.01, 1.0])
    changed = dataclasses.replace(lens, K=lens.K @ scale, D=lens.D + 0.01 * np.eye(5)[0])
    cameras[0] = dataclasses.replace(
        cameras[0],
        intrinsics=changed,
        lens_knowledge=UNKNOWN,
        lens_stddev=LensStddev(3.25, 4.5, 0.0, (0.0125,)),
    )
    cameras[1] = dataclasses.replace(cameras[1], lens_knowledge=REFINE)
    return dataclasses.replace(truth, cameras=tuple(cameras))


def test_of_all_cameras_or_of_one(tmp_path: Path) -> None:
    assert config().options.intrinsics == "given"
    everywhere = config("--intrinsics", "refine")
    assert (everywhere.options.intrinsics, everywhere.selection.camera) == ("refine", {})
    both = config("--intrinsics", "unknown", "--intrinsics", "a/b=given")
    assert both.options.intrinsics == "unknown"
    assert both.selection.camera["a/b"].lens.knowledge is LensKnowledge.GIVEN
    file = tmp_path / "c.yaml"
    file.write_text(
        "intrinsics: refine\n"
        "camera: {a: {lens_group: x, intrinsics: given, pose_topic: /p}, b: {lens_group: x}}\n"
    )
    later = config("--intrinsics", "unknown", "--intrinsics", "a=unknown", file=file)
    assert later.options.intrinsics == "unknown"
    assert later.selection.camera["a"].lens == LensSettings(UNKNOWN, "x")
    assert later.selection.camera["a"].pose_topic == "/p"


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("foo", "all cameras: expected given, refine or unknown, got 'foo'"),
        ("cam01=foo", "cam01: expected given, refine or unknown, got 'foo'"),
        ("=refine", "expected CAM=refine, got '=refine'"),
        ("=a.yaml", "expected CAM=a.yaml, got '=a.yaml'"),
        ("cam01=", "expected CAM=FILE, got 'cam01='"),
        ("lenses", "refine or unknown, got 'lenses', and there is no such file"),
    ],
)
def test_unusable(value: str, message: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main(["calibrate", BAG, "-o", "out.yaml", "--intrinsics", value])
    assert end.value.code == 2
    assert message in capsys.readouterr().err


def test_a_camera_that_is_not_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["calibrate", BAG, "-o", str(tmp_path / "a.yaml"), "--intrinsics", "cam9=refine"]
    assert main([*arguments, "-q"]) == 2
    error = capsys.readouterr().err
    assert error.startswith(
        "stcalib: intrinsics of camera cam9: there are no person poses of this camera; the bag has"
    )
    assert len(error.splitlines()) == 1


def test_a_file_takes_the_place_of_camera_info(tmp_path: Path) -> None:
    (file,) = write_camera_info(
        dataclasses.replace(estimated(), cameras=estimated().cameras[:1]), tmp_path
    )
    own = f"cam01={file}"
    given = read_bag(BAG, selection=config("--intrinsics", own).selection).cameras
    np.testing.assert_array_equal(given[0].intrinsics.K, estimated().cameras[0].intrinsics.K)
    assert [c.lens_knowledge for c in given] == [LensKnowledge.GIVEN, None, None, None]
    refined = config("--intrinsics", own, "--intrinsics", "cam01=refine").selection
    assert read_bag(BAG, selection=refined).cameras[0].lens_knowledge is REFINE
    file.write_text(file.read_text().replace("image_width: 1088", "image_width: 640"))
    with pytest.raises(
        stcalib_ros.InputError, match=r"cam01: .* 640 x 1920 px, but .* 1088 x 1920"
    ):
        read_bag(BAG, selection=config("--intrinsics", own).selection)
    with pytest.raises(stcalib_ros.InputError, match=r"no such file: missing\.yaml"):
        config("--intrinsics", "cam01=missing.yaml")


def camchain(*names: str) -> str:
    """Lenses of the demo as Kalibr writes them, the second half a pixel aside."""
    out = ""
    for i, name in enumerate(names):
        lens = read_result(TRUTH).cameras[i].intrinsics
        K, D = lens.K, np.pad(lens.D, (0, 4))[:4]
        out += (
            f"{name}:\n  camera_model: pinhole\n  distortion_model: radtan\n"
            f"  intrinsics: [{K[0, 0]}, {K[1, 1]}, {K[0, 2] + 0.5 * i}, {K[1, 2]}]\n"
            f"  distortion_coeffs: {D.tolist()}\n  resolution: [{lens.width}, {lens.height}]\n"
        )
    return out


def test_a_file_with_the_lenses_of_all_cameras(tmp_path: Path) -> None:
    names = ("cam01", "cam02", "cam03", "cam04")
    file = tmp_path / "camchain.yaml"
    file.write_text(camchain(*names))
    given = read_bag(BAG).cameras
    read = read_bag(BAG, selection=config("--intrinsics", str(file)).selection).cameras
    moved = [r.intrinsics.K[0, 2] - g.intrinsics.K[0, 2] for r, g in zip(read, given, strict=True)]
    np.testing.assert_allclose(moved, [0.0, 0.5, 1.0, 1.5], atol=1e-9)
    assert {c.lens_knowledge for c in read} == {LensKnowledge.GIVEN}
    worth = config(
        "--intrinsics", str(file), "--intrinsics", "refine", "--intrinsics", "cam02=given"
    )
    guessed = read_bag(BAG, selection=worth.selection).cameras
    assert [c.lens_knowledge for c in guessed] == [REFINE, LensKnowledge.GIVEN, REFINE, REFINE]
    assert guessed[1].intrinsics.K[0, 2] == read[1].intrinsics.K[0, 2]


def test_a_file_without_one_of_the_cameras(tmp_path: Path) -> None:
    file = tmp_path / "camchain.yaml"
    file.write_text(camchain("cam01", "cam02", "right"))
    with pytest.raises(
        stcalib_ros.InputError, match=r"no lens of camera cam03, cam04: it has cam01,"
    ):
        read_bag(BAG, selection=config("--intrinsics", str(file)).selection)
    others = ("--intrinsics", f"cam03={file}:right", "--intrinsics", "cam04=given")
    read = read_bag(BAG, selection=config("--intrinsics", str(file), *others).selection).cameras
    assert read[2].intrinsics.K[0, 2] == read_result(TRUTH).cameras[2].intrinsics.K[0, 2] + 1.0
    assert (read[2].lens_knowledge, read[3].lens_knowledge) == (LensKnowledge.GIVEN,) * 2
    with pytest.raises(
        stcalib_ros.InputError, match=f"cam03: .*name one of them: cam03={file}:cam01"
    ):
        config("--intrinsics", f"cam03={file}")


def test_one_lens_is_that_of_all_cameras_or_of_a_group(tmp_path: Path) -> None:
    file, settings = tmp_path / "camchain.yaml", tmp_path / "c.yaml"
    file.write_text(camchain("any"))
    first = read_result(TRUTH).cameras[0].intrinsics
    read = read_bag(BAG, selection=config("--intrinsics", str(file)).selection).cameras
    assert {c.intrinsics.K[0, 0] for c in read} == {first.K[0, 0]}
    settings.write_text("camera: {cam02: {lens_group: wide}, cam03: {lens_group: wide}}")
    group = config("--intrinsics", f"wide={file}", file=settings)
    read = read_bag(BAG, selection=group.selection).cameras
    assert [c.intrinsics.K[0, 0] == first.K[0, 0] for c in read] == [True, True, True, False]


def test_a_bag_without_lenses_says_what_to_set(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag, out = str(tmp_path / "a.mcap"), str(tmp_path / "out.yaml")
    simulated = ["simulate", bag, "--n-cameras", "2", "--n-frames", "30", "--unknown-lenses"]
    assert main([*simulated, "--truth", str(tmp_path / "t.yaml")]) == 0
    assert not any(camera.intrinsics.known for camera in read_bag(bag).cameras)
    assert read_result(tmp_path / "t.yaml").cameras[0].intrinsics.K[0, 0] == 1400.0
    capsys.readouterr()
    assert main(["calibrate", bag, "-o", out, "-q"]) == 2
    said = capsys.readouterr().err
    assert said.startswith("stcalib: cam0, cam1: the lens is unknown (K in CameraInfo is zero")
    assert "(--intrinsics unknown)" in said
    assert main(["calibrate", bag, "-o", out, "-q", "--intrinsics", "cam0=unknown"]) == 3
    assert "cam1: the lens is unknown" in (said := capsys.readouterr().err)
    assert "(--intrinsics cam1=unknown)" in said


def test_the_files_of_lenses(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def run_stages(*_: Any, **__: Any) -> Stages:
        return Stages(common_skeleton(read_bag(BAG)), (), (), (), (), estimated())

    monkeypatch.setattr("stcalib_ros.core.pipeline.run_stages", run_stages)
    folder = tmp_path / "lenses"
    arguments = ["calibrate", BAG, "-o", str(tmp_path / "o.yaml")]
    assert main([*arguments, "--write-camera-info", str(folder)]) == 0
    assert f"Written to {tmp_path / 'o.yaml'} and {folder}" in capsys.readouterr().out
    names = ["cam01", "cam02", "cam03", "cam04"]
    assert sorted(path.name for path in folder.iterdir()) == [f"{name}.yaml" for name in names]
    name, lens = read_camera_info_yaml(folder / "cam01.yaml")
    assert name == "cam01"
    np.testing.assert_array_equal(lens.K, estimated().cameras[0].intrinsics.K)
    (tmp_path / "file").touch()
    assert main([*arguments, "--write-camera-info", str(tmp_path / "file")]) == 2
    assert "cannot write to the folder" in capsys.readouterr().err


def test_what_was_found_is_read_back(tmp_path: Path) -> None:
    write_result(estimated(), tmp_path / "a.yaml")
    read = read_result(tmp_path / "a.yaml").cameras
    assert [c.lens_knowledge.value for c in read] == ["unknown", "refine", "given", "given"]
    assert [c.lens_stddev for c in read] == [c.lens_stddev for c in estimated().cameras]
    text = (tmp_path / "a.yaml").read_text()
    assert text.count("knowledge: ") == 2
    (tmp_path / "b.yaml").write_text(text.replace("knowledge: refine", "knowledge: guess"))
    with pytest.raises(stcalib_ros.InputError, match=r"cam02.intrinsics.knowledge: expected given"):
        read_result(tmp_path / "b.yaml")


def test_what_was_found_is_said() -> None:
    f = read_result(TRUTH).cameras[0].intrinsics.K[0, 0]
    text = calibration_text(estimated())
    head, first, second = text[text.index("lens of") :].splitlines()[:3]
    assert head.split()[:4] == ["lens", "of", "focal", "length"]
    assert first.startswith(f"cam01    {1.01 * f:.1f} +- 3.2 ")
    assert "k1 " in first
    assert " +- 0.0125" in first
    assert first.endswith("unknown")
    assert "+-" not in second
    assert second.endswith("a guess")
    assert "3.2" in lenses(estimated())
    assert lenses(read_result(TRUTH)) == ""
    assert "lens of" not in calibration_text(read_result(TRUTH))


def test_evaluate_says_how_far_estimated_lenses_are_off(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_result(estimated(), tmp_path / "a.yaml")
    assert main(["evaluate", str(tmp_path / "a.yaml"), "--truth", TRUTH]) == 0
    text = capsys.readouterr().out
    first, second = text[text.index("lens of") :].splitlines()[1:3]
    assert first.startswith("cam01    +1.00%")
    assert "k1 +0.0100" in first
    assert second.startswith("cam02    +0.00%")
    assert main(["evaluate", TRUTH, "--truth", TRUTH]) == 0
    assert "lens of" not in capsys.readouterr().out
