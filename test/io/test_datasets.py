"""Small files in the layouts of other people's data sets, and what becomes of them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stcalib_ros.cli import main
from stcalib_ros.core.errors import InputError
from stcalib_ros.core.evaluation.metrics import evaluate
from stcalib_ros.core.model.keypoint_layouts import LAYOUTS
from stcalib_ros.io.bag import read_bag
from stcalib_ros.io.convert import Converted, convert_arrays
from stcalib_ros.io.convert_options import ConvertOptions
from stcalib_ros.io.datasets import DatasetOptions, read_dataset
from stcalib_ros.io.datasets.alphapose import detected_keypoints, h36m_keypoints
from stcalib_ros.io.results import read_result

K = np.array([[900.0, 0, 320], [0, 900.0, 180], [0, 0, 1]])
R = Rotation.from_euler("yxz", [[0.02, 0.03, 0.1], [-1.55, 0.02, -0.1]]).as_matrix()
CENTRES = np.array([[0.1, -0.1, -6.0], [-5.5, 0.2, -0.1]])
T = -np.einsum("cij,cj->ci", R, CENTRES)
SIZE = (640, 360)


def bodies(n_joints: int, n_frames: int = 3) -> np.ndarray:
    """Two people (F, 2, J, 3) near the middle of the two views, metres."""
    rng = np.random.default_rng(0)
    shape = rng.uniform(-0.2, 0.2, (2, n_joints, 3)) + np.array([[[-0.3, 0, 0]], [[0.3, 0, 0]]])
    return shape + 0.002 * np.arange(n_frames)[:, None, None, None]


def in_image(points: np.ndarray, c: int) -> np.ndarray:
    x = points @ R[c].T + T[c]
    return x[..., :2] / x[..., 2:] * 900.0 + K[:2, 2]


def panoptic(folder: Path, n_frames: int = 3) -> Path:
    def camera(name: str, kind: str, c: int) -> dict[str, Any]:
        return {
            "name": name,
            "type": kind,
            "resolution": list(SIZE),
            "K": K.tolist(),
            "distCoef": [0.0] * 5,
            "R": R[c].tolist(),
            "t": (100 * T[c])[:, None].tolist(),
        }

    folder.mkdir()
    cameras = [camera("01_01", "vga", 0), camera("00_03", "hd", 0), camera("00_12", "hd", 1)]
    (folder / "calibration_x.json").write_text(json.dumps({"cameras": cameras}))
    (folder / "hdPose3d_stage1_coco19").mkdir()
    for f, people in enumerate(bodies(19, n_frames)):
        joints = np.concatenate([100 * people, np.ones((2, 19, 1))], -1)
        joints[0, 4, 3] = -1.0
        found = [{"id": 7 + 2 * p, "joints19": joints[p].ravel().tolist()} for p in (1, 0)]
        file = folder / "hdPose3d_stage1_coco19" / f"body3DScene_{100 + f:08d}.json"
        file.write_text(json.dumps({"version": 0.7, "bodies": found}))
    return folder


def easymocap(folder: Path) -> Path:
    folder.mkdir()
    intri = cv2.FileStorage(str(folder / "intri.yml"), cv2.FILE_STORAGE_WRITE)
    extri = cv2.FileStorage(str(folder / "extri.yml"), cv2.FILE_STORAGE_WRITE)
    for storage in (intri, extri):
        storage.startWriteStruct("names", cv2.FileNode_SEQ)
        for name in ("1", "3"):
            storage.write("", name)
        storage.endWriteStruct()
    for c, name in enumerate(("1", "3")):
        intri.write(f"K_{name}", K)
        intri.write(f"dist_{name}", np.array([[0.1, -0.02, 0.001, 0.0, 0.0]]))
        extri.write(f"R_{name}", cv2.Rodrigues(R[c])[0])
        extri.write(f"Rot_{name}", R[c])
        extri.write(f"T_{name}", T[c][:, None])
        (folder / "annots" / name).mkdir(parents=True)
    intri.release()
    extri.release()
    (folder / "output" / "keypoints3d").mkdir(parents=True)
    for f, people in enumerate(bodies(25)):
        found = [
            {"id": p, "keypoints3d": np.c_[people[p], np.full(25, 0.9)].tolist()} for p in (0, 1)
        ]
        (folder / "output" / "keypoints3d" / f"{f:06d}.json").write_text(json.dumps(found))
        for name in ("1", "3"):
            annots = {"filename": "x", "height": SIZE[1], "width": SIZE[0], "annots": []}
            (folder / "annots" / name / f"{f:06d}.json").write_text(json.dumps(annots))
    return folder


def mmptrack(root: Path) -> Path:
    scene = root / "labels" / "64pm" / "lobby_3"
    scene.mkdir(parents=True)
    calibration = root / "calibrations" / "lobby"
    calibration.mkdir(parents=True)
    cameras = [
        {
            "CameraId": c + 1,
            "IntrinsicParameters": {"Fx": 900.0, "Fy": 900.0, "Cx": 320.0, "Cy": 180.0, "Skew": 0},
            "ExtrinsicParameters": {
                "Rotation": R[c].T.ravel().tolist(),
                "Translation": (1000 * CENTRES[c]).tolist(),
            },
        }
        for c in range(2)
    ]
    (calibration / "calibrations.json").write_text(json.dumps({"Cameras": cameras, "Space": {}}))
    for f, people in enumerate(bodies(17)):
        for c in range(2):
            pixels = in_image(people, c)
            boxes = {
                str(3 + p): [*pixels[p].min(0).tolist(), *pixels[p].max(0).tolist()] for p in (0, 1)
            }
            (scene / f"rgb_{f:05d}_{c + 1}.json").write_text(json.dumps(boxes))
    return scene


def alphapose(
    folder: Path, names: tuple[str, str], people: np.ndarray, first: int = 0, *, lifted: bool = True
) -> Path:
    """AlphaPose and MotionBERT on two cameras; ids 1 and 2, exchanged in the second camera."""
    halpe = np.zeros((*people.shape[:2], 26, 3))
    for joint, source in _HALPE_OF_H36M.items():
        halpe[:, :, source] = people[:, :, joint]
    for c, name in enumerate(names):
        (folder / name).mkdir(parents=True)
        items = []
        for f in range(len(people)):
            for p in (0, 1):
                flat = np.c_[in_image(halpe[f, p], c), np.full(26, 0.8)].ravel().tolist()
                items.append(
                    {
                        "image_id": f"{first + f}.jpg",
                        "category_id": 1,
                        "keypoints": flat,
                        "score": 2.5,
                        "box": [0, 0, 1, 1],
                        "idx": [1 + (p + c) % 2],
                    }
                )
        (folder / name / "alphapose-results.json").write_text(json.dumps(items))
        for p in (0, 1) if lifted else ():
            track = folder / name / str(1 + (p + c) % 2)
            track.mkdir()
            np.save(track / "X3D.npy", (people[:, p] @ R[c].T).astype(np.float32))
    return folder


_HALPE_OF_H36M = {
    0: 19,
    1: 12,
    2: 14,
    3: 16,
    4: 11,
    5: 13,
    6: 15,
    8: 18,
    9: 0,
    10: 17,
    11: 5,
    12: 7,
    13: 9,
    14: 6,
    15: 8,
    16: 10,
}


def converted(name: str, path: Path, fps: float | None = None, **options: Any) -> Converted:
    arrays = read_dataset(name, path, DatasetOptions(**options))
    return convert_arrays(path, arrays, ConvertOptions(fps=fps))


def assert_true_cameras(result: Converted) -> None:
    cameras = result.truth.cameras
    np.testing.assert_allclose(cameras[1].R_ref_cam, R[0] @ R[1].T, atol=1e-9)
    np.testing.assert_allclose(cameras[1].t_ref_cam, R[0] @ (CENTRES[1] - CENTRES[0]), atol=1e-9)
    np.testing.assert_allclose(cameras[0].intrinsics.K, K)
    assert (cameras[1].intrinsics.width, cameras[1].intrinsics.height) == SIZE


def test_panoptic_in_metres_and_camera_frames(tmp_path: Path) -> None:
    result = converted("panoptic", panoptic(tmp_path / "x"), cameras=("3", "12"), sigma_px=0.0)
    assert_true_cameras(result)
    first, second = result.recording.cameras
    assert [first.name, second.name] == ["00_03", "00_12"]
    assert first.layout is LAYOUTS["coco_19"]
    assert first.metric
    np.testing.assert_allclose(np.diff(first.stamps), 1 / 29.97)
    for c, camera in enumerate((first, second)):
        track = camera.tracks[0]
        expected = bodies(19)[:, 0]
        np.testing.assert_allclose(track.joints[:, 5], (expected @ R[c].T + T[c])[:, 5], atol=1e-9)
        np.testing.assert_allclose(track.keypoints[:, 5], in_image(expected, c)[:, 5], atol=1e-6)
        assert np.isnan(track.joints[:, 4]).all(), "a joint without confidence is unknown"
    assert [p.tracks for p in result.truth.persons] == [
        {"00_03": (0,), "00_12": (0,)},
        {"00_03": (1,), "00_12": (1,)},
    ]


def test_noise_has_the_size_that_is_asked_for(tmp_path: Path) -> None:
    folder = panoptic(tmp_path / "x", n_frames=40)
    clean, noisy = (
        converted("panoptic", folder, sigma_px=s).recording.cameras[1].tracks for s in (0.0, 4.0)
    )
    off = np.concatenate([b.keypoints - a.keypoints for a, b in zip(clean, noisy, strict=True)])
    assert np.nanstd(off) == pytest.approx(4.0, rel=0.1)


def test_frames_by_the_numbers_of_the_data_set(tmp_path: Path) -> None:
    result = converted("panoptic", panoptic(tmp_path / "x"), first=101, last=102)
    assert len(result.recording.cameras[0].stamps) == 2


def test_easymocap(tmp_path: Path) -> None:
    result = converted("easymocap", easymocap(tmp_path / "x"), fps=50.0, sigma_px=0.0)
    assert_true_cameras(result)
    camera = result.recording.cameras[1]
    assert camera.name == "3"
    assert camera.layout is LAYOUTS["body_25"]
    np.testing.assert_allclose(camera.intrinsics.D[:3], [0.1, -0.02, 0.001])
    np.testing.assert_allclose(camera.tracks[1].joints, bodies(25)[:, 1] @ R[1].T + T[1], atol=1e-9)


def test_mmptrack_with_alphapose_and_motionbert(tmp_path: Path) -> None:
    poses = alphapose(tmp_path / "poses", ("cam1", "cam2"), bodies(17))
    result = converted("mmptrack", mmptrack(tmp_path), fps=15.0, poses=poses)
    assert_true_cameras(result)
    first, second = result.recording.cameras
    assert not first.metric
    assert first.layout is LAYOUTS["h36m_17"]
    assert [p.tracks for p in result.truth.persons] == [
        {"cam1": (1,), "cam2": (2,)},
        {"cam1": (2,), "cam2": (1,)},
    ]
    track = second.tracks[1]
    direct = [j for j in range(17) if j != 7]
    np.testing.assert_allclose(
        track.keypoints[:, direct], in_image(bodies(17)[:, 0], 1)[:, direct], atol=1e-6
    )
    np.testing.assert_allclose(track.joints, bodies(17)[:, 0] @ R[1].T, atol=1e-6)
    assert track.scores.max() == pytest.approx(0.8)


def test_alphapose_alone(tmp_path: Path) -> None:
    poses = alphapose(tmp_path / "poses", ("cam1", "cam2"), bodies(17), lifted=False)
    result = converted("mmptrack", mmptrack(tmp_path), fps=15.0, poses=poses)
    assert [p.tracks for p in result.truth.persons] == [
        {"cam1": (1,), "cam2": (2,)},
        {"cam1": (2,), "cam2": (1,)},
    ]
    for camera in result.recording.cameras:
        assert camera.layout is LAYOUTS["halpe_26"]
        assert not camera.has_3d_poses
    track = result.recording.cameras[1].tracks[1]
    for joint, own in _HALPE_OF_H36M.items():
        expected = in_image(bodies(17)[:, 0, joint], 1)
        np.testing.assert_allclose(track.keypoints[:, own], expected, atol=1e-6)


def test_true_poses_tell_who_a_keypoint_is(tmp_path: Path) -> None:
    people = np.zeros((3, 2, 17, 3))
    names = LAYOUTS["coco_19"].joint_names
    for j, name in enumerate(LAYOUTS["h36m_17"].joint_names):
        people[:, :, j] = bodies(19)[:, :, names.index(name) if name in names else 2]
    poses = alphapose(tmp_path / "poses", ("00_03", "00_12"), people, first=100, lifted=False)
    result = converted("panoptic", panoptic(tmp_path / "x"), poses=poses)
    assert [p.tracks for p in result.truth.persons] == [
        {"00_03": (1,), "00_12": (2,)},
        {"00_03": (2,), "00_12": (1,)},
    ]


def test_whole_bodies_of_alphapose_give_their_bodies() -> None:
    given = np.c_[np.arange(136), np.arange(136), np.full(136, 1.5)]
    layout, keypoints = detected_keypoints(given.ravel().tolist())
    assert layout is LAYOUTS["halpe_26"]
    np.testing.assert_array_equal(keypoints, np.c_[given[:26, :2], np.ones(26)])


def test_cameras_with_different_keypoints_are_refused(tmp_path: Path) -> None:
    poses = alphapose(tmp_path / "poses", ("cam1", "cam2"), bodies(17), lifted=False)
    path = poses / "cam2" / "alphapose-results.json"
    items = json.loads(path.read_text())
    coco = [item | {"keypoints": item["keypoints"][: 3 * 17]} for item in items]
    path.write_text(json.dumps(coco))
    with pytest.raises(InputError, match="poses of halpe_26 and coco_17: run one model on all"):
        converted("mmptrack", mmptrack(tmp_path), fps=15.0, poses=poses)
    path.write_text(json.dumps([item | {"keypoints": [1.0] * 60} for item in items]))
    with pytest.raises(InputError, match="20 keypoints: expected COCO's 17 or Halpe's 26 or 136"):
        converted("mmptrack", mmptrack(tmp_path / "m"), fps=15.0, poses=poses)


def test_true_poses_tell_who_a_detection_is(tmp_path: Path) -> None:
    names = LAYOUTS["coco_19"].joint_names
    people = np.zeros((3, 2, 17, 3))
    for j, name in enumerate(LAYOUTS["h36m_17"].joint_names):
        known = name in names
        people[:, :, j] = bodies(19)[:, :, names.index(name) if known else 2]
    poses = alphapose(tmp_path / "poses", ("00_03", "00_12"), people, first=100)
    result = converted("panoptic", panoptic(tmp_path / "x"), poses=poses)
    assert [p.tracks for p in result.truth.persons] == [
        {"00_03": (1,), "00_12": (2,)},
        {"00_03": (2,), "00_12": (1,)},
    ]


def test_coco_keypoints_become_human36m() -> None:
    given = np.c_[np.arange(17), 10 * np.arange(17), np.full(17, 0.5)]
    given[12, 2] = 0.2
    found = h36m_keypoints(given.ravel().tolist())
    np.testing.assert_allclose(found[0], [11.5, 115, 0.2])
    np.testing.assert_allclose(found[8], [5.5, 55, 0.5])
    np.testing.assert_allclose(found[13], [9, 90, 0.5])


def test_command_writes_bag_and_truth(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, truth = tmp_path / "o.mcap", tmp_path / "t.yaml"
    arguments = ["convert", str(panoptic(tmp_path / "x")), str(out), "--format", "panoptic"]
    arguments += ["--cameras", "12,3", "--frames", "100:101", "--truth", str(truth)]
    assert main([*arguments, "--offset", "00_03=0.2"]) == 0
    recording, true = read_bag(out), read_result(truth)
    assert {len(c.stamps) for c in recording.cameras} == {2}
    assert [c.name for c in true.cameras] == ["00_12", "00_03"]
    assert evaluate(true, true).E_R == 0.0
    assert true.cameras[1].time_offset_s == pytest.approx(-0.2)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda folder: (folder / "calibration_x.json").unlink(), "no calibration_"),
        (lambda folder: (folder / "calibration_x.json").write_text("{"), "not valid JSON"),
        (
            lambda folder: (folder / "calibration_x.json").write_text("{}"),
            "not a Panoptic sequence",
        ),
    ],
)
def test_bad_panoptic(tmp_path: Path, change: Any, message: str) -> None:
    folder = panoptic(tmp_path / "x")
    change(folder)
    with pytest.raises(InputError, match=message):
        read_dataset("panoptic", folder, DatasetOptions())


def test_errors_name_what_is_missing(tmp_path: Path) -> None:
    folder = panoptic(tmp_path / "x")
    with pytest.raises(InputError, match="no camera 5: there are 00_03, 00_12"):
        read_dataset("panoptic", folder, DatasetOptions(cameras=("5",)))
    with pytest.raises(InputError, match="wanted frame number"):
        read_dataset("panoptic", folder, DatasetOptions(first=500))
    with pytest.raises(InputError, match="--poses"):
        read_dataset("mmptrack", mmptrack(tmp_path / "m"), DatasetOptions())
    poses = alphapose(tmp_path / "poses", ("00_03", "00_12"), bodies(17), first=100)
    (poses / "00_12" / "2" / "X3D.npy").unlink()
    with pytest.raises(InputError, match="--focus 2"):
        read_dataset("panoptic", folder, DatasetOptions(poses=poses))
    np.save(poses / "00_12" / "2" / "X3D.npy", np.zeros((2, 17, 3)))
    with pytest.raises(InputError, match="one pose for every appearance"):
        read_dataset("panoptic", folder, DatasetOptions(poses=poses))


@pytest.mark.parametrize(
    ("option", "message"),
    [
        (["--sigma-px", "1"], "--sigma-px is for data sets, but x.npz is read as npz"),
        (["--cameras", "1"], "--cameras is for other formats, but x.npz is read as npz"),
    ],
)
def test_options_of_other_formats_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], option: list[str], message: str
) -> None:
    out = str(tmp_path / "o.mcap")
    assert main(["convert", "x.npz", out, "--format", "npz", *option]) == 2
    assert message in capsys.readouterr().err
