"""Substitutes for the scenes of the paper's Table II: its people and cameras, motion of our own.

The paper's recordings cannot be shipped. Each scene here has as many people and cameras as its
namesake, motion capture for the people, and cameras of a real rig of the same kind where the
data folder is there: a dome for CMU Panoptic, ceiling cameras of a laboratory for MMPTRACK.
ZJU-MoCap is a ring of cameras, and so is every scene without the data folder.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.core.model.recording import Recording, keypoints_only, only_images
from stcalib_ros.core.synthetic import MotionClip, Scene, SceneOptions, SceneRig, simulate
from stcalib_ros.io.mocap import read_clip, shipped_clips
from stcalib_ros.io.rigs import read_rig

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
"""Where the rigs and the longer clips are, if they are there at all."""

OFFSET_FRAMES = 5
"""Offset of every camera from the first, in the paper's unsynchronised experiments."""

SEARCH_FRAMES = 10
"""Offsets are searched within plus and minus this."""

FPS = 30.0
"""Frame rate of the simulated scenes, Hz."""

_MAX_WIDTH = 1920
"""Width to which larger images are scaled down, px: keypoint noise is given at this size."""


@dataclass(frozen=True, slots=True)
class PaperScene:
    """A scene of Table II.

    Attributes
    ----------
    name, dataset : str
        Names as in the paper.
    n_people : int
    T : int
        Frames of a window, 5 to 15.
    rig_file : str or None
        JSON file of `DATA` / camera_rigs; None: a ring.
    cameras : tuple of int
        Positions in that file.
    rig_scale : float
    area_radius_m : float
        People stay within about this of the middle.
    seed : int
    shipped_only : bool
        Nothing of the data folder is used: the same scene everywhere.
    """

    name: str
    dataset: str
    n_people: int
    T: int
    rig_file: str | None
    cameras: tuple[int, ...]
    rig_scale: float
    area_radius_m: float
    seed: int
    shipped_only: bool = False

    @property
    def clips(self) -> tuple[MotionClip, ...]:
        """Motion capture that its people are composed of."""
        return shipped_clips() if self.shipped_only else _all_clips()

    @property
    def rig(self) -> SceneRig | None:
        """The real rig; None where it is not at hand, or a ring is meant."""
        path = DATA / "camera_rigs" / (self.rig_file or "")
        if self.rig_file is None or not path.is_file():
            return None
        return resized(part_of(read_rig(path), self.cameras), _MAX_WIDTH)


SCENES = (
    PaperScene(
        "160906_pizza1", "CMU Panoptic", 6, 15, "gopro_dome_15.json", (1, 4, 7, 10), 8.0, 1.7, 101
    ),
    PaperScene(
        "170915_toddler5", "CMU Panoptic", 3, 5, "gopro_dome_15.json", (2, 7, 9, 13), 8.0, 1.5, 102
    ),
    PaperScene(
        "161029_hands1", "CMU Panoptic", 3, 10, "gopro_dome_15.json", (1, 5, 7, 13), 8.0, 1.5, 103
    ),
    PaperScene("soccer1_6", "ZJU-MoCap", 6, 15, None, (), 1.0, 2.0, 104),
    PaperScene("ballet", "ZJU-MoCap", 2, 10, None, (), 1.0, 1.2, 105),
    PaperScene("boxing", "ZJU-MoCap", 2, 10, None, (), 1.0, 1.2, 106),
    PaperScene("industry_safety_2", "MMPTRACK", 6, 15, "lab_20.json", (4, 5, 6, 7), 1.0, 1.8, 107),
    PaperScene("cafe_shop_3", "MMPTRACK", 7, 15, "lab_20.json", (11, 12, 13, 14), 1.0, 2.0, 108),
    PaperScene("lobby_3", "MMPTRACK", 7, 15, "lab_20.json", (0, 1, 2, 3), 1.0, 1.6, 109),
)
"""In the order of Table II; Table I has the first of each data set."""

