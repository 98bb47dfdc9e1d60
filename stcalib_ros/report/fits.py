"""How well the keypoints of every camera fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.bundle.observations import Observations
from stcalib_ros.core.bundle.residuals import errors_px, residuals_px
from stcalib_ros.core.capture.evidence import CaptureEvidence
from stcalib_ros.core.geometry.lens import project_plane
from stcalib_ros.core.model.arrays import BoolArray, Float64Array
from stcalib_ros.core.model.recording import Intrinsics

_MOST_SHOWN = 4000
"""People at moments that are shown; of more, a regular part. Cost alone."""
_WHOLE = 0.7
"""Fraction of the joints. Of a person with more of them in view, the size is measured."""


@dataclass(frozen=True, slots=True, eq=False)
class KeypointFit:
    """Keypoints of one camera that belong to people whom another camera sees at the same time.

    That is the one count of keypoints that all shares of a report refer to.

    Attributes
    ----------
    name : str
    n_seen, n_fit : int
        All of them, and those that fit: from which the calibration is made.
    pixels : (M, 2) ndarray
        Places in the image, px, of those with an error; of long recordings, of a regular part.
    residuals : (M, 2) ndarray
        Reprojected joint minus keypoint, px.
    fits : (M,) ndarray of bool
    rms_px, median_px : float
        Of the errors of those that fit; NaN without any.
    person_px : float
        Usual height of a person in the image, px; NaN where nobody is seen whole.
    """

    name: str
    n_seen: int
    n_fit: int
    pixels: Float64Array
    residuals: Float64Array
    fits: BoolArray
    rms_px: float
    median_px: float
    person_px: float

    @property
    def errors(self) -> Float64Array:
        """Lengths (M,) of the residuals, px."""
        return np.asarray(np.linalg.norm(self.residuals, axis=-1))

    @property
    def share(self) -> float:
        """Fraction of the keypoints that fit."""
        return self.n_fit / max(self.n_seen, 1)


def camera_fits(evidence: CaptureEvidence | None, names: Sequence[str]) -> tuple[KeypointFit, ...]:
    """Return the fits of some cameras, in their order; those without observations are left out."""
    if evidence is None:
        return ()
    obs, state = evidence.last.observations, evidence.last.state
    errors = errors_px(obs, state)
    inlier = state.inlier & np.isfinite(errors)
    part = np.arange(0, len(obs.person), 1 + len(obs.person) // _MOST_SHOWN)
    residuals, _ = residuals_px(obs.only(part), state.only(part))
    fits = []
    for name in (name for name in names if name in evidence.names):
        c = evidence.names.index(name)
        lens = evidence.lifted[evidence.last.rig.cameras[c]].intrinsics
        good = errors[:, c][inlier[:, c]].astype(np.float64)
        rows, joints = np.nonzero(np.isfinite(errors[part, c]))
        fits.append(
            KeypointFit(
                name=name,
                n_seen=int(obs.observed[:, c].sum()),
                n_fit=len(good),
                pixels=_pixels(obs.x[part[rows], c, joints], lens),
                residuals=residuals[rows, c, joints],
                fits=inlier[part[rows], c, joints],
                rms_px=float(np.sqrt((good**2).mean())) if len(good) else float("nan"),
                median_px=float(np.median(good)) if len(good) else float("nan"),
                person_px=_person_px(obs.only(part), c),
            )
        )
    return tuple(fits)


def _pixels(x: Float64Array, lens: Intrinsics | None) -> Float64Array:
    """Places in the image of points (M, 2) on the plane z = 1."""
    if lens is None:
        return np.full(x.shape, np.nan)
    return project_plane(x, lens)


def _person_px(obs: Observations, c: int) -> float:
    """Median extent of the people who are seen whole, px: about their height."""
    seen = obs.observed[:, c]
    rows = np.flatnonzero(seen.mean(1) > _WHOLE)
    if not len(rows):
        return float("nan")
    x = np.where(seen[rows][..., None], obs.x[rows, c] * obs.focal[rows, c][..., None], np.nan)
    extent = np.nanmax(x, axis=1) - np.nanmin(x, axis=1)
    return float(np.median(np.linalg.norm(extent, axis=-1)))
