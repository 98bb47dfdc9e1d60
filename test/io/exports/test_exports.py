"""What is written is read by the programs that it is for, and projects as we do."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from export_helpers import (
    FISHEYE,
    PINHOLE,
    PLUMB_BOB,
    POINTS,
    RADTAN,
    RATIONAL,
    RECTIFIED,
    THIN_PRISM,
    in_world,
    opencv_pixels,
    person,
    pixels,
    points_of,
    rig,
    written,
)
from scipy.spatial.transform import Rotation

from stcalib_ros.cli import main
from stcalib_ros.core.errors import InputError
from stcalib_ros.core.geometry.lens import project
from stcalib_ros.core.model.calibration import Calibration, Status
from stcalib_ros.io.camera_info_yaml import read_camera_info_yaml
from stcalib_ros.io.exports import EXPORTS, Exported, exported_files
from stcalib_ros.io.lens_files import read_lenses
from stcalib_ros.io.npz_files import read_npz
from stcalib_ros.io.results import read_result, write_result

PX = {"rtol": 0.0, "atol": 1e-6}


@pytest.mark.parametrize("place", [lambda one: one, in_world])
def test_kalibr_has_poses_lenses_and_clocks_by_its_conventions(tmp_path: Path, place: Any) -> None:
    calibration = place(rig(RADTAN, FISHEYE, RECTIFIED))
    chain = yaml.safe_load(written(calibration, "kalibr", tmp_path / "chain.yaml").read_text())
    assert list(chain) == ["cam0", "cam1", "cam2"]
    points, before = np.c_[points_of(calibration), np.ones(30)], np.eye(4)
    for number, one in enumerate(calibration.cameras):
        entry = chain[f"cam{number}"]
        T_cam_ref = np.array(entry["T_cam_imu"])
        if number:
            np.testing.assert_allclose(np.array(entry["T_cn_cnm1"]) @ before, T_cam_ref, atol=1e-12)
        before = T_cam_ref
        fisheye = entry["distortion_model"] == "equidistant"
        assert entry["camera_model"] == "pinhole"
        assert fisheye == (number == 1)
        fx, fy, cx, cy = entry["intrinsics"]
        matrix, distortion = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]), entry
        found = opencv_pixels(
            (points @ T_cam_ref.T)[:, :3],
            np.eye(3),
            np.zeros(3),
            matrix,
            np.array(distortion["distortion_coeffs"]),
            fisheye=fisheye,
        )
        np.testing.assert_allclose(found, pixels(calibration, one), **PX)
        assert entry["timeshift_cam_imu"] == one.time_offset_s  # t_imu = t_cam + shift
        assert entry["resolution"] == [640, 480]
        assert entry["rostopic"] == f"/cam{number}/image_raw"
    assert [chain[name]["cam_overlaps"] for name in chain] == [[1], [0], []]


def test_colmap_reads_its_text_model(tmp_path: Path) -> None:
    pycolmap = pytest.importorskip("pycolmap", reason="of requirements/test.txt")
    calibration = rig(PINHOLE, RADTAN, PLUMB_BOB, RATIONAL, FISHEYE, RECTIFIED)
    folder = written(calibration, "colmap", tmp_path / "sparse", (person(),))
    model = pycolmap.Reconstruction()
    model.read_text(folder)
    assert [c.model.name for _, c in sorted(model.cameras.items())] == [
        *("PINHOLE", "OPENCV", "FULL_OPENCV", "FULL_OPENCV", "OPENCV_FISHEYE", "PINHOLE")
    ]
    for number, one in enumerate(calibration.cameras, 1):
        image = model.image(number)
        assert image.name == f"{one.name}.png"
        points_cam = image.cam_from_world() * points_of(calibration)
        found = np.asarray(model.camera(image.camera_id).img_from_cam(points_cam))
        np.testing.assert_allclose(found - 0.5, pixels(calibration, one), **PX)
    joints = person().joints_ref.reshape(-1, 3)
    joints = joints[np.isfinite(joints).all(1)]
    found = np.array([model.point3D(number + 1).xyz for number in range(len(joints))])
    assert model.num_points3D() == len(joints)
    np.testing.assert_allclose(found, joints, atol=1e-12)


@pytest.mark.parametrize("lens", [PINHOLE, PLUMB_BOB, RATIONAL, THIN_PRISM, FISHEYE, RECTIFIED])
def test_opencv_reads_its_storage(tmp_path: Path, lens: Any) -> None:
    calibration = rig(PINHOLE, lens)
    folder = written(calibration, "opencv", tmp_path / "cameras")
    for one in calibration.cameras:
        storage = cv2.FileStorage(str(folder / f"{one.name}.yml"), cv2.FILE_STORAGE_READ)
        assert storage.getNode("name").string() == one.name
        assert storage.getNode("image_width").real() == one.intrinsics.width
        assert storage.getNode("time_offset").real() == one.time_offset_s
        found = opencv_pixels(
            points_of(calibration),
            *(storage.getNode(name).mat() for name in ("R", "T", "camera_matrix")),
            storage.getNode("distortion_coefficients").mat(),
            fisheye=bool(storage.getNode("fisheye_model").real()),
        )
        np.testing.assert_allclose(found, pixels(calibration, one), **PX)
        np.testing.assert_allclose(
            cv2.Rodrigues(storage.getNode("rvec").mat())[0], storage.getNode("R").mat(), atol=1e-12
        )


def read_toml(path: Path) -> dict[str, Any]:
    tomllib = pytest.importorskip("tomllib", reason="of Python 3.11")
    loaded: dict[str, Any] = tomllib.loads(path.read_text())
    return loaded


def check_toml_camera(calibration: Calibration, number: int, table: dict[str, Any]) -> None:
    """Project as aniposelib, Pose2Sim, FreeMoCap and Caliscope do: by OpenCV."""
    one = calibration.cameras[number]
    found = opencv_pixels(
        points_of(calibration),
        cv2.Rodrigues(np.array(table["rotation"]))[0],
        np.array(table["translation"]),
        np.array(table["matrix"]),
        np.array(table["distortions"]),
        fisheye=table["fisheye"],
    )
    np.testing.assert_allclose(found, pixels(calibration, one), **PX)
    assert (table["name"], table["size"]) == (one.name, [640, 480])


def test_aniposelib_sorts_its_sections_into_the_order_of_the_cameras(tmp_path: Path) -> None:
    calibration = rig(*[PINHOLE, RADTAN, PLUMB_BOB, RATIONAL, THIN_PRISM, FISHEYE, RECTIFIED] * 2)
    tables = read_toml(written(calibration, "aniposelib", tmp_path / "calibration.toml"))
    sections = sorted(name for name in tables if name != "metadata")
    assert len(sections) == len(calibration.cameras) > 10
    assert sections == [name for name in tables if name != "metadata"]
    for number, section in enumerate(sections):
        check_toml_camera(calibration, number, tables[section])
    assert len(tables["cam_01"]["distortions"]) == 5  # FreeMoCap asks for five


def test_caliscope_numbers_its_cameras(tmp_path: Path) -> None:
    calibration = rig(PINHOLE, FISHEYE, RATIONAL)
    tables = read_toml(written(calibration, "caliscope", tmp_path / "camera_array.toml"))
    assert list(tables) == ["cameras"]
    for key, table in tables["cameras"].items():
        assert table["cam_id"] == int(key)
        check_toml_camera(calibration, int(key), table)


def test_camera_info_is_that_of_camera_info_manager(tmp_path: Path) -> None:
    folder = written(rig(PLUMB_BOB, FISHEYE), "camera_info", tmp_path / "lenses")
    for name, lens in (("cam0", PLUMB_BOB), ("cam1", FISHEYE)):
        found_name, found = read_camera_info_yaml(folder / f"{name}.yaml")
        assert (found_name, found.model) == (name, lens.model)
        np.testing.assert_array_equal(found.K, lens.K)
        np.testing.assert_array_equal(found.D, lens.D)


def test_npz_has_arrays_of_all_cameras(tmp_path: Path) -> None:
    calibration = rig(PINHOLE, THIN_PRISM, FISHEYE, RECTIFIED)
    arrays = read_npz(written(calibration, "npz", tmp_path / "cameras.npz"))
    for number, one in enumerate(calibration.cameras):
        fisheye = arrays["dist_model"][number] == "equidistant"
        found = opencv_pixels(
            points_of(calibration),
            *(arrays[name][number] for name in ("R", "t", "K")),
            arrays["dist"][number][: 4 if fisheye else None],
            fisheye=fisheye,
        )
        np.testing.assert_allclose(found, pixels(calibration, one), **PX)
        assert arrays["time_offset_s"][number] == one.time_offset_s
        np.testing.assert_array_equal(arrays["covariance"][number], one.covariance)


@pytest.mark.parametrize("place", [lambda one: one, in_world])
def test_gltf_shows_cameras_and_people(tmp_path: Path, place: Any) -> None:
    gltf = pytest.importorskip("pygltflib", reason="of requirements/test.txt")
    K = np.array([[800.0, 0.0, 320.0], [0.0, 790.0, 240.0], [0.0, 0.0, 1.0]])
    calibration = place(rig(PINHOLE, replace(PINHOLE, K=K), RADTAN))
    path = written(calibration, "gltf", tmp_path / "scene.gltf", (person(),))
    scene = gltf.GLTF2().load(str(path))
    root = scene.nodes[scene.scenes[scene.scene].nodes[0]]
    assert root.children == [0, 1, 2, 3]
    for number, one in enumerate(calibration.cameras):
        node, lens = scene.nodes[number], scene.cameras[scene.nodes[number].camera]
        assert node.name == lens.name == one.name
        R_ref_gl = Rotation.from_quat(node.rotation).as_matrix()
        x, y, z = ((points_of(calibration) - node.translation) @ R_ref_gl).T
        assert z.max() < 0.0  # it looks along -z
        f = 0.5 / np.tan(0.5 * lens.perspective.yfov)
        u = 640 * (0.5 + f / lens.perspective.aspectRatio * x / -z)
        v = 480 * (0.5 - f * y / -z)
        if number == 1:  # the others have a distortion, or another principal point
            np.testing.assert_allclose(np.stack([u, v], 1), pixels(calibration, one), **PX)
        assert lens.extras["k"] == one.intrinsics.K.ravel().tolist()
        up = Rotation.from_quat(root.rotation).apply(
            [0, 0, 1] if calibration.frame_id else [0, -1, 0]
        )
        np.testing.assert_allclose(up, [0, 1, 0], atol=1e-12)
    (lines,) = scene.meshes[scene.nodes[3].mesh].primitives
    accessor = scene.accessors[lines.attributes.POSITION]
    data = scene.get_data_from_buffer_uri(scene.buffers[0].uri)
    ends = np.frombuffer(data, "<f4").reshape(-1, 3)
    assert len(ends) == accessor.count > 100
    joints = person().joints_ref.reshape(-1, 3)
    nearest = np.abs(ends[:, None] - joints[None]).max(-1)
    assert np.nanmin(nearest, axis=1).max() < 1e-6
    np.testing.assert_array_equal(accessor.max, ends.max(0))


@pytest.mark.parametrize("form", ["kalibr", "colmap", "opencv", "aniposelib", "caliscope", "npz"])
def test_lenses_are_read_back_by_us(tmp_path: Path, form: str) -> None:
    calibration = rig(PINHOLE, RADTAN, FISHEYE)
    name = f"out{next(iter(EXPORTS[form].endings), '')}"
    found = read_lenses(written(calibration, form, tmp_path / name))
    for one in calibration.cameras:
        expected = project(POINTS, one.intrinsics)
        np.testing.assert_allclose(project(POINTS, found[one.name]), expected, **PX)


def test_gltf_without_people_has_no_mesh(tmp_path: Path) -> None:
    content = json.loads(written(rig(PINHOLE, PINHOLE), "gltf", tmp_path / "a.gltf").read_text())
    assert {"meshes", "buffers", "accessors"} & set(content) == set()


@pytest.mark.parametrize(
    ("form", "name", "lens"),
    [
        *(("kalibr", "a.yaml", lens) for lens in (PLUMB_BOB, RATIONAL, THIN_PRISM)),
        ("colmap", "a", THIN_PRISM),
    ],
)
def test_a_lens_that_a_format_cannot_hold_is_refused_with_formats_that_can(
    tmp_path: Path, form: str, name: str, lens: Any
) -> None:
    with pytest.raises(InputError, match=rf"camera cam1: {form} has \d distortion .* npz") as no:
        written(rig(PINHOLE, lens), form, tmp_path / name)
    for other in str(no.value).rpartition(": ")[2].split(", "):
        ending = EXPORTS[other].endings[0] if EXPORTS[other].endings else ""
        written(rig(PINHOLE, lens), other, tmp_path / f"{other}{ending}")


@pytest.mark.parametrize(
    ("change", "form", "name", "message"),
    [
        ({"metric": False}, "urdf", "a.urdf", "urdf has lengths in metres"),
        ({"metric": False}, "launch", "a.xml", "launch has lengths in metres"),
        ({}, "kalibr", "a.json", r"ends in \.yaml or \.yml"),
        ({"frame_id": "${1 / 0}"}, "urdf", "a.xacro", r"frame '\$\{1 / 0\}'"),
        ({"frame_id": '"""'}, "launch", "a.py", "frame"),
    ],
)
def test_what_cannot_be_exported_is_said(
    tmp_path: Path, change: dict[str, Any], form: str, name: str, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        written(replace(rig(PINHOLE, PINHOLE), **change), form, tmp_path / name)


def test_names_that_files_cannot_hold_are_refused(tmp_path: Path) -> None:
    first, second = rig(PINHOLE, PINHOLE).cameras
    for changed, form, message in (
        (replace(second, name="my cam"), "colmap", "names of COLMAP have no spaces"),
        (replace(second, name="cam?"), "opencv", "cameras cam!, cam. would have one file"),
        (replace(second, frame_id=first.frame_id), "urdf", "more than one camera has it"),
    ):
        cameras = (replace(first, name="cam!"), changed)
        with pytest.raises(InputError, match=message):
            exported_files(
                Exported(replace(rig(PINHOLE, PINHOLE), cameras=cameras, reference="cam!")),
                EXPORTS[form],
                tmp_path / f"a{next(iter(EXPORTS[form].endings), '')}",
            )


def test_texts_of_any_name_are_read_back(tmp_path: Path) -> None:
    name = 'l\u00e4nger "quoted" #1 \\ {x: 1}'
    first, second = rig(PINHOLE, PINHOLE).cameras
    calibration = replace(rig(PINHOLE, PINHOLE), cameras=(first, replace(second, name=name)))
    tables = read_toml(written(calibration, "aniposelib", tmp_path / "a.toml"))
    assert tables["cam_1"]["name"] == name
    chain = yaml.safe_load(written(calibration, "kalibr", tmp_path / "a.yaml").read_text())
    assert chain["cam1"]["rostopic"] == f"/{name}/image_raw"
    (path,) = (
        p for p in written(calibration, "opencv", tmp_path / "a").iterdir() if p.stem != "cam0"
    )
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    assert storage.getNode("name").string() == name


@pytest.mark.parametrize("form", EXPORTS.values(), ids=lambda form: form.name)
def test_the_command_writes_every_format(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], form: Any
) -> None:
    write_result(rig(PINHOLE, RADTAN), tmp_path / "walk.yaml")
    output = tmp_path / f"out{form.endings[0] if form.endings else ''}"
    command = ["export", str(tmp_path / "walk.yaml"), "--format", form.name, "-o", str(output)]
    assert main(command) == 0
    assert main(command) == 0  # what is there is replaced
    assert main([*command[:-1], str(output.with_name(output.name.upper()))]) == 0
    assert capsys.readouterr().out.startswith(f"Written to {output}: 2 cameras (metres)")
    assert output.is_dir() == (not form.endings)
    if form.name == "stcalib":
        assert [one.name for one in read_result(output).cameras] == ["cam0", "cam1"]


