"""Lenses that the calibration starts from where the recording has none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stcalib_ros.core.geometry.radial import radial_profile
from stcalib_ros.core.model.lens_knowledge import LensKnowledge, LensPrior
from stcalib_ros.core.model.recording import CameraRecording, Intrinsics, LensModel, Recording
from stcalib_ros.core.options import LensOptions, Options

_FOCAL = 0.8
"""Ratio to the width of the image. Focal length of a lens that is not known: a view of 64 degrees,
the middle of usual ones of 40 to 100. Chosen: registration starts from it."""
_RADIAL_STDDEV = 0.2
"""Standard deviation of coefficients of radial distortion. Chosen: those of usual lenses are within
0.4, and what is not determined comes out near what was given."""
_ONE_LENS = "one lens"
"""Group of all cameras, where they share their lens."""


def with_assumed_lenses(recording: Recording, options: Options) -> Recording:
    """Return a recording that says of every camera what its lens is worth, with one to start from.

    Parameters
    ----------
    recording : Recording
    options : Options
    """
    return replace(recording, cameras=tuple(_camera(c, options) for c in recording.cameras))


def _camera(camera: CameraRecording, options: Options) -> CameraRecording:
    knowledge = camera.lens_knowledge or LensKnowledge(options.intrinsics)
    lens = camera.intrinsics
    if knowledge is LensKnowledge.UNKNOWN:
        lens = assumed_lens(lens)
    return replace(
        camera,
        lens_knowledge=knowledge,
        lens_group=camera.lens_group or (_ONE_LENS if options.lens.shared else ""),
        intrinsics=lens,
        lens_prior=camera.lens_prior or _prior(lens, knowledge, options.lens),
    )


def _prior(lens: Intrinsics, knowledge: LensKnowledge, options: LensOptions) -> LensPrior | None:
    """What is known of a lens; None of one that is given, or that is missing."""
    if knowledge is LensKnowledge.GIVEN or not lens.known:
        return None
    unknown = knowledge is LensKnowledge.UNKNOWN
    return LensPrior(
        focal_px=float(np.sqrt(lens.K[0, 0] * lens.K[1, 1])),
        focal_stddev=np.inf if unknown else options.focal_stddev,
        centre_px=(float(lens.K[0, 2]), float(lens.K[1, 2])),
        centre_stddev_px=options.principal_point_stddev * lens.width,
        radial=tuple(radial_profile([lens]).k[0, : options.radial_terms].tolist()),
        radial_stddev=_RADIAL_STDDEV,
    )


def assumed_lens(lens: Intrinsics) -> Intrinsics:
    """Return a lens without distortion for an image of the size of another one's."""
    focal = _FOCAL * lens.width
    middle = 0.5 * (np.array([lens.width, lens.height]) - 1.0)
    K = np.array([[focal, 0.0, middle[0]], [0.0, focal, middle[1]], [0.0, 0.0, 1.0]])
    return Intrinsics(lens.width, lens.height, LensModel.PLUMB_BOB, K, np.zeros(0))
