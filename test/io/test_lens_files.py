"""Lenses in files as other programs write them: points project to where those programs say."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml

import stcalib_ros as st
from stcalib_ros.core.errors import InputError
from stcalib_ros.core.geometry.lens import project
from stcalib_ros.core.model.recording import Intrinsics, LensModel
from stcalib_ros.io.camera_info_yaml import camera_info_text
from stcalib_ros.io.lens_files import lenses_of, read_lenses

K = np.array([[801.25, 0.0, 641.5], [0.0, 799.0625, 351.75], [0.0, 0.0, 1.0]])
PLUMB, FISHEYE = np.array([-0.21, 0.05, 1e-3, -2e-3]), np.array([0.02, -0.01, 3e-3, -1e-3])
POINTS = np.random.default_rng(0).uniform([-2, -1, 3], [2, 1, 6], (20, 3))
CAMCHAIN = """\
cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.21, 0.05, 0.001, -0.002]
  distortion_model: radtan
  intrinsics: [801.25, 799.0625, 641.5, 351.75]
  resolution: [1280, 720]
  rostopic: /site/left/image_raw
cam1:
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, 0.1]
  - [0.0, 1.0, 0.0, 0.0]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  cam_overlaps: [0]
  camera_model: pinhole
  distortion_coeffs: [0.02, -0.01, 0.003, -0.001]
  distortion_model: equi
  intrinsics: [801.25, 799.0625, 641.5, 351.75]
  resolution: [1280, 720]
  rostopic: /site/right/image_raw
"""
POSE2SIM = """\
[int_cam01_img]
name = "int_cam01_img"
size = [ 1280.0, 720.0]
matrix = [ [ 801.25, 0.0, 641.5], [ 0.0, 799.0625, 351.75], [ 0.0, 0.0, 1.0]]
distortions = [ -0.21, 0.05, 0.001, -0.002]
rotation = [ 1.67, 1.03, -0.39]
translation = [ 0.26, 0.96, 2.93]
fisheye = false

[metadata]
adjusted = false
error = 0.0
"""
ANIPOSE = """\
[cam_0]
name = "A"
size = [ 1280, 720,]
matrix = [ [ 801.25, 0.0, 641.5,], [ 0.0, 799.0625, 351.75,], [ 0.0, 0.0, 1.0,],]
distortions = [ -0.21, 0.05, 0.001, -0.002, 0.0,]
rotation = [ 0.0, 0.0, 0.0,]
translation = [ 0.0, 0.0, 0.0,]

[cam_1]
name = "B"
size = [ 1280, 720,]
matrix = [ [ 801.25, 0.0, 641.5,], [ 0.0, 799.0625, 351.75,], [ 0.0, 0.0, 1.0,],]
distortions = [ 0.02, -0.01, 0.003, -0.001,]
rotation = [ 0.0, 0.0, 0.0,]
translation = [ 0.0, 0.0, 0.0,]
fisheye = true
"""
CALISCOPE = """\
# Cameras

[cameras.0]
cam_id = 0
rotation_count = 0
size = [1280, 720]
matrix = [[801.25, 0.0, 641.5], [0.0, 799.0625, 351.75], [0.0, 0.0, 1.0]]
distortions = [-0.21, 0.05, 0.001, -0.002, 0.0]

[cameras.1]
cam_id = 1
size = [1280, 720]
"""
COLMAP = """\
# Camera list with one line of data per camera:
#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]
# Number of cameras: 2
3 OPENCV 1280 720 801.25 799.0625 642 352.25 -0.21 0.05 0.001 -0.002
7 OPENCV_FISHEYE 1280 720 801.25 799.0625 642 352.25 0.02 -0.01 0.003 -0.001
"""
IMAGES = """\
# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME
1 1 0 0 0 0 0 0 3 left/000.jpg

2 1 0 0 0 0 0 0 7 right.png
10.5 20.5 -1 3 4 5
3 1 0 0 0 0 0 0 3 left/001.jpg

"""


OST_TEXT = """\
# oST version 5.0 parameters


[image]

width
1280

