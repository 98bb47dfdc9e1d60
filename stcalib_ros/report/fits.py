"""How well the keypoints of every camera fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.bundle.observations import Observations
from stcalib_ros.core.bundle.residuals import residuals_px
from stcalib_ros.core.capture.evidence import CaptureEvidence
from stcalib_ros.core.geometry.lens import project
from stcalib_ros.core.model.arrays import BoolArray, Float64Array
from stcalib_ros.core.model.recording import Intrinsics

_MOST_SHOWN = 60_000
"""Keypoints of a camera that are shown; of more, a regular part. Cost alone."""
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
        Places in the image, px, of those with an error.
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
    everything, inlier = residuals_px(obs, state)
    known = state.triangulated()[:, None] & obs.observed & np.isfinite(everything).all(-1)
    fits = []
    for name in (name for name in names if name in evidence.names):
        c = evidence.names.index(name)
        lens = evidence.lifted[evidence.last.rig.cameras[c]].intrinsics
        rows, joints = np.nonzero(known[:, c])
        errors = np.linalg.norm(everything[:, c][inlier[:, c]], axis=-1)
        part = slice(None, None, 1 + len(rows) // _MOST_SHOWN)
        rows, joints = rows[part], joints[part]
        fits.append(
            KeypointFit(
                name=name,
                n_seen=int(obs.observed[:, c].sum()),
                n_fit=int(inlier[:, c].sum()),
                pixels=_pixels(obs.x[rows, c, joints], lens),
                residuals=everything[rows, c, joints],
                fits=inlier[rows, c, joints],
                rms_px=float(np.sqrt((errors**2).mean())) if len(errors) else float("nan"),
                median_px=float(np.median(errors)) if len(errors) else float("nan"),
                person_px=_person_px(obs, c),
            )
        )
    return tuple(fits)


def _pixels(x: Float64Array, lens: Intrinsics | None) -> Float64Array:
    """Places in the image of points (M, 2) on the plane z = 1."""
    if lens is None:
        return np.full(x.shape, np.nan)
    return project(np.concatenate([x, np.ones_like(x[:, :1])], -1), lens)


def _person_px(obs: Observations, c: int) -> float:
    """Median extent of the people who are seen whole, px: about their height."""
    seen = obs.observed[:, c]
    rows = np.flatnonzero(seen.mean(1) > _WHOLE)[:: 1 + len(seen) // _MOST_SHOWN]
    if not len(rows):
        return float("nan")
    x = np.where(seen[rows][..., None], obs.x[rows, c] * obs.focal[rows, c][..., None], np.nan)
    extent = np.nanmax(x, axis=1) - np.nanmin(x, axis=1)
    return float(np.median(np.linalg.norm(extent, axis=-1)))