ULTIMATUM = PaperScene(
    "160422_ultimatum1", "CMU Panoptic", 7, 5, "gopro_dome_15.json", (1, 4, 7, 10), 8.0, 1.7, 110
)
"""Of Table III; Table II does not have it, and its people are our assumption."""

REDUCED = PaperScene(
    "three people, ring", "of the reduced set", 3, 5, None, (), 1.0, 1.5, 120, shipped_only=True
)
"""What the reduced set runs on."""


def scene_named(name: str) -> PaperScene:
    """Scene of that name."""
    return next(scene for scene in (*SCENES, ULTIMATUM, REDUCED) if scene.name == name)


def part_of(rig: SceneRig, cameras: tuple[int, ...]) -> SceneRig:
    """Some cameras of a rig."""
    pick = list(cameras)
    return SceneRig(
        tuple(rig.names[c] for c in pick),
        tuple(rig.intrinsics[c] for c in pick),
        rig.R_cam_world[pick],
        rig.t_cam_world[pick],
    )


def resized(rig: SceneRig, max_width: int) -> SceneRig:
    """The same cameras with images no wider than that, so that errors in px mean the same."""
    lenses = []
    for lens in rig.intrinsics:
        s = min(1.0, max_width / lens.width)
        K = lens.K * np.array([[s], [s], [1.0]])
        lenses.append(
            replace(lens, width=round(s * lens.width), height=round(s * lens.height), K=K)
        )
    return replace(rig, intrinsics=tuple(lenses))


@cache
def _all_clips() -> tuple[MotionClip, ...]:
    """The motion capture of the package, and the longer walks of the data folder."""
    more = sorted((DATA / "mocap").glob("cmu_*.npz"))
    return shipped_clips() + tuple(replace(read_clip(p), locomotion=True) for p in more)


def lifted_scene(
    scene: PaperScene, *, trial: int = 0, n_frames: int = 300, bias_mm: float = 15.0
) -> Scene:
    """The scene as a detector and a lifter report it, synchronised.

    Keypoints with 3 px of noise per axis and a bias that depends on the view; monocular poses
    30-60 mm and 3 degrees off, with crop perspective; people hide one another.
    """
    options = SceneOptions(
        n_people=scene.n_people,
        n_frames=n_frames,
        fps=FPS,
        rig=scene.rig,
        rig_scale=scene.rig_scale,
        area_radius_m=scene.area_radius_m,
        max_offset_frames=0.0,
        keypoint_bias_mm=bias_mm,
        occlusions=True,
        id_switches_per_10s=0.0,
        seed=1000 * trial + scene.seed,
    )
    return simulate(options, clips=scene.clips)


TWO_D = "2D only"
"""Name of the default method without the monocular 3D poses."""


def seen_by(method: str, recording: Recording) -> Recording:
    """What a method is given of a recording."""
    return keypoints_only(recording) if method == TWO_D else recording


def late(
    recording: Recording, truth: Calibration, frames: int, *, fps: float = FPS
) -> tuple[Recording, Calibration]:
    """The same images with the clocks of all cameras but the first late by `frames`."""
    shift = frames / fps
    cameras = tuple(
        replace(camera, stamps=camera.stamps - (shift if c else 0.0))
        for c, camera in enumerate(recording.cameras)
    )
    true = tuple(
        replace(camera, time_offset_s=camera.time_offset_s + (shift if c else 0.0))
        for c, camera in enumerate(truth.cameras)
    )
    return replace(recording, cameras=cameras), replace(truth, cameras=true)


def window_starts(n_frames: int, T: int, n_windows: int) -> list[int]:
    """First frames of windows of T frames, uniformly over a sequence."""
    return [int(f) for f in np.linspace(0, n_frames - T, n_windows).round()]


def window(recording: Recording, start: int, T: int) -> Recording:
    """T frames of every camera, from its `start`-th image on; tracks that reach in only."""
    cameras = []
    for camera in recording.cameras:
        number = np.arange(len(camera.stamps))
        cameras.append(only_images(camera, (number >= start) & (number < start + T)))
    return replace(recording, cameras=tuple(cameras))
