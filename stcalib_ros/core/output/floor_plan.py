"""A calibration in the frame of a floor plan or map, by where some of its cameras are there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from stcalib_ros.core.bundle.scaled_system import propagate
from stcalib_ros.core.errors import InputError
from stcalib_ros.core.geometry.alignment import umeyama
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.calibration import Calibration

_PLANE, _SPACE = 2, 3
"""Coordinates of a place on a plan, and of one in space. By definition."""
_MOST_MISFIT = 0.1
"""Ratio of the distance (rms) at which cameras are from where they should be, to how far these
places are apart. Beyond, two of them are exchanged or one is mistyped. Chosen: tape measures and
plans are good to a few percent."""
_FLATTEST = 0.05
"""Ratio of the extents of the given places across and along. Below, they are on a line, about which
everything can be turned. Chosen: 5 cm in a metre."""
_DEVIATIONS = 4.0
"""Standard deviations by which two units of length may differ. Chosen: as for all that is said of
the scale."""
_MEASURED_M = 0.05
"""Metres. Standard deviation with which a position is known; it makes that of the unit of length.
Chosen: a tape measure to the lens of a camera under the ceiling."""


@dataclass(frozen=True, slots=True, eq=False)
class PlacedCalibration:
    """A calibration in the frame of a plan.

    Attributes
    ----------
    calibration : Calibration
        With poses in that frame and lengths in metres.
    misfits_m : mapping of str to float
        How far the cameras that were given are from where they should be.
    scale : float
        By which lengths were multiplied; 1 where their unit is known better than from the places.
    """

    calibration: Calibration
    misfits_m: Mapping[str, float]
    scale: float


def placed_on_plan(
    calibration: Calibration, places_m: Mapping[str, Float64Array], frame_id: str
) -> PlacedCalibration:
    """Return a calibration in the frame of a plan, in least squares.

    Covariances are turned with the poses; how well the places are known is not in them.

    Parameters
    ----------
    calibration : Calibration
    places_m : mapping of str to (2,) or (3,) ndarray
        Where cameras are in that frame, whose z axis points up, metres: x and y of two cameras or
        more, if the calibration has a vertical; or x, y and z of three or more.
    frame_id : str
        Name of the frame.

    Raises
    ------
    InputError
        A camera is not in the calibration, the places do not determine the frame, or the cameras
        are not so far apart.

    Examples
    --------
    >>> import stcalib_ros as st
    >>> truth = st.simulate(st.SceneOptions(n_cameras=3, n_people=1, n_frames=30)).truth
    >>> places_m = {camera.name: camera.t_ref_cam + [10, 20, 0] for camera in truth.cameras}
    >>> placed = placed_on_plan(truth, places_m, "hall")
    >>> placed.calibration.cameras[0].t_ref_cam.round(3).tolist()
    [10.0, 20.0, 0.0]
    """
    _require_places(calibration, places_m, frame_id)
    poses = {camera.name: camera.t_ref_cam for camera in calibration.cameras}
    target = np.array(list(places_m.values()))
    n = target.shape[1]
    source = np.array([poses[name][:n] for name in places_m])
    stddev = _MEASURED_M / _spread(target)
    rigid = calibration.metric and not calibration.scale_stddev > stddev
    s, R, t = (_in_plane if n == _PLANE else _in_space)(source, target, rigid=rigid)
    misfits = np.linalg.norm(s * source @ R[:n, :n].T + t[:n] - target, axis=1)
    allowed = _DEVIATIONS * float(np.hypot(calibration.scale_stddev, stddev))
    if np.linalg.norm(misfits) > _MOST_MISFIT * _spread(target):
        raise InputError(_disagreement(list(places_m), misfits))
    if calibration.metric and not rigid and abs(np.log(s)) > allowed:
        raise InputError(
            f"the places are {s:.2f} times as far apart as the cameras of the result, which knows "
            f"its metres to {calibration.scale_stddev:.0%}: give metres"
        )
    moved = _moved(calibration, s, R, t, frame_id)
    if not rigid:
        known = max(stddev, float(np.linalg.norm(misfits)) / _spread(target))
        moved = replace(moved, metric=True, scale_stddev=known)
    return PlacedCalibration(moved, dict(zip(places_m, misfits.tolist(), strict=True)), s)


def _spread(points: Float64Array) -> float:
    """Root of the sum of the squared distances from the middle."""
    spread = float(np.linalg.norm(points - points.mean(0)))
    if not spread > 0:
        raise InputError("these cameras are at one place: give others")
    return spread


def _require_places(
    calibration: Calibration, places_m: Mapping[str, Float64Array], frame_id: str
) -> None:
    names = [camera.name for camera in calibration.cameras]
    if unknown := [name for name in places_m if name not in names]:
        raise InputError(f"there is no camera {unknown[0]}; there are {', '.join(names)}")
    if frame_id in (taken := [camera.frame_id for camera in calibration.cameras]):
        raise InputError(f"the frame {frame_id} is that of {names[taken.index(frame_id)]}")
    sizes = {len(place) for place in places_m.values()}
    if len(sizes) > 1:
        raise InputError("give x and y of all cameras, or x, y and z of all")
    if sizes == {_PLANE} and not calibration.frame_id:
        raise InputError(
            "the result has no vertical: calibrate with world_frame in the configuration, or give "
            "x, y and z of three cameras"
        )
    if len(places_m) < (least := max(sizes, default=_PLANE)):
        raise InputError(f"{least} cameras are needed, got {len(places_m)}")


def _in_plane(
    source: Float64Array, target: Float64Array, *, rigid: bool
) -> tuple[float, Float64Array, Float64Array]:
    """Similarity about the vertical: of numbers x + i y, a factor."""
    middle, there = source.mean(0), target.mean(0)
    a, b = ((p - m) @ np.array([1.0, 1.0j]) for p, m in ((source, middle), (target, there)))
    factor = complex((a.conj() * b).sum() / _spread(source) ** 2)
    s = 1.0 if rigid else abs(factor)
    turn = factor / abs(factor) if factor else 1.0 + 0.0j
    R = np.array([[turn.real, -turn.imag, 0.0], [turn.imag, turn.real, 0.0], [0.0, 0.0, 1.0]])
    return s, R, np.append(there - s * R[:_PLANE, :_PLANE] @ middle, 0.0)


def _in_space(
    source: Float64Array, target: Float64Array, *, rigid: bool
) -> tuple[float, Float64Array, Float64Array]:
    for points in (source, target):
        extents = np.linalg.svd(points - points.mean(0), compute_uv=False)
        if extents[1] <= _FLATTEST * extents[0]:
            raise InputError("the cameras are on a line: give one more, away from it")
    s, R, t = umeyama(source, target)
    if not rigid:
        return s, R, t
    return 1.0, R, target.mean(0) - R @ source.mean(0)


def _disagreement(names: list[str], misfits: Float64Array) -> str:
    far = ", ".join(f"{name} by {misfits[k]:.2f} m" for k, name in enumerate(names))
    return (
        f"the cameras cannot be at these places: at best they miss them, {far}; check the names, "
        "and that x, y and z are metres, as on a map (y up the page, not down as in an image)"
    )


def _moved(
    calibration: Calibration, s: float, R: Float64Array, t: Float64Array, frame_id: str
) -> Calibration:
    G = block_diag(s * R, R)
    cameras = tuple(
        replace(
            camera,
            R_ref_cam=R @ camera.R_ref_cam,
            t_ref_cam=s * R @ camera.t_ref_cam + t,
            covariance=propagate(G, camera.covariance),
        )
        for camera in calibration.cameras
    )
    joint = calibration.joint_covariance
    if joint.size:
        joint = propagate(block_diag(*[G, np.eye(1)] * len(cameras)), joint)
    return replace(calibration, cameras=cameras, joint_covariance=joint, frame_id=frame_id)
