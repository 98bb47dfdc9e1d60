"""Every door by which files come in takes or refuses mutants, and does no more; bounded in time.

`STCALIB_FUZZ_S=600` attacks each for ten minutes. What is found is kept in test/corpus.
"""

from __future__ import annotations

import io
import json
import random
import zipfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from fuzzing import attack, both, corpus, of_bytes, of_tree, taken, to_json

from stcalib_ros.core.evaluation.metrics import evaluate
from stcalib_ros.core.model.keypoint_layouts import LAYOUTS
from stcalib_ros.core.model.lens_knowledge import LensKnowledge, LensStddev
from stcalib_ros.core.synthetic import SceneOptions, simulate
from stcalib_ros.io import npz_files
from stcalib_ros.io.bag import read_bag
from stcalib_ros.io.bag_writer import write_bag
from stcalib_ros.io.camera_info_yaml import camera_info_text, read_camera_info_yaml
from stcalib_ros.io.config import read_config
from stcalib_ros.io.convert import convert_npz
from stcalib_ros.io.datasets import DatasetOptions, read_dataset
from stcalib_ros.io.datasets.opencv_storage import OpencvStorage
from stcalib_ros.io.lens_files import read_lenses
from stcalib_ros.io.plausible import require_lens
from stcalib_ros.io.results import read_result, result_text, write_result
from stcalib_ros.io.rigs import read_rig
from stcalib_ros.io.stamps import corrections_of
from stcalib_ros.ros.parameter_specs import CAMERAS, all_specs
from stcalib_ros.ros.parameters import settings_from

ROOT = Path(__file__).parents[2]
Folder = Path

SIMULATED = simulate(SceneOptions(n_cameras=3, n_people=2, n_frames=4)).truth
ESTIMATED = replace(
    SIMULATED.cameras[1],
    lens_knowledge=LensKnowledge.UNKNOWN,
    lens_stddev=LensStddev(2.0, 3.0, 4.0, (0.01,)),
)
TRUTH = replace(SIMULATED, cameras=(SIMULATED.cameras[0], ESTIMATED, SIMULATED.cameras[2]))
CONFIG = ROOT / "config" / "calibrate.yaml"
LENS_ENTRY = {"intrinsics": "refine", "field_of_view_deg": 90, "image_size": [640, 480]}
CAMERA_ENTRY = {
    "cam0": {"pose_topic": "/a", "info_topic": "/b", "line_time_s": 1e-5, "lens_group": "x"},
    "cam1": {**LENS_ENTRY, "lens_group": "x"},
}
DISTANCES = "[{cameras: [cam0, cam1], metres: 3.42, sigma_m: 0.01}]"
OPENCV = """%YAML:1.0
---
names:
   - "1"
K_1: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 900., 0., 320., 0., 900., 180., 0., 0., 1. ]
dist_1: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ 1.0000000000000001e-01, -2.0e-02, .Nan, 0., 0. ]
"""


def result(folder: Folder) -> Callable[[bytes], object]:
    def door(data: bytes) -> object:
        (folder / "r.yaml").write_bytes(data)
        read = read_result(folder / "r.yaml")
        corrections_of(read)
        result_text(read)
        return evaluate(read, TRUTH, fps=30.0)

    return door


def config(folder: Folder) -> Callable[[bytes], object]:
    def door(data: bytes) -> object:
        (folder / "c.yaml").write_bytes(data)
        return read_config(folder / "c.yaml")

    return door


def camera_info(folder: Folder) -> Callable[[bytes], object]:
    def door(data: bytes) -> object:
        (folder / "c.yaml").write_bytes(data)
        name, lens = read_camera_info_yaml(folder / "c.yaml")
        again = replace(TRUTH.cameras[0], name=name, intrinsics=lens)
        return camera_info_text(again)

    return door


def parameter(_: Folder) -> Callable[[bytes], object]:
    names = ("cam0", "cam1")
    values = {CAMERAS.name: list(names)} | {s.name: s.default for s in all_specs(names)}

    def door(data: bytes) -> object:
        changed = {"scale.distances": data.decode(errors="replace")}
        return settings_from(values | changed, node_name="/calibrator")

    return door


def npz(folder: Folder) -> Callable[[bytes], object]:
    def door(data: bytes) -> object:
        (folder / "s.npz").write_bytes(data)
        recording, truth = convert_npz(folder / "s.npz")
        write_bag(recording, folder / "o.mcap")
        write_result(truth, folder / "o.yaml")
        read_result(folder / "o.yaml")
        return read_bag(folder / "o.mcap", warn=lambda _: None)

    return door


def opencv(folder: Folder) -> Callable[[bytes], object]:
    def door(data: bytes) -> object:
        (folder / "intri.yml").write_bytes(data)
        (folder / "extri.yml").write_text(OPENCV)
        storage = OpencvStorage(folder / "intri.yml")
        assert all(isinstance(name, str) for name in opencv_values(storage))
        return read_dataset("easymocap", folder, DatasetOptions())

    return door