def test_the_command_says_what_is_wrong_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    result, file, refused = (tmp_path / name for name in ("walk.yaml", "file", "walk.no.yaml"))
    write_result(rig(PINHOLE, PLUMB_BOB), result)
    write_result(replace(rig(PINHOLE, PINHOLE), status=Status.DEGENERATE), refused)
    file.touch()
    for arguments in (
        [str(result), "-f", "kalibr", "-o", str(tmp_path / "a.yaml")],
        [str(result), "-f", "npz", "-o", str(tmp_path / "absent" / "a.npz")],
        [str(result), "-f", "opencv", "-o", str(file)],
        [str(tmp_path / "absent.yaml"), "-f", "npz", "-o", "a.npz"],
        [str(file), "-f", "npz", "-o", "a.npz"],
        [str(refused), "-f", "npz", "-o", str(tmp_path / "a.npz")],
    ):
        assert main(["export", *arguments]) == (3 if arguments[0] == str(refused) else 2)
        error = capsys.readouterr().err
        assert error.startswith("stcalib: ")
        assert error.count("\n") == 1
    assert sorted(tmp_path.iterdir()) == [file, refused, result]
    assert read_result(result).reference == "cam0"


def test_every_format_has_its_row_in_the_documentation() -> None:
    text = (Path(__file__).parents[3] / "docs" / "formats.md").read_text()
    commands = re.findall(
        r"`stcalib export walk\.yaml --format (\w+) --output (\S+)(?: --bag walk\.mcap)?`", text
    )
    assert {name for name, _ in commands} == set(EXPORTS) - {"stcalib"}
    for name, output in commands:
        assert not EXPORTS[name].endings or Path(output).suffix in EXPORTS[name].endings
