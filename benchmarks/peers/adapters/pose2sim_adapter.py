"""Runs in Pose2Sim's environment: ``python pose2sim_adapter.py SCENE.npz RESULT.npz``.

Its synchronisation alone, by the correlation of vertical speeds, within a second. Given: one
true person. The cameras other than the first start `late_frames` frames later.
"""

import json
import os
import re
import sys
import tempfile
from pathlib import Path

import numpy as np

os.environ["MPLBACKEND"] = "Agg"

from Pose2Sim.synchronization import synchronize_cams_all

RANGE_S = 1.0
"""Lags are searched within this, on a stretch twice as long around the middle of the clip."""

COCO_OF_H36M = {
    0: 9,
    5: 11,
    6: 14,
    7: 12,
    8: 15,
    9: 13,
    10: 16,
    11: 4,
    12: 1,
    13: 5,
    14: 2,
    15: 6,
    16: 3,
}
"""Joint of COCO's 17 by joint of our 17; eyes and ears are where the nose is."""


def main(source: str, result: str) -> None:
    """Synchronise a scene."""
    scene = np.load(source)
    with tempfile.TemporaryDirectory() as folder:
        project = Path(folder)
        (project / "videos").mkdir()
        for c, poses in enumerate(scene["keypoints"][:, 0]):
            write_camera(project, c, poses[int(scene["late_frames"]) if c else 0 :])
        C = len(scene["K"])
        middle_s = 0.5 * scene["keypoints"].shape[2] / float(scene["fps"])
        synchronize_cams_all(
            {
                "project": {"project_dir": folder, "frame_rate": int(scene["fps"])},
                "pose": {"pose_model": "COCO_17"},
                "synchronization": {
                    "synchronization_gui": False,
                    "display_sync_plots": False,
                    "save_sync_plots": False,
                    "approx_time_maxspeed": [middle_s] * C,
                    "time_range_around_maxspeed": RANGE_S,
                },
            }
        )
        shifts = [moved(project / "pose-sync" / f"cam{c:02d}_json") for c in range(C)]
    np.savez(result, late_frames=np.array(shifts) - shifts[0])


def write_camera(project: Path, c: int, poses: np.ndarray) -> None:
    """OpenPose files of one camera; each remembers its number."""
    folder = project / "pose" / f"cam{c:02d}_json"
    folder.mkdir(parents=True)
    for k, pose in enumerate(poses):
        flat = np.zeros((17, 3))
        for there, here in COCO_OF_H36M.items():
            if np.isfinite(pose[here]).all():
                flat[there] = [*pose[here], 1.0]
        flat[1:5] = flat[0]
        content = {"people": [{"pose_keypoints_2d": flat.ravel().tolist()}], "number": k}
        (folder / f"cam{c:02d}_{k:06d}.json").write_text(json.dumps(content))


def moved(folder: Path) -> int:
    """By how many frames the files of a camera were renumbered."""
    path = sorted(folder.glob("*.json"))[0]
    return int(re.findall(r"\d+", path.stem)[-1]) - int(json.loads(path.read_text())["number"])


if __name__ == "__main__":
    main(*sys.argv[1:])