height
720
"""


def expected(D: np.ndarray, *, fisheye: bool = False) -> np.ndarray:
    zero = np.zeros(3)
    model = cv2.fisheye.projectPoints if fisheye else cv2.projectPoints
    return np.asarray(model(POINTS[:, None], zero, zero, K, D)[0]).reshape(-1, 2)


def assert_projects(lens: Intrinsics, D: np.ndarray = PLUMB, *, fisheye: bool = False) -> None:
    assert (lens.width, lens.height) == (1280, 720)
    np.testing.assert_allclose(project(POINTS, lens), expected(D, fisheye=fisheye), atol=1e-6)


def written(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def test_kalibr(tmp_path: Path) -> None:
    lenses = read_lenses(written(tmp_path / "camchain-a.yaml", CAMCHAIN))
    assert list(lenses) == ["cam0", "cam1", "site/left", "site/right"]
    assert_projects(lenses["cam0"])
    assert_projects(lenses["site/right"], FISHEYE, fisheye=True)


@pytest.mark.parametrize(("old", "new"), [(": pinhole", ": omni"), (": radtan", ": fov")])
def test_models_of_kalibr_that_cannot_be_used(tmp_path: Path, old: str, new: str) -> None:
    path = written(tmp_path / "camchain-a.yaml", CAMCHAIN.replace(old, new, 1))
    with pytest.raises(InputError, match=r": cam0: the model \S*(omni|fov)\S* cannot be used: cal"):
        read_lenses(path)


def test_pose2sim(tmp_path: Path) -> None:
    lenses = read_lenses(written(tmp_path / "Calib_scene.toml", POSE2SIM))
    assert set(lenses) == {"int_cam01_img", "cam01"}
    assert_projects(lenses["cam01"])


def test_aniposelib(tmp_path: Path) -> None:
    lenses = read_lenses(written(tmp_path / "calibration.toml", ANIPOSE))
    assert set(lenses) == {"A", "B", "cam_0", "cam_1"}
    assert_projects(lenses["A"], np.append(PLUMB, 0.0))
    assert_projects(lenses["B"], FISHEYE, fisheye=True)


def test_caliscope(tmp_path: Path) -> None:
    """A camera that Caliscope has not calibrated is not there."""
    written(tmp_path / "camera_array.toml", CALISCOPE)
    lenses = read_lenses(tmp_path)
    assert set(lenses) == {"cam_0", "cam0", "0"}
    assert_projects(lenses["cam_0"])


def test_colmap_has_its_pixel_centres_at_half(tmp_path: Path) -> None:
    path = written(tmp_path / "cameras.txt", COLMAP)
    lenses = read_lenses(path)
    assert list(lenses) == ["3", "7"]
    assert_projects(lenses["3"])
    assert_projects(lenses["7"], FISHEYE, fisheye=True)
    written(tmp_path / "images.txt", IMAGES)
    assert list(read_lenses(tmp_path)) == ["3", "7", "left", "right"]


@pytest.mark.parametrize(
    ("row", "D", "model"),
    [
        ("SIMPLE_PINHOLE 1280 720 801.25 642 352.25", [], LensModel.PLUMB_BOB),
        ("PINHOLE 1280 720 801.25 799.0625 642 352.25", [], LensModel.PLUMB_BOB),
        ("SIMPLE_RADIAL 1280 720 801.25 642 352.25 -0.2", [-0.2], LensModel.PLUMB_BOB),
        ("RADIAL 1280 720 801.25 642 352.25 -0.2 0.05", [-0.2, 0.05], LensModel.PLUMB_BOB),
        (
            "FULL_OPENCV 1280 720 801.25 799.0625 642 352.25 1 2 3 4 5 6 7 8",
            [1, 2, 3, 4, 5, 6, 7, 8],
            LensModel.RATIONAL_POLYNOMIAL,
        ),
        (
            "RADIAL_FISHEYE 1280 720 801.25 642 352.25 0.02 0.01",
            [0.02, 0.01],
            LensModel.EQUIDISTANT,
        ),
    ],
)
def test_models_of_colmap(
    tmp_path: Path,
    row: str,
    D: list[float],
    model: LensModel,
) -> None:
    (lens,) = read_lenses(written(tmp_path / "cameras.txt", f"1 {row}\n")).values()
    assert lens.model is model
    np.testing.assert_array_equal(lens.D[: len(D)], D)
    assert not lens.D[len(D) :].any()
    np.testing.assert_array_equal(lens.K[:2, 2], [641.5, 351.75])
    assert lens.K[0, 0] == 801.25


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("1 FOV 1280 720 801 801 640 360 0.9", "camera 1: the model FOV cannot be used: expected"),
        ("1 PINHOLE 1280 720 801 640 360", "camera 1: expected PINHOLE WIDTH HEIGHT fx fy cx cy"),
        ("1 PINHOLE 1280 720 -1 801 640 360", "K is not a pinhole matrix"),
    ],
)
def test_unusable_cameras_of_colmap(tmp_path: Path, row: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_lenses(written(tmp_path / "cameras.txt", f"{row}\n"))


@pytest.mark.parametrize("ending", ["yml", "xml", "json"])
@pytest.mark.parametrize(
    ("k", "d", "size"),
    [
        ("camera_matrix", "distortion_coefficients", ("image_width", "image_height")),
        ("Camera_Matrix", "Distortion_Coefficients", ("image_Width", "image_Height")),
        ("cameraMatrix", "distCoeffs", ("imageSize",)),
        ("K", "dist", ("image_size",)),
    ],
)
def test_opencv(tmp_path: Path, ending: str, k: str, d: str, size: tuple[str, ...]) -> None:
    path = tmp_path / f"front.{ending}"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("calibration_time", "Sat 28 Nov 2026")
    storage.write(k, K)
    storage.write(d, PLUMB[:, None])
    if len(size) == 1:
        storage.startWriteStruct(size[0], cv2.FileNode_SEQ)
        storage.write("", 1280)
        storage.write("", 720)
        storage.endWriteStruct()
    else:
        storage.write(size[0], 1280)
        storage.write(size[1], 720)
    storage.release()
    lenses = read_lenses(path)
    assert list(lenses) == ["front"]
    assert_projects(lenses["front"])


def test_opencv_with_several_cameras(tmp_path: Path) -> None:
    """As stereo_calib and EasyMocap have them; one of them is a fisheye."""
    path = tmp_path / "intri.yml"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, D in (("01", PLUMB), ("02", FISHEYE)):
        storage.write(f"K_{name}", K)
        storage.write(f"dist_{name}", D[None])
    storage.write("fisheye_02", 1)
    storage.release()
    lenses = read_lenses(tmp_path, image_size=(1280, 720))
    assert list(lenses) == ["01", "02"]
    assert_projects(lenses["01"])
    assert_projects(lenses["02"], FISHEYE, fisheye=True)
    with pytest.raises(InputError, match=r"K_01: the file has no size of the image: add image_wi"):
        read_lenses(path)


PLAIN = {"mtx": K.tolist(), "dist": [PLUMB.tolist()], "image_size": [1280, 720]}


def save_arrays(path: Path, content: Mapping[str, Any]) -> None:
    np.savez(path, **content)


def save_json(path: Path, content: Mapping[str, Any]) -> None:
    path.write_text(json.dumps(content), encoding="utf-16")


def save_yaml(path: Path, content: Mapping[str, Any]) -> None:
    path.write_bytes(yaml.safe_dump(content).replace("\n", "\r\n").encode("utf-8-sig"))


@pytest.mark.parametrize(
    ("name", "save"),
    [("a.npz", save_arrays), ("a.json", save_json), ("A.YAML", save_yaml)],
)
def test_matrices_as_python_programs_save_them(
    tmp_path: Path, name: str, save: Callable[[Path, Mapping[str, Any]], None]
) -> None:
    """As OpenCV's tutorials do, with lists in the place of its own matrices."""
    save(tmp_path / name, PLAIN)
    assert_projects(read_lenses(tmp_path / name)["a" if name[0] == "a" else "A"])
    save(tmp_path / name, {key: PLAIN[key] for key in ("mtx", "dist")})
    assert_projects(lenses_of(tmp_path / name, ["front"], image_size=(1280, 720))["front"])
    with pytest.raises(InputError, match="mtx: the file has no size of the image: add image_widt"):
        read_lenses(tmp_path / name)


