"""The files of camera_info_manager: what its parser asks for, and what we read back."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import stcalib_ros as st
from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.core.model.recording import Intrinsics, LensModel
from stcalib_ros.io.camera_info_yaml import read_camera_info_yaml, write_camera_info

K = np.array([[801.25, 0.0, 321.5], [0.0, 799.0625, 238.75], [0.0, 0.0, 1.0]])
LENSES = [
    Intrinsics(640, 480, LensModel.PLUMB_BOB, K, np.zeros(0)),
    Intrinsics(640, 480, LensModel.PLUMB_BOB, K, np.array([-0.21, 1e-7, 0.0, 0.0, 0.0])),
    Intrinsics(640, 480, LensModel.EQUIDISTANT, K, np.array([0.02, -0.01, 0.0, 0.0])),
    Intrinsics(640, 480, LensModel.RATIONAL_POLYNOMIAL, K, np.linspace(0.1, 0.8, 8)),
]
REFERENCE = """\
image_width: 640
image_height: 480
camera_name: narrow_stereo
camera_matrix:
  rows: 3
  cols: 3
  data: [801.25, 0, 321.5, 0, 799.0625, 238.75, 0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-2.1e-01, 1e-07, 0, 0, 0]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]
projection_matrix:
  rows: 3
  cols: 4
  data: [801.25, 0, 321.5, 0, 0, 799.0625, 238.75, 0, 0, 0, 1, 0]
"""
"""As camera_calibration_parsers writes it: numbers without a dot are numbers there, too."""


def with_lens(lens: Intrinsics, *names: str) -> Calibration:
    truth = st.simulate(st.SceneOptions(n_cameras=2, n_frames=30)).truth
    return replace(
        truth, cameras=tuple(replace(truth.cameras[0], name=n, intrinsics=lens) for n in names)
    )


@pytest.mark.parametrize("lens", LENSES)
def test_a_lens_is_read_back_to_the_last_bit(tmp_path: Path, lens: Intrinsics) -> None:
    (path,) = write_camera_info(with_lens(lens, "cam0"), tmp_path / "lenses")
    assert path == tmp_path / "lenses" / "cam0.yaml"
    name, read = read_camera_info_yaml(path)
    assert (name, read.width, read.height, read.model) == ("cam0", 640, 480, lens.model)
    np.testing.assert_array_equal(read.K, lens.K)
    np.testing.assert_array_equal(read.D[: lens.D.size], lens.D)
    assert not read.D[lens.D.size :].any()


def entries_of_the_parser(content: Any) -> dict[str, Any]:
    """Take what ``readCalibrationYml`` of camera_calibration_parsers takes, as it takes it."""
    matrices = {}
    for key, rows, cols in (
        ("camera_matrix", 3, 3),
        ("rectification_matrix", 3, 3),
        ("projection_matrix", 3, 4),
    ):
        assert (content[key]["rows"], content[key]["cols"]) == (rows, cols)
        matrices[key] = [float(content[key]["data"][i]) for i in range(rows * cols)]
    D = content["distortion_coefficients"]
    n = D["rows"] * D["cols"]
    return {
        "size": (int(content["image_width"]), int(content["image_height"])),
        "name": str(content["camera_name"]),
        "model": str(content["distortion_model"]),
        "d": [float(D["data"][i]) for i in range(n)],
        **matrices,
    }


def test_the_file_has_what_the_parser_of_ros_takes(tmp_path: Path) -> None:
    (path,) = write_camera_info(with_lens(LENSES[1], "narrow_stereo"), tmp_path)
    ours, theirs = (
        entries_of_the_parser(yaml.safe_load(text)) for text in (path.read_text(), REFERENCE)
    )
    assert ours == theirs | {"d": [-0.21, 1e-7, 0.0, 0.0, 0.0]}


def test_a_file_of_ros_is_read(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(REFERENCE)
    name, lens = read_camera_info_yaml(tmp_path / "a.yaml")
    assert name == "narrow_stereo"
    np.testing.assert_array_equal(lens.K, K)
    np.testing.assert_array_equal(lens.D, [-0.21, 1e-7, 0.0, 0.0, 0.0])


def test_without_distortion_there_are_five_zeros(tmp_path: Path) -> None:
    (path,) = write_camera_info(with_lens(LENSES[0], "cam0"), tmp_path)
    content = yaml.safe_load(path.read_text())["distortion_coefficients"]
    assert content == {"rows": 1, "cols": 5, "data": [0.0] * 5}


def test_names_are_those_that_camera_info_manager_takes(tmp_path: Path) -> None:
    paths = write_camera_info(with_lens(LENSES[0], "site/cam-0", "7"), tmp_path)
    assert [path.name for path in paths] == ["site_cam_0.yaml", "7.yaml"]
    assert [read_camera_info_yaml(path)[0] for path in paths] == ["site_cam_0", "7"]


def test_two_cameras_do_not_share_a_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"cameras a/b, a_b would have one file, .*a_b\.yaml"):
        write_camera_info(with_lens(LENSES[0], "a/b", "a_b"), tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=r"cannot write to the folder .*file: .*; name another"):
        write_camera_info(with_lens(LENSES[0], "cam0"), tmp_path / "file")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("image_width: 640\n", "", "image_width is missing"),
        ("cols: 5", "cols: 4", r"distortion_coefficients\.data: expected 1 x 4 numbers, got 5"),
        ("data: [801.25, 0, 321.5, 0, 799", "data: [801.25, 0, 321.5, 0, -799", "no.* pinhole"),
        ("plumb_bob", "omnidirectional", "unknown CameraInfo.distortion_model 'omnidirectional'"),
    ],
)
def test_unusable_files(tmp_path: Path, old: str, new: str, message: str) -> None:
    (tmp_path / "a.yaml").write_text(REFERENCE.replace(old, new))
    with pytest.raises(InputError, match=message) as caught:
        read_camera_info_yaml(tmp_path / "a.yaml")
    assert str(caught.value).count("a.yaml") == 1


def test_binning_and_region_of_newer_files(tmp_path: Path) -> None:
    more = (
        "binning_x: 2\nbinning_y: 2\nroi: {x_offset: 40, y_offset: 20, height: 400, width: 600}\n"
    )
    (tmp_path / "a.yaml").write_text(REFERENCE + more)
    _, lens = read_camera_info_yaml(tmp_path / "a.yaml")
    assert (lens.width, lens.height) == (300, 200)
    np.testing.assert_allclose(lens.K[:2, 2], [(321.5 - 40) / 2, (238.75 - 20) / 2])
