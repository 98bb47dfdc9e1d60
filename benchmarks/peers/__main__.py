"""Peers from the package registry on simulated scenes.

    python -m benchmarks.peers               all of them
    python -m benchmarks.peers --only caliscope --scenes 3

Each gets an environment of its own below out/peers/ (built when it is not there), a scene as a
file, and is given what it needs and cannot find itself: see the column "given". The rows go to
out/paper/peers.jsonl and from there to the page of results. Not part of CI.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
import venv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.paper.multiview import SEARCH_S, options_of, rig_errors, stage_rows
from benchmarks.paper.run import Row, Task, row, run_tasks
from benchmarks.paper.scenes import FPS, OFFSET_FRAMES, late
from benchmarks.paper.tables import tables
from stcalib_ros.core.synthetic import Scene, SceneOptions, simulate
from stcalib_ros.io.mocap import shipped_clips

OUT = Path("out")
ADAPTERS = Path(__file__).parent / "adapters"
BIAS_MM = {"unbiased keypoints": 0.0, "keypoints off by 20 mm": 20.0}
"""Kinds of scenes, with their view-dependent keypoint bias, mm (rms per axis)."""
_LIMIT_S = 600.0
"""Seconds after which a program counts as failed."""


@dataclass(frozen=True, slots=True)
class Peer:
    """Another calibration program.

    Attributes
    ----------
    name, version : str
        Name and version of the package.
    given : str
        Inputs that it needs and ours estimates.
    """

    name: str
    version: str
    given: str


PEERS = (
    Peer("caliscope", "0.11.8", "synchronisation, who is who"),
    Peer("humancalib", "0.5.4", "synchronisation, one person"),
    Peer("pose2sim", "0.10.49", "one person, lag within a second"),
)


def main(argv: Sequence[str] | None = None) -> int:
    """Run them and print the table."""
    args = _arguments(argv)
    peers = [peer for peer in PEERS if args.only in (None, peer.name)]
    pythons = [environment(peer) for peer in peers]
    tasks = []
    for kind in BIAS_MM:
        for k in range(args.scenes):
            tasks.append(Task(f"{kind} default scene {k}", default_rows, (kind, k)))
            tasks += [
                Task(f"{kind} {peer.name} scene {k}", peer_rows, (peer, python, kind, k))
                for peer, python in zip(peers, pythons, strict=True)
            ]
    store = OUT / "paper" / "peers.jsonl"
    if args.again:
        store.unlink(missing_ok=True)
    rows = run_tasks(tasks, store, jobs=1, name="peers")
    print(tables("peers", rows))
    return 0


def environment(peer: Peer) -> Path:
    """Python of an environment that has the peer."""
    folder = OUT / "peers" / f"venv-{peer.name}"
    python = folder / "bin" / "python"
    if not python.exists():
        venv.create(folder, with_pip=True)
        package = f"{peer.name}=={peer.version}"
        command = [
            str(python),
            "-m",
            "pip",
            "install",
            "--quiet",
            "--only-binary",
            ":all:",
            package,
        ]
        subprocess.run(command, check=True)
    return python.absolute()


def scene_of(kind: str, trial: int) -> Scene:
    """Simulate 4 cameras, 3 people, 300 synchronized frames, 3 px of noise, an average lifter."""
    options = SceneOptions(
        n_frames=300,
        fps=FPS,
        max_offset_frames=0.0,
        id_switches_per_10s=0.0,
        keypoint_bias_mm=BIAS_MM[kind],
        seed=7000 + trial,
    )
    return simulate(options, clips=shipped_clips())


def default_rows(kind: str, trial: int) -> list[Row]:
    """Our default on the same scene, with clocks five frames late and nothing given."""
    scene = scene_of(kind, trial)
    recording, truth = late(scene.recording, scene.truth, OFFSET_FRAMES)
    options = options_of("correlation", 15, range_s=SEARCH_S)
    rows = stage_rows(kind, "default", trial, recording, truth, options, fps=FPS)
    return [dict(rows[-1]) | {"stage": "nothing"}]


def peer_rows(peer: Peer, python: Path, kind: str, trial: int) -> list[Row]:
    """Run one peer on one scene; on failure, the row has the reason."""
    scene = scene_of(kind, trial)
    with tempfile.TemporaryDirectory() as folder:
        source, result = Path(folder) / "scene.npz", Path(folder) / "result.npz"
        write_scene(scene, source)
        adapter = ADAPTERS / f"{peer.name}_adapter.py"
        began = time.monotonic()
        done = subprocess.run(
            [str(python), str(adapter), str(source), str(result)],
            capture_output=True,
            text=True,
            timeout=_LIMIT_S,
            check=False,
        )
        wall_s = time.monotonic() - began
        if done.returncode or not result.exists():
            lines = done.stderr.strip().splitlines()
            reason = lines[-1] if lines else f"exit status {done.returncode}"
            return [row(kind, peer.name, peer.given, trial, None, failure=reason)]
        with np.load(result) as found:
            figures = judged(scene, dict(found))
    return [row(kind, peer.name, peer.given, trial, None, wall_s=wall_s, **figures)]


def write_scene(scene: Scene, path: Path) -> None:
    """Write keypoints (C, P, T, J, 2), 3D poses (C, P, T, J, 3) by true person, and the lenses."""
    cameras = scene.recording.cameras
    P, F = len(scene.people), len(cameras[0].stamps)
    J = cameras[0].layout.n_joints
    keypoints = np.full((len(cameras), P, F, J, 2), np.nan)
    joints = np.full((len(cameras), P, F, J, 3), np.nan)
    for c, camera in enumerate(cameras):
        for track in camera.tracks:
            person = scene.track_persons[camera.name][track.track_id]
            keypoints[c, person, track.frames] = track.keypoints
            joints[c, person, track.frames] = track.joints
    np.savez(
        path,
        K=np.stack([camera.intrinsics.K for camera in cameras]),
        image_size=np.array([(c.intrinsics.width, c.intrinsics.height) for c in cameras]),
        fps=FPS,
        late_frames=OFFSET_FRAMES,
        keypoints=keypoints,
        joints=joints,
    )


def judged(scene: Scene, found: dict[str, np.ndarray]) -> dict[str, float]:
    """Errors of the result of a peer: poses, or time offsets in frames."""
    if "late_frames" in found:
        return {"E_delta": float(np.abs(found["late_frames"][1:] - OFFSET_FRAMES).mean())}
    R, t = found["R_cam_world"], found["t_cam_world"]
    R_ref_cam = R[0] @ np.swapaxes(R, -1, -2)
    t_ref_cam = t[0] - np.einsum("cij,cj->ci", R_ref_cam, t)
    errors = rig_errors(R_ref_cam, t_ref_cam, np.zeros(len(R)), scene.truth)
    return {name: errors[name] for name in ("E_R", "E_t")}


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.peers", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--only", choices=[peer.name for peer in PEERS])
    parser.add_argument(
        "--scenes", type=int, default=3, metavar="N", help="of each kind (default 3)"
    )
    parser.add_argument("--again", action="store_true", help="do not go on, begin again")
    return parser.parse_args(argv)


if __name__ == "__main__":
    sys.exit(main())
