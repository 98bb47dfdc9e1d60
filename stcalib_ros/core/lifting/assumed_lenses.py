"""Lenses that the calibration starts from where the recording has none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.geometry.radial import radial_profile
from stcalib_ros.core.lifting.intrinsics_checks import sensor_rectangle
from stcalib_ros.core.model.lens_knowledge import LensKnowledge, LensPrior
from stcalib_ros.core.model.recording import CameraRecording, Intrinsics, LensModel, Recording
from stcalib_ros.core.model.rejection import Rejection, RejectionReason, Remark, RemarkCode
from stcalib_ros.core.options import LensOptions, Options

_FOCAL = 0.8
"""Ratio to the longer side of the image, which is the width unless the camera stands on its side.
Focal length of a lens that is not known: a view of 64 degrees, the middle of usual ones of 40 to
100. Chosen: registration starts from it."""
_RADIAL_STDDEV = 0.2
"""Standard deviation of coefficients of radial distortion. Chosen: those of usual lenses are within
0.4, and what is not determined comes out near what was given."""
_WIDE_VIEW_DEG = 110.0
"""Degrees of horizontal view. A lens of a wider one is taken to be equidistant where only its view
is known: lenses without distortion go up to 100 to 110 degrees, action cameras and fisheyes have
120 to 180, of which no plane image is made. Chosen by data sheets of lenses."""
_ONE_LENS = "one lens"
"""Group of all cameras, where they share their lens."""


@dataclass(frozen=True, slots=True, eq=False)
class AssumedLenses:
    """A recording whose lenses are all such that points can be projected.

    Attributes
    ----------
    recording : Recording
        It says of every camera what its lens is worth.
    faults : mapping of str to Rejection
        Cameras whose lens should be known and is not, by their names.
    remarks : tuple of Remark
        What was assumed.
    """

    recording: Recording
    faults: Mapping[str, Rejection]
    remarks: tuple[Remark, ...]


def with_assumed_lenses(recording: Recording, options: Options) -> AssumedLenses:
    """Return a recording that says of every camera what its lens is worth, with one to start from.

    Parameters
    ----------
    recording : Recording
    options : Options

    Raises
    ------
    InputError
        Cameras that share a lens have images of two sizes, or lenses that are not worth the same;
        or the method takes lenses as they are given, and one is not given.
    """
    cameras = tuple(_camera(camera, options) for camera in recording.cameras)
    _require_one_lens_per_group(cameras)
    estimated = [c.name for c in cameras if c.lens_knowledge is not LensKnowledge.GIVEN]
    if estimated and options.registration.method == "vmf":
        raise InputError(
            f"intrinsics of {', '.join(estimated)} are not given: registration.method vmf takes "
            "lenses as they are; give them, or take correlation"
        )
    faults = {
        camera.name: Rejection(
            RejectionReason.LENS_UNKNOWN, (camera.name,), detail=f"{camera.name}=unknown"
        )
        for camera in cameras
        if camera.lens_knowledge is not LensKnowledge.UNKNOWN and not camera.intrinsics.known
    }
    unknown = [c for c in cameras if c.lens_knowledge is LensKnowledge.UNKNOWN or c.name in faults]
    lenses = {camera.name: assumed_lens(camera.intrinsics) for camera in unknown}
    started = tuple(
        _with_prior(replace(c, intrinsics=lenses.get(c.name, c.intrinsics)), options.lens)
        for c in cameras
    )
    names = tuple(name for name in lenses if name not in faults)
    view_deg = float(np.degrees(2.0 * np.arctan(0.5 / _FOCAL)))
    remark = Remark(RemarkCode.LENS_ASSUMED, names, {"view_deg": view_deg})
    return AssumedLenses(replace(recording, cameras=started), faults, (remark,) if names else ())


def _camera(camera: CameraRecording, options: Options) -> CameraRecording:
    return replace(
        camera,
        lens_knowledge=camera.lens_knowledge or LensKnowledge(options.intrinsics),
        lens_group=camera.lens_group or (_ONE_LENS if options.lens.shared else ""),
    )


def _with_prior(camera: CameraRecording, options: LensOptions) -> CameraRecording:
    """Say what is known of a lens that is to be estimated."""
    lens = camera.intrinsics
    if camera.lens_knowledge is LensKnowledge.GIVEN or camera.lens_prior is not None:
        return camera
    unknown = camera.lens_knowledge is LensKnowledge.UNKNOWN
    prior = LensPrior(
        focal_px=float(np.sqrt(lens.K[0, 0] * lens.K[1, 1])),
        focal_stddev=np.inf if unknown else options.focal_stddev,
        centre_px=(float(lens.K[0, 2]), float(lens.K[1, 2])),
        centre_stddev_px=options.principal_point_stddev * lens.width,
        radial=tuple(radial_profile([lens]).k[0, : options.radial_terms].tolist()),
        radial_stddev=_RADIAL_STDDEV,
    )
    return replace(camera, lens_prior=prior)


def _require_one_lens_per_group(cameras: Sequence[CameraRecording]) -> None:
    first: dict[str, CameraRecording] = {}
    for camera in cameras if len(cameras) > 1 else ():
        other = first.setdefault(camera.lens_group, camera)
        if not camera.lens_group:
            continue
        what = f"{other.name} and {camera.name} are to have one lens ({camera.lens_group})"
        sizes = [f"{c.intrinsics.width} x {c.intrinsics.height}" for c in (other, camera)]
        if sizes[0] != sizes[1]:
            raise InputError(f"{what}, but their images have {' and '.join(sizes)} px")
        worth = [c.lens_knowledge.value for c in (other, camera) if c.lens_knowledge is not None]
        if worth[0] != worth[1]:
            raise InputError(f"{what}, but their intrinsics are {' and '.join(worth)}")


def assumed_lens(lens: Intrinsics) -> Intrinsics:
    """Return a lens without distortion for an image of the size of another one's."""
    return _centred(lens, LensModel.PLUMB_BOB, _FOCAL * float(sensor_rectangle(lens)[2:].max()))


def lens_by_view(lens: Intrinsics, view_deg: float) -> Intrinsics:
    """Return the lens that a data sheet describes by its horizontal field of view.

    Parameters
    ----------
    lens : Intrinsics
        Of an image of that size; its focal length is not looked at.
    view_deg : float
        Of the whole sensor, degrees.
    """
    half_width, half_view = 0.5 * sensor_rectangle(lens)[2], 0.5 * np.radians(view_deg)
    if view_deg > _WIDE_VIEW_DEG:
        return _centred(lens, LensModel.EQUIDISTANT, half_width / half_view)
    return _centred(lens, LensModel.PLUMB_BOB, half_width / np.tan(half_view))


def _centred(lens: Intrinsics, model: LensModel, focal: float) -> Intrinsics:
    """Return a lens without distortion that looks through the middle of the sensor."""
    left, top, width, height = sensor_rectangle(lens)
    cx, cy = left + 0.5 * (width - 1.0), top + 0.5 * (height - 1.0)
    K = np.array([[focal, 0.0, cx], [0.0, focal, cy], [0.0, 0.0, 1.0]])
    D = np.zeros(4 if model is LensModel.EQUIDISTANT else 0)
    return replace(lens, model=model, K=K, D=D)
