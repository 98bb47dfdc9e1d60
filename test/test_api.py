"""`import stcalib_ros`: what it offers, what it loads, and that its examples run."""

from __future__ import annotations

import ast
import doctest
import inspect
import io
import re
import runpy
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import is_dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest

import stcalib_ros as st

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples"
DEMO_BAG = ROOT / "stcalib_ros" / "data" / "demo" / "balance.mcap"

FUNCTIONS = [name for name in st.__all__ if inspect.isroutine(getattr(st, name))]
CLASSES = [name for name in st.__all__ if inspect.isclass(getattr(st, name))]


def run(code: str) -> str:
    """Run a program in an interpreter of its own."""
    done = subprocess.run(
        [sys.executable, "-c", code], check=True, capture_output=True, text=True, cwd=ROOT
    )
    return done.stdout.strip()


def test_importing_the_package_loads_none_of_its_modules_nor_numpy() -> None:
    code = "import sys, stcalib_ros; print(*sys.modules)"
    loaded = run(code).split()
    assert "stcalib_ros" in loaded
    assert not {"numpy", "scipy", "yaml", "cv2", "stcalib_ros.core"} & set(loaded)


def test_the_help_of_the_command_loads_neither_numpy_nor_scipy() -> None:
    code = (
        "import sys; from stcalib_ros.cli import main\n"
        "try: main(['--help'])\n"
        "except SystemExit: print('LOADED', *sys.modules)"
    )
    loaded = run(code).partition("LOADED")[2].split()
    assert "stcalib_ros.cli" in loaded
    assert not {"numpy", "scipy"} & set(loaded)


@pytest.mark.parametrize("name", st.__all__)
def test_every_public_name_is_there_and_listed(name: str) -> None:
    assert getattr(st, name) is not None
    assert name in dir(st)


