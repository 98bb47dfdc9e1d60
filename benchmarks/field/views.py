"""Kinds B, C and E: lenses that do not belong to the images, cameras that move, weak geometry."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from benchmarks.field.case import SOUND, Case, Member, scene, simulated
from benchmarks.field.changes import change_info, change_keypoints, each, turned
from stcalib_ros.core.geometry.so3 import exp_so3
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.recording import CameraRecording, Intrinsics, LensModel
from stcalib_ros.core.synthetic import SceneOptions
from stcalib_ros.core.synthetic.rigs import SceneRig

_CHANGED = ("cam1",)


def _base(seed: int, **options: int) -> Case:
    return simulated(SceneOptions(seed=21_000 + seed, **options))


def _resized(
    seed: int, factor: float, *, pad_px: float = 0.0, cameras: tuple[str, ...] = _CHANGED
) -> Case:
    """Let keypoints be those of a resized image, with bars above and below."""

    def change(x: Float64Array) -> Float64Array:
        return (x + 0.5) * factor - 0.5 + np.array([0.0, pad_px])

    return each(_base(seed), cameras, lambda c: change_keypoints(c, change))


def _with_info(
    seed: int, change: Callable[[Intrinsics], None], *, cameras: tuple[str, ...] = _CHANGED
) -> Case:
    return each(_base(seed), cameras, lambda c: change_info(c, change))


def _scale_matrix(factor: float) -> Callable[[Intrinsics], None]:
    def change(lens: Intrinsics) -> None:
        lens.K[:2] *= factor

    return change


def _normalise(lens: Intrinsics) -> None:
    lens.K[:2, 2] = 0.5


def _exchange(lens: Intrinsics) -> None:
    lens.K[0, 2], lens.K[1, 2] = lens.K[1, 2], lens.K[0, 2]


def _longer(lens: Intrinsics) -> None:
    lens.K[[0, 1], [0, 1]] *= 1.15


def _cropped(seed: int) -> Case:
    """Let keypoints be those of the middle half of the image, from its corner on."""

    def change(x: Float64Array) -> Float64Array:
        x = x - [480.0, 270.0]
        inside = ((x > 0) & (x < [960.0, 540.0])).all(-1, keepdims=True)
        return np.where(inside, x, np.nan)

    return each(_base(seed), _CHANGED, lambda c: change_keypoints(c, change))


def _turned_image(seed: int, quarters: int) -> Case:
    """Let the driver turn the image by quarter turns, and not its CameraInfo.

    A lens that is not in the middle of its image then belongs to another one.
    """
    case = _base(seed)

    def change(x: Float64Array) -> Float64Array:
        for side in ((1080, 1920) * 2)[:quarters]:
            x = np.stack([side - 1.0 - x[..., 1], x[..., 0]], -1)
        return x

    def turn(camera: CameraRecording) -> CameraRecording:
        return change_info(change_keypoints(camera, change), _off_centre)

    roll = exp_so3(np.array([0.0, 0.0, -0.5 * np.pi * quarters]))
    cameras = tuple(
        replace(c, R_ref_cam=c.R_ref_cam @ roll) if c.name in _CHANGED else c
        for c in case.truths[0].cameras
    )
    case = each(case, _CHANGED, turn)
    return replace(case, truths=(replace(case.truths[0], cameras=cameras),))


def _off_centre(lens: Intrinsics) -> None:
    lens.K[0, 2] += 0.12 * lens.width
    lens.K[1, 2] -= 0.12 * lens.height


def _without_distortion(seed: int) -> Case:
    """Let a wide lens be described without its distortion."""
    K = np.array([[700.0, 0, 960], [0, 700, 540], [0, 0, 1]])
    lens = Intrinsics(1920, 1080, LensModel.PLUMB_BOB, K, np.array([-0.28, 0.07, 0, 0, 0]))
    options = SceneOptions(seed=21_000 + seed, focal_px=700.0, ring_radius_m=(2.5, 3.2))
    ring = scene(options).rig
    rig = replace(ring, intrinsics=(lens,) * len(ring.names))
    case = simulated(replace(options, rig=rig))

    def forget(camera: CameraRecording) -> CameraRecording:
        return replace(camera, intrinsics=replace(camera.intrinsics, D=np.zeros(5)))

    return each(case, _CHANGED, forget)


def _bumped(seed: int, at: float, degrees: float, camera: str = "cam1", **options: int) -> Case:
    case = _base(seed, **options)
    n = len(case.camera(camera).stamps)
    turn = np.radians(degrees) * np.array([0.3, 0.9, 0.3]) / np.sqrt(0.99)
    return turned(case, camera, round(at * n), turn)


def _sagging(seed: int) -> Case:
    """Let a camera sink by three degrees over the clip: no state of it is the true one."""
    case = _base(seed)
    n = len(case.camera("cam1").stamps)
    turn = np.linspace(0.0, np.radians(3.0), n)[:, None] * np.array([1.0, 0.0, 0.0])
    return turned(case, "cam1", 0, turn)


def _looking(eye: tuple[float, float, float], at: tuple[float, float, float]) -> Float64Array:
    z = np.subtract(at, eye)
    z = z / np.linalg.norm(z)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x = x / np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z])


def _placed(
    seed: int,
    eyes: tuple[tuple[float, float, float], ...],
    *,
    at: tuple[float, float, float] | None = (0.0, 0.0, 1.0),
    focal_px: float = 1400.0,
    area_radius_m: float = 1.6,
    sigma_px: float = 3.0,
) -> Case:
    """Place cameras that look at one point, or straight ahead along y where none is given."""
    K = np.array([[focal_px, 0, 960], [0, focal_px, 540], [0, 0, 1]])
    lens = Intrinsics(1920, 1080, LensModel.PLUMB_BOB, K, np.zeros(5))
    R = np.stack([_looking(e, at or (e[0], e[1] + 1.0, e[2])) for e in eyes])
    t = -np.einsum("cab,cb->ca", R, np.array(eyes))
    rig = SceneRig(tuple(f"cam{c}" for c in range(len(eyes))), (lens,) * len(eyes), R, t)
    options = SceneOptions(
        seed=22_000 + seed,
        rig=rig,
        n_frames=450,
        area_radius_m=area_radius_m,
        n_people=2,
        sigma_px=sigma_px,
    )
    return simulated(options)


VIEWS = (
    Member("B", "keypoints of a third", lambda s: _resized(s, 1 / 3)),
    Member("B", "keypoints of a half", lambda s: _resized(s, 0.5)),
    Member("B", "keypoints of a half, reference", lambda s: _resized(s, 0.5, cameras=("cam0",))),
    Member("B", "letterboxed", lambda s: _resized(s, 1 / 3, pad_px=140.0)),
    Member("B", "all of three quarters", lambda s: _resized(s, 0.75, cameras=())),
    Member("B", "K of a half", lambda s: _with_info(s, _scale_matrix(0.5))),
    Member("B", "cx, cy as shares", lambda s: _with_info(s, _normalise, cameras=())),
    Member("B", "cx and cy exchanged", lambda s: _with_info(s, _exchange)),
    Member("B", "focal length 15 % off", lambda s: _with_info(s, _longer)),
    Member("B", "crop as the whole", _cropped),
    Member("B", "image turned by half", lambda s: _turned_image(s, 2)),
    Member("B", "image turned by a quarter", lambda s: _turned_image(s, 1)),
    Member("B", "wide lens without D", _without_distortion),
    Member("C", "bump of 5 degrees, late", lambda s: _bumped(s, 0.7, 5.0)),
    Member("C", "bump of 2 degrees", lambda s: _bumped(s, 0.5, 2.0)),
    Member("C", "bump of 5 degrees, early", lambda s: _bumped(s, 0.3, 5.0)),
    Member("C", "bump of 30 degrees", lambda s: _bumped(s, 0.5, 30.0)),
    Member("C", "bump of the reference", lambda s: _bumped(s, 0.6, 3.0, "cam0")),
    Member("C", "bump, two cameras", lambda s: _bumped(s, 0.5, 5.0, n_cameras=2)),
    Member("C", "sag of 3 degrees", _sagging),
    Member("E", "two webcams 60 cm apart", lambda s: _placed(s, ((-0.3, -3, 1.6), (0.3, -3, 1.6)))),
    Member(
        "E",
        "four in a row, 20 cm apart",
        lambda s: _placed(s, tuple((0.2 * i, -3.5, 1.5) for i in range(4)), at=None),
    ),
    Member(
        "E",
        "30 m away, 60 px tall",
        lambda s: _placed(
            s,
            ((-8.0, -29.0, 4.0), (0.0, -30.0, 4.0), (8.0, -29.0, 4.0)),
            focal_px=1000.0,
            area_radius_m=3.0,
            sigma_px=1.5,
        ),
    ),
    Member("E", "one over the other", lambda s: _placed(s, ((0, -4, 1.0), (0, -4, 2.2)))),
    Member(
        "-", "two that face each other", lambda s: _placed(s, ((-5, 0, 1.6), (5, 0, 1.6))), SOUND
    ),
)