def test_a_mapping_a_camera(tmp_path: Path) -> None:
    other = {"K": K.tolist(), "D": FISHEYE.tolist(), "size": [1280, 720], "fisheye": True}
    save_json(tmp_path / "a.json", {"left": PLAIN, "right": other, "date": "today"})
    lenses = read_lenses(tmp_path / "a.json")
    assert list(lenses) == ["left", "right"]
    assert_projects(lenses["left"])
    assert_projects(lenses["right"], FISHEYE, fisheye=True)


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"x": np.eye(2)}, r"has no camera matrix \(mtx, K or camera_matrix\), but x"),
        ({"camera_names": ["a", "b"], "K": K[None]}, "expected a row for each of 2 cameras"),
        ({"camera_names": ["a"], "K": 0.0}, "expected a row for each of 1 cameras"),
    ],
)
def test_unusable_arrays(tmp_path: Path, arrays: dict[str, Any], message: str) -> None:
    np.savez(tmp_path / "a.npz", **arrays)
    with pytest.raises(InputError, match=message):
        read_lenses(tmp_path / "a.npz")


def test_a_folder_with_a_folder_a_camera(tmp_path: Path) -> None:
    """As calibrationdata.tar.gz of each camera is unpacked; names are compared as of topics."""
    truth = st.simulate(st.SceneOptions(n_cameras=3, n_frames=30)).truth
    for name, camera in zip(("Küche 1", "2", "cam0"), truth.cameras, strict=True):
        (tmp_path / name).mkdir()
        (tmp_path / name / "ost.yaml").write_text(camera_info_text(camera))
        (tmp_path / name / "ost.txt").write_text(OST_TEXT)
        (tmp_path / name / "._ost.yaml").write_bytes(b"\0\5\26\7")
        (tmp_path / name / "left-0000.png").write_bytes(b"\x89PNG")
    assert list(lenses_of(tmp_path, ["cam0", "cam2", "Kuche_1"])) == ["cam0", "cam2", "Kuche_1"]