def lens_file(folder: Folder) -> Callable[[bytes], object]:
    def door(data: bytes) -> object:
        (folder / "lenses.txt").write_bytes(data)
        lenses = read_lenses(folder / "lenses.txt", image_size=(640, 480))
        for lens in lenses.values():
            if lens.known:
                require_lens(lens, "lens")
        return lenses

    return door


LENSES = (
    """
[cam_0]
name = "A"
size = [ 640, 480,]
matrix = [ [ 800.0, 0.0, 320.0,], [ 0.0, 800.0, 240.0,], [ 0.0, 0.0, 1.0,],]
distortions = [ 0.1, -0.2, 0.001, 0.0, 0.0,]
fisheye = false
""",
    """
cam0:
  camera_model: pinhole
  distortion_coeffs: [0.1, -0.2, 0.001, 0.0]
  distortion_model: radtan
  intrinsics: [800.0, 800.0, 320.0, 240.0]
  resolution: [640, 480]
  rostopic: /a/image_raw
""",
    "# a\n1 OPENCV 640 480 800.0 800.0 320.0 240.0 0.1 -0.2 0.001 0\n2 PINHOLE 640 480 8 8 3 2\n",
    """<?xml version="1.0"?>
<opencv_storage>
<K type_id="opencv-matrix"><rows>3</rows><cols>3</cols><dt>d</dt>
<data>800. 0. 320. 0. 800. 240. 0. 0. 1.</data></K>
<image_size>640 480</image_size>
</opencv_storage>
""",
    OPENCV,
)


def opencv_values(storage: OpencvStorage) -> list[str]:
    try:
        storage.matrix("K_1")
        storage.number("W_1")
        return storage.names("names")
    except (KeyError, TypeError, ValueError, OverflowError):
        return []


PANOPTIC = {
    "cameras": [
        {
            "name": f"00_0{c}",
            "type": "hd",
            "resolution": [640, 360],
            "K": [[900.0, 0, 320], [0, 900, 180], [0, 0, 1]],
            "distCoef": [0.1, 0, 0, 0, 0],
            "R": np.eye(3).tolist(),
            "t": [[0.0], [0.0], [300.0 + c]],
        }
        for c in range(2)
    ]
}
BODIES = {"bodies": [{"id": 7, "joints19": np.tile([10.0, 20, 50, 1], 19).tolist()}]}
RIG = {
    "cameras": [
        {
            "name": "a",
            "image_size": [640, 360],
            "K": np.diag([900.0, 900, 1]).tolist(),
            "dist": [0.1],
            "R": np.eye(3).tolist(),
            "t": [0, 0, 3],
        }
    ]
}


def rig_or_data_set(folder: Folder) -> Callable[[bytes], object]:
    """Each mutant as the JSON file of a rig, of cameras, of poses."""
    poses = folder / "hdPose3d_stage1_coco19"
    poses.mkdir(exist_ok=True)
    cameras, bodies = folder / "calibration_x.json", poses / "body3DScene_00000001.json"

    def door(data: bytes) -> object:
        cameras.write_text(to_json(PANOPTIC))
        bodies.write_text(to_json(BODIES))
        kind = 0 if b"joints19" in data else 1 if b"distCoef" in data else 2
        path = (bodies, cameras, folder / "rig.json")[kind]
        path.write_bytes(data)
        if kind == 2:
            return read_rig(path)
        return read_dataset("panoptic", folder, DatasetOptions())

    return door


def archive(**changes: Any) -> bytes:
    n, names = 12, LAYOUTS["h36m_17"].joint_names
    rng = np.random.default_rng(0)
    arrays = {
        "camera_names": np.array(["a", "b"]),
        "image_size": np.array([[640, 480]] * 2),
        "K": np.tile([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]], (2, 1, 1)),
        "dist": np.zeros((2, 5)),
        "R": np.tile(np.eye(3), (2, 1, 1)),
        "t": np.array([[0.0, 0, 3], [1, 0, 3]]),
        "fps": np.array(20.0),
        "frame_number": np.arange(n // 2),
        "det_frame": np.arange(n) // 2,
        "det_camera": np.arange(n) % 2,
        "det_track": np.zeros(n, int),
        "det_person": np.zeros(n, int),
        "det_kp2d": rng.uniform(1, 400, (n, 17, 3)),
        "kp_names": np.array(names),
        "det_kp3d": rng.normal(size=(n, 17, 3)),
        "kp3d_names": np.array(names),
    } | changes
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)
    return stream.getvalue()


