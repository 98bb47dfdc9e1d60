"""Runs in humancalib's environment: ``python humancalib_adapter.py SCENE.npz RESULT.npz``.

Given: true synchronisation, and one true person. Its linear calibration from 3D poses, then its
bundle adjustment, on the files that its pose estimation would have left.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

OPENPOSE_OF_H36M = {
    0: 9,
    1: 8,
    2: 14,
    3: 15,
    4: 16,
    5: 11,
    6: 12,
    7: 13,
    8: 0,
    9: 1,
    10: 2,
    11: 3,
    12: 4,
    13: 5,
    14: 6,
}
"""Joint of its 25 by joint of our 17; the rest (eyes, ears, feet) is not seen."""


def main(source: str, result: str) -> None:
    """Calibrate a scene."""
    scene = np.load(source)
    with tempfile.TemporaryDirectory() as folder:
        write_session(Path(folder), scene)
        common = ["--prefix", folder, "--aid", "1", "--pid", "1", "--gid", "1"]
        common += ["--dataset", "MyDataset", "--conf_threshold", "0.5"]
        step = ["-m", "humancalib.calibration.calib_linear", "--target", "noise_1_0"]
        run([*step, "--frame_skip", "1", *common])
        run(
            [
                "-m",
                "humancalib.pipeline.run_ba",
                "--target",
                "linear_1_0",
                "--frame_skip",
                "2",
                *common,
            ]
        )
        found = json.loads((Path(folder) / "results" / "linear_1_0_ba.json").read_text())
    C = len(scene["K"])
    np.savez(
        result,
        R_cam_world=np.array(found["R_w2c"]).reshape(C, 3, 3),
        t_cam_world=np.array(found["t_w2c"]).reshape(C, 3),
    )


def run(arguments: list[str]) -> None:
    """Run a module of it."""
    subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)


def write_session(folder: Path, scene: np.lib.npyio.NpzFile) -> None:
    """Cameras, session and poses of person 0, in the layout that it reads."""
    target = folder / "noise_1_0"
    C, _, F = scene["keypoints"].shape[:3]
    ids = list(range(1, C + 1))
    cameras = {
        "CAMID": ids,
        "K": scene["K"].tolist(),
        "R_w2c": np.tile(np.eye(3), (C, 1, 1)).tolist(),
        "t_w2c": np.zeros((C, 3, 1)).tolist(),
    }
    for name in ("2d_joint", "3d_joint"):
        (target / name).mkdir(parents=True)
    (target / "cameras_G001.json").write_text(json.dumps(cameras))
    skeleton = {"skeleton": np.zeros((F, 25, 3)).tolist(), "frame_indices": list(range(F))}
    (target / "skeleton_w_G001.json").write_text(json.dumps(skeleton))
    width, height = (int(n) for n in scene["image_size"][0])
    joints = sorted(OPENPOSE_OF_H36M)
    session = {"camera_ids": ids, "available_joints": joints, "aid": 1, "pid": 1, "gid": 1}
    session |= {"video_dir": str(folder), "width": width, "height": height}
    session |= {"frame_rate": float(scene["fps"])}
    (target / "session.yaml").write_text(json.dumps(session))
    for c in range(C):
        for name, values in (("2d_joint", scene["keypoints"]), ("3d_joint", scene["joints"])):
            file = target / name / f"A001_P001_G001_C{ids[c]:03d}.json"
            file.write_text(json.dumps({"data": list(map(frame, range(F), values[c, 0]))}))


def frame(index: int, joints: np.ndarray) -> dict[str, object]:
    """One frame of 25 joints; scores are 1 where a joint is known."""
    pose, score = np.zeros((25, joints.shape[-1])), np.zeros(25)
    for there, here in OPENPOSE_OF_H36M.items():
        if np.isfinite(joints[here]).all():
            pose[there], score[there] = joints[here], 1.0
    return {
        "frame_index": index,
        "skeleton": [{"pose": pose.ravel().tolist(), "score": score.tolist()}],
    }


if __name__ == "__main__":
    main(*sys.argv[1:])