def test_a_folder_with_a_file_a_camera(tmp_path: Path) -> None:
    truth = st.simulate(st.SceneOptions(n_cameras=2, n_frames=30)).truth
    st.write_camera_info(truth, tmp_path)
    written(tmp_path / "cam2.toml", POSE2SIM)
    lenses = read_lenses(tmp_path)
    assert list(lenses) == ["cam0", "cam1", "cam2"]
    np.testing.assert_array_equal(lenses["cam1"].K, truth.cameras[1].intrinsics.K)
    assert_projects(lenses["cam2"])


def test_a_result_has_lenses_too(tmp_path: Path) -> None:
    truth = st.simulate(st.SceneOptions(n_cameras=2, n_frames=30)).truth
    st.write_result(truth, tmp_path / "walk.yaml")
    lenses = read_lenses(tmp_path / "walk.yaml")
    assert list(lenses) == ["cam0", "cam1"]
    np.testing.assert_array_equal(lenses["cam1"].K, truth.cameras[1].intrinsics.K)


def test_names_of_cameras(tmp_path: Path) -> None:
    """One lens is that of all cameras unless it has the name of one."""
    many = written(tmp_path / "camchain.yaml", CAMCHAIN)
    assert list(lenses_of(many, ["site/right", "cam0"])) == ["site/right", "cam0"]
    assert list(lenses_of(many, ["site_left"])) == ["site_left"]
    with pytest.raises(InputError, match="no lens of cam2: it has cam0, cam1, site/left, site/r"):
        lenses_of(many, ["cam0", "cam2"])
    one = written(tmp_path / "any.toml", POSE2SIM)
    assert list(lenses_of(one, ["a", "b"])) == ["a", "b"]
    with pytest.raises(InputError, match=r"no lens of cam02: it has .*; add those"):
        lenses_of(one, ["cam01", "cam02"])


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.yaml", "people: [1, 2]", "a.yaml has no lens, but people; lenses are read from came"),
        ("a.yaml", " \n", "a.yaml is empty: write it again, or name another file of lenses"),
        ("ost.txt", OST_TEXT, "has lenses as text: name the ost.yaml that was saved beside it"),
        ("x.tar.gz", "", "is an archive: unpack it, and name the file of lenses in it"),
        ("a.json", '{"K": [[1, 0], [0, 1]]}', "a.json has no lens, but K; lenses are read from"),
        ("a.json", '{"mtx": [[1, 0, 0], [0, 1, "x"], [0, 0, 1]]}', "mtx cannot be read"),
        ("a.md", "# Lenses\n- [a: b", r"a\.md has no lens; lenses are read from camera_info YAML"),
        ("a.yaml", 5000 * "\n" + "- a", "is not a file of OpenCV's FileStorage; lenses are"),
        ("a.txt", "1 PINHOLE 640 480 8 8 3 2\n2", "camera 2: the model  cannot be used: expected"),
        ("a.yaml", "{", "is not valid YAML"),
        ("a.yaml", "&a [*a, \u0000]", "is not valid YAML"),
        ("a.xml", "<opencv_storage><K>", "is not valid XML.*; lenses are read from"),
        ("a.xml", "<robot/>", "expected <opencv_storage>, got <robot>"),
        ("a.xml", '<!DOCTYPE x [<!ENTITY a "b">]><x/>', "it declares entities"),
        ("a.toml", "[project]\nname = 'x'", "no camera with size and matrix, .* there is project"),
        ("a.toml", "[a]\nsize = [", "a.toml is not valid TOML"),
        ("a.toml", "a = " + 5000 * "[", "a.toml cannot be read as TOML"),
        ("a.toml", POSE2SIM.replace("1280.0, ", ""), r"int_cam01_img.size: expected 2 numbers"),
        ("a.toml", POSE2SIM.replace("801.25", "nan"), r"int_cam01_img.matrix\[0\]: expected fin"),
        ("a.yaml", CAMCHAIN.replace("[1280, 720]", "[1280]", 1), "cam0.resolution: expected 2 num"),
        ("a.yaml", "K: !!opencv-matrix {rows: 3, cols: 3, data: [1]}", "K cannot be read .*resh"),
    ],
)
def test_what_is_no_lens(tmp_path: Path, name: str, text: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        read_lenses(written(tmp_path / name, text))
    assert "\n" not in str(caught.value)


def test_folders_without_lenses(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"has no lenses: expected a file a camera, CAM\.yaml or"):
        read_lenses(tmp_path)
    with pytest.raises(InputError, match="no such file"):
        read_lenses(tmp_path / "missing.yaml")