def test_public_names_are_those_that_type_checkers_see() -> None:
    tree = ast.parse((ROOT / "stcalib_ros" / "__init__.py").read_text())
    block = next(node for node in tree.body if isinstance(node, ast.If))
    imported = {
        alias.name: node.module
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert set(imported) == set(st.__all__) - {"__version__"}
    for name, module in imported.items():
        assert getattr(sys.modules[str(module)], name) is getattr(st, name)


def test_a_name_that_is_not_public_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'calibrte'"):
        st.calibrte  # noqa: B018


@pytest.mark.parametrize("name", FUNCTIONS)
def test_public_functions_say_what_they_take_raise_and_how_they_are_called(name: str) -> None:
    documentation = inspect.getdoc(getattr(st, name)) or ""
    assert "\nExamples\n--------\n" in documentation
    if name in ("find_layout", "run_stages"):
        return  # the arguments are those of another function, or stand in the summary
    for parameter in inspect.signature(getattr(st, name)).parameters:
        assert parameter in documentation


@pytest.mark.parametrize("name", CLASSES)
def test_public_records_document_every_field_by_name(name: str) -> None:
    record = getattr(st, name)
    documentation = inspect.getdoc(record) or ""
    assert documentation
    if is_dataclass(record):
        for field in inspect.signature(record).parameters:
            assert field in documentation


@pytest.mark.parametrize("name", FUNCTIONS + CLASSES)
def test_public_arrays_are_documented_with_their_shape(name: str) -> None:
    documentation = inspect.getdoc(getattr(st, name)) or ""
    arrays = re.findall(r"^\w.* : (.*\b(?:ndarray|array_like)\b.*)$", documentation, re.MULTILINE)
    assert [text for text in arrays if not re.search(r"\([^)]+,[^)]*\)", text)] == []


@pytest.mark.parametrize("name", ["", *FUNCTIONS])
def test_examples_of_docstrings_run(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    subject = getattr(st, name) if name else st
    finder = doctest.DocTestFinder(recurse=False)
    tests = finder.find(subject, name or "stcalib_ros", globs={name: subject})
    report = io.StringIO()
    runner = doctest.DocTestRunner()
    results = [runner.run(test, out=report.write) for test in tests]
    assert sum(result.attempted for result in results) > 0
    assert sum(result.failed for result in results) == 0, report.getvalue()


def run_example(
    name: str, monkeypatch: pytest.MonkeyPatch, arguments: list[str] | None = None
) -> None:
    monkeypatch.setattr(sys, "argv", [name, *(arguments or [])])
    runpy.run_path(str(EXAMPLES / name), run_name="__main__")


def test_the_example_from_arrays(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run_example("from_arrays.py", monkeypatch)
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("OK: 3 of 3 cameras")
    assert [line.split()[0] for line in lines[1:]] == ["cam0", "cam1", "cam2"]


def test_the_example_from_a_bag(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    run_example("from_bag.py", monkeypatch, [str(DEMO_BAG), str(tmp_path / "demo.yaml")])
    assert capsys.readouterr().out.startswith("OK: 4 of 4 cameras")
    assert len(st.read_result(tmp_path / "demo.yaml").cameras) == 4


class LocalClient:
    """Stands in for `distributed.Client`, which is not a dependency of ours: its executor."""

    used: ClassVar[list[str | None]] = []

    def __init__(self, address: str | None) -> None:
        self.used.append(address)

    def __enter__(self) -> LocalClient:
        return self

    def __exit__(self, *error: object) -> None:
        """Leave nothing open."""

    def get_executor(self) -> ThreadPoolExecutor:
        return ThreadPoolExecutor(2)


def test_the_example_with_a_cluster_gives_what_one_process_gives(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", SimpleNamespace(Client=LocalClient))
    output = tmp_path / "demo.yaml"
    run_example("dask_cluster.py", monkeypatch, [str(DEMO_BAG), str(output), "tcp://there:8786"])
    assert LocalClient.used == ["tcp://there:8786"]
    st.write_result(st.calibrate(st.read_bag(DEMO_BAG)), tmp_path / "alone.yaml")
    assert output.read_text() == (tmp_path / "alone.yaml").read_text()


def test_every_example_is_run_above() -> None:
    assert {p.name for p in EXAMPLES.glob("*.py")} == {
        "dask_cluster.py",
        "from_arrays.py",
        "from_bag.py",
    }


def arrays(**changes: object) -> dict[str, object]:
    """Arguments of `camera_from_arrays`: two poses of three joints in images 0 and 2 of three."""
    good: dict[str, object] = {
        "K": np.diag([500.0, 500.0, 1.0]),
        "image_size": (640, 480),
        "stamps": [0.0, 0.1, 0.2],
        "frames": [2, 0],
        "track_ids": [7, 7],
        "keypoints": np.arange(12.0).reshape(2, 3, 2),
        "joints": np.arange(18.0).reshape(2, 3, 3),
        "layout": st.find_layout("", ["pelvis", "neck", "head"]),
    }
    return good | changes


def test_poses_are_ordered_by_image_and_scored_by_whether_they_were_detected() -> None:
    keypoints = np.arange(12.0).reshape(2, 3, 2)
    keypoints[0, 1, 0] = np.nan
    given = keypoints.copy()
    given[0, 2] = 0.0  # as some estimators have it
    keypoints[0, 2] = np.nan
    camera = st.camera_from_arrays("left", **arrays(keypoints=given))
    (track,) = camera.tracks
    assert (camera.frame_id, track.track_id) == ("left_optical_frame", 7)
    np.testing.assert_array_equal(track.frames, [0, 2])
    np.testing.assert_array_equal(track.keypoints, keypoints[::-1])
    np.testing.assert_array_equal(track.joints[0], np.arange(9.0, 18.0).reshape(3, 3))
    np.testing.assert_array_equal(track.scores, [[1, 1, 1], [1, 0, 0]])
    assert camera.intrinsics.model is st.LensModel.PLUMB_BOB


def test_without_3d_poses_the_keypoints_are_given_alone() -> None:
    flat = arrays()
    del flat["joints"]
    (track,) = st.camera_from_arrays("left", **flat).tracks
    assert (track.joints.shape, bool(np.isnan(track.joints).all())) == ((2, 3, 3), True)
    np.testing.assert_array_equal(track.keypoints, np.arange(12.0).reshape(2, 3, 2)[::-1])
    nobody = {"frames": [], "track_ids": [], "keypoints": np.zeros((0, 3, 2)), "joints": None}
    assert st.camera_from_arrays("left", **arrays(**nobody)).tracks == ()


def test_a_camera_that_detects_nobody_has_its_images_and_no_track() -> None:
    nobody = {"frames": [], "track_ids": [], "joints": np.zeros((0, 3, 3))}
    camera = st.camera_from_arrays("left", **arrays(**nobody, keypoints=np.zeros((0, 3, 2))))
    assert (len(camera.stamps), camera.tracks) == (3, ())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"K": np.eye(4)}, r"camera left: K: expected shape \(3, 3\), got \(4, 4\)"),
        ({"keypoints": np.zeros((2, 4, 2))}, r"keypoints: expected shape \(2, 3, 2\), got"),
        ({"joints": np.zeros((2, 3, 2))}, r"joints: expected shape \(2, 3, 3\), got"),
        ({"scores": np.zeros(2)}, r"scores: expected shape \(2, 3\), got \(2,\)"),
        ({"track_ids": [7]}, r"track_ids: expected shape \(2\), got \(1,\)"),
        ({"track_ids": [7.0, 7.5]}, "track_ids: expected whole numbers"),
        ({"frames": [0, 3]}, "track 7 has 0 to 3"),
        ({"frames": [-1, 1]}, "frames must be indices into the 3 stamps"),
        ({"frames": [1, 1]}, "track 7 has two poses in image 1"),
        ({"stamps": [0.0, 0.2, 0.1]}, "stamps must be finite and strictly increasing"),
        ({"stamps": [0.0, 0.1, np.nan]}, "stamps must be finite and strictly increasing"),
        ({"layout": "coco_71"}, "unknown layout 'coco_71'"),
        ({"D": [0.1, 0.2, 0.3]}, "3 coefficients: plumb_bob takes 0, 4, 5"),
        ({"intrinsics": "guess"}, "intrinsics: expected given, refine or unknown, got 'guess'"),
    ],
)
def test_unusable_arrays_are_refused_with_camera_and_shape(
    change: dict[str, object], message: str
) -> None:
    with pytest.raises(st.InputError, match=message) as refused:
        st.camera_from_arrays("left", **arrays(**change))
    assert str(refused.value).startswith("camera left: ")


def test_unix_seconds_as_stamps_give_the_same_calibration() -> None:
    scene = st.simulate(st.SceneOptions(n_cameras=3, n_people=2, n_frames=120))
    late = tuple(replace(c, stamps=c.stamps + 1.76e9) for c in scene.recording.cameras)
    options = st.Options(offset_range_s=0.5)
    here = st.calibrate(replace(scene.recording, epoch_ns=0), options)
    there = st.calibrate(st.Recording(late), options)
    for ours, other in zip(here.cameras, there.cameras, strict=True):
        np.testing.assert_allclose(ours.t_ref_cam, other.t_ref_cam, atol=1e-3)
        assert ours.time_offset_s == pytest.approx(other.time_offset_s, abs=1e-4)