CHANGES: tuple[Callable[[Any], Any], ...] = (
    *(lambda a: np.full(a.shape, np.nan), lambda a: np.full(a.shape, 1e300), lambda a: a[:1]),
    *(
        lambda a: a[..., None],
        lambda a: np.zeros(0),
        lambda a: np.array(3),
        lambda a: np.array("x"),
    ),
    *(lambda a: a.astype("U"), lambda a: a.astype("S"), lambda a: np.full(a.shape, 2**62)),
    *(lambda a: np.zeros(a.shape, "M8[s]"), lambda a: np.zeros(a.shape, [("a", "f8")])),
    *(lambda a: a.astype(complex), lambda a: -a, lambda a: a.astype("f2"), lambda a: a[::-1]),
    *(lambda a: np.array(["\x1b\n\0"] * len(a)), lambda a: a.astype(bool), lambda a: a + 0.5),
)


def of_arrays(rng: random.Random) -> Iterator[bytes]:
    with np.load(io.BytesIO(archive())) as given:
        arrays = dict(given)
    while True:
        names = rng.sample(sorted(arrays), rng.choice([1, 1, 2]))
        with np.errstate(all="ignore"), suppress(TypeError, ValueError, IndexError):
            changes = {name: rng.choice(CHANGES)(arrays[name]) for name in names}
            yield archive(**changes)


def mutants(name: str, rng: random.Random) -> Iterator[bytes]:
    if name == "npz":
        return both(of_arrays(rng), of_bytes([archive()], rng))
    if name == "json":
        trees = [of_tree(tree, to_json, rng) for tree in (PANOPTIC, BODIES, RIG)]
        texts = [to_json(tree).encode() for tree in (PANOPTIC, BODIES, RIG)]
        return both(both(trees[0], both(trees[1], trees[2])), of_bytes(texts, rng))
    if name == "lenses":
        return of_bytes([text.encode() for text in LENSES], rng)
    if name == "opencv":
        return of_bytes([OPENCV.encode()], rng)
    tree: Any = {"distances": yaml.safe_load(DISTANCES)}
    seeds = [DISTANCES.encode()]
    if name == "result":
        seeds = [result_text(TRUTH).encode()]
        tree = yaml.safe_load(seeds[0])
    elif name == "camera_info":
        seeds = [camera_info_text(TRUTH.cameras[0]).encode()]
        tree = yaml.safe_load(seeds[0])
    elif name == "config":
        tree = yaml.safe_load(CONFIG.read_text()) | {"cameras": ["a"], "camera": CAMERA_ENTRY}
        seeds = [CONFIG.read_bytes(), yaml.safe_dump(tree).encode()]
    return both(of_tree(tree, yaml.safe_dump, rng), of_bytes(seeds, rng))


DOORS = {
    "result": result,
    "config": config,
    "camera_info": camera_info,
    "parameter": parameter,
    "npz": npz,
    "json": rig_or_data_set,
    "opencv": opencv,
    "lenses": lens_file,
}


@pytest.mark.parametrize("name", DOORS)
def test_mutants(tmp_path: Path, name: str) -> None:
    (tmp_path / "door").mkdir()
    door = DOORS[name](tmp_path / "door")
    attack(door, mutants(name, random.Random(len(name))), tmp_path / "mutant")


@pytest.mark.parametrize(("name", "path"), [(n, p) for n in DOORS for p in corpus(n)])
def test_what_once_did_harm(tmp_path: Path, name: str, path: Path) -> None:
    """By the begin of its name, a file of the corpus is taken or refused."""
    found = taken(DOORS[name](tmp_path), path.read_bytes())
    assert found == path.name.startswith("taken"), path.name


def test_unpacked_sizes_are_looked_at_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    door, good = npz(tmp_path), archive()
    unpacked = sum(member.file_size for member in zipfile.ZipFile(io.BytesIO(good)).infolist())
    monkeypatch.setattr(npz_files, "MAX_NPZ_BYTES", unpacked)
    assert taken(door, good)
    monkeypatch.setattr(npz_files, "MAX_NPZ_BYTES", unpacked - 1)
    assert not taken(door, good)


def test_the_doors_take_what_is_good(tmp_path: Path) -> None:
    good = {
        "result": result_text(TRUTH).encode(),
        "config": CONFIG.read_bytes(),
        "camera_info": camera_info_text(TRUTH.cameras[0]).encode(),
        "parameter": DISTANCES.encode(),
        "npz": archive(),
    }
    for name, data in good.items():
        assert taken(DOORS[name](tmp_path), data), name
    door = rig_or_data_set(tmp_path)
    assert all(taken(lens_file(tmp_path), text.encode()) for text in LENSES[:-1])
    assert all(taken(door, json.dumps(tree).encode()) for tree in (PANOPTIC, BODIES, RIG))
    (tmp_path / "intri.yml").write_text(OPENCV)
    storage = OpencvStorage(tmp_path / "intri.yml")
    np.testing.assert_array_equal(storage.matrix("dist_1"), [[0.1, -0.02, np.nan, 0.0, 0.0]])
    assert storage.names("names") == ["1"]
