"""True cameras, paths and visibility of a simulated scene, for the Cramer-Rao bound."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stcalib_ros.core.bundle.lenses import (
    CENTRE_X,
    N_CORRECTIONS,
    RADIAL,
    Lenses,
    focal_length,
)
from stcalib_ros.core.evaluation.cramer_rao import TrueViews
from stcalib_ros.core.geometry.radial import radial_profile
from stcalib_ros.core.model.arrays import BoolArray, Float64Array
from stcalib_ros.core.model.recording import CameraRecording, Intrinsics
from stcalib_ros.core.options import LensOptions
from stcalib_ros.core.synthetic.scene import Scene


class ScenePath:
    """True joints of a scene in the frame of its first camera, and their derivatives."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene

    def __call__(self, times: Float64Array, order: int) -> Float64Array:
        """Return joints (T, P, J, 3) at times of the reference clock, or their n-th derivative."""
        rig = self.scene.rig
        world = np.stack([p.spline(times, order) for p in self.scene.people], 1)
        turned = world.reshape(*world.shape[:2], -1, 3) @ rig.R_cam_world[0].T
        return np.asarray(turned + rig.t_cam_world[0] if order == 0 else turned)


def true_views(scene: Scene, unknown: LensOptions | None = None) -> TrueViews:
    """Return true cameras and visibility; joints with left and right exchanged are observed.

    Parameters
    ----------
    scene : Scene
    unknown : LensOptions, optional
        What is estimated of lenses, and known of their principal points beforehand; nothing is
        known of the rest. Default: lenses are known.
    """
    cameras = scene.truth.cameras
    R_cam_ref = np.stack([c.R_ref_cam.T for c in cameras])
    centres = np.stack([c.t_ref_cam for c in cameras])
    return TrueViews(
        R_cam_ref,
        0.0 - np.einsum("cij,cj->ci", R_cam_ref, centres),
        np.array([np.sqrt(c.intrinsics.K[0, 0] * c.intrinsics.K[1, 1]) for c in cameras]),
        scene.exposures_s,
        tuple(_observed(scene, camera) for camera in scene.recording.cameras),
        scene.options.sigma_px,
        _lenses([camera.intrinsics for camera in cameras], unknown),
    )


def _lenses(intrinsics: Sequence[Intrinsics], unknown: LensOptions | None) -> Lenses:
    free: BoolArray = np.zeros((N_CORRECTIONS, len(intrinsics)), dtype=bool)
    stddev = np.full(free.shape, np.inf)
    if unknown is not None:
        free[: RADIAL + unknown.radial_terms] = True
        stddev[CENTRE_X:RADIAL] = [
            unknown.principal_point_stddev * lens.width / focal_length(lens) for lens in intrinsics
        ]
    own = np.arange(len(intrinsics))
    return Lenses(
        tuple(intrinsics), radial_profile(intrinsics), free, np.zeros(free.shape), stddev, own
    )


def _observed(scene: Scene, camera: CameraRecording) -> BoolArray:
    """Return which joints of whom a camera observes in its images, (T, P, J)."""
    J = camera.layout.n_joints
    observed = np.zeros((len(camera.stamps), len(scene.people), J), dtype=bool)
    for track in camera.tracks:
        persons = scene.track_persons[camera.name][track.track_id]
        observed[track.frames, persons] = np.isfinite(track.keypoints[..., 0])
    return observed
