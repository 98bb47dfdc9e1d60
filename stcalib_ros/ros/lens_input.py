"""What a CameraInfo and the parameters say of the lens of a camera; knows no ROS."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from stcalib_ros.core.errors import InputError, one_line
from stcalib_ros.core.model.lens_knowledge import LensKnowledge
from stcalib_ros.core.model.rejection import Rejection, RejectionReason
from stcalib_ros.io.lens_settings import LensSettings
from stcalib_ros.io.messages import CameraInfoFields, lens
from stcalib_ros.ros.limits import MAX_LINE, MAX_TEXT


def require_info_bounds(message: Any, topic: str) -> None:
    """Demand a CameraInfo of numbers and of a size that one can have.

    Raises
    ------
    InputError
        It is too large, or has numbers that are not finite.
    """
    if max(len(message.d), len(message.distortion_model)) > MAX_TEXT:
        raise InputError(f"{topic}: oversize CameraInfo")
    numbers = np.concatenate([np.asarray(getattr(message, f), dtype=float) for f in "dkrp"])
    if not np.isfinite(numbers).all():
        raise InputError(f"{topic}: CameraInfo has numbers that are not finite")


def lens_problem(info: CameraInfoFields, rectified: bool, topic: str) -> str:
    """Return why a CameraInfo can be none of that image; empty if it can."""
    try:
        lens(info, rectified=rectified, topic=topic)
    except InputError as error:
        return str(error)
    return ""


def lens_change(topic: str, before: CameraInfoFields | None, after: CameraInfoFields) -> str:
    """Return which field of the CameraInfo changes first, and how."""
    field = next(f for f in after._fields if getattr(before, f, None) != getattr(after, f))
    was, is_now = getattr(before, field, None), getattr(after, field)
    return one_line(f"{topic}: CameraInfo changes: {field} was {was!r} and is {is_now!r}", MAX_LINE)


def knowledge_of(settings: LensSettings, default: LensKnowledge) -> LensKnowledge:
    """Return what the CameraInfo of a camera is worth.

    Parameters
    ----------
    settings : LensSettings
    default : LensKnowledge
        Of cameras whose parameters do not say.
    """
    if settings.knowledge is not None:
        return settings.knowledge
    return default if settings.field_of_view_deg is None else LensKnowledge.REFINE


def image_alone(info: CameraInfoFields) -> CameraInfoFields:
    """Return what of a CameraInfo is of the image and not of the lens: its size and place."""
    k, p = (0.0,) * len(info.k), (0.0,) * len(info.p)
    return info._replace(distortion_model="", d=(), k=k, p=p)


def missing_lens(
    camera: str,
    info: CameraInfoFields,
    settings: LensSettings,
    knowledge: LensKnowledge,
    *,
    rectified: bool,
) -> Rejection | None:
    """Return why a camera cannot be calibrated by its CameraInfo: it has no lens, and should."""
    if knowledge is LensKnowledge.UNKNOWN or settings.field_of_view_deg is not None:
        return None
    if lens(info, rectified=rectified, topic="").known:
        return None
    return Rejection(RejectionReason.LENS_UNKNOWN, (camera,), detail=f"{camera}=unknown")


@dataclass(frozen=True, slots=True)
class DriverImage:
    """The image that the keypoints of a camera are in.

    Attributes
    ----------
    published : CameraInfoFields or None
        CameraInfo of the driver; None: there is none.
    rectified : bool
        The keypoints are those of the rectified image.
    """

    published: CameraInfoFields | None
    rectified: bool

    def mismatch(self, found: CameraInfoFields) -> str:
        """Return why a lens that was found is not that of the driver; empty if it is.

        Parameters
        ----------
        found : CameraInfoFields
            Of the image.
        """
        if self.rectified:
            return "not called, since the estimated lens is that of the rectified image"
        if self.published is None:
            return ""
        info = self.published
        width = (info.roi[2] or info.width) // max(info.binning_x, 1)
        height = (info.roi[3] or info.height) // max(info.binning_y, 1)
        if (width, height) == (found.width, found.height):
            return ""
        return (
            f"not called, since images have {width} x {height} px now, and had "
            f"{found.width} x {found.height} px when calibrated"
        )

    def of_sensor(self, found: CameraInfoFields) -> CameraInfoFields:
        """Return a lens of the image in pixels of the full sensor, as drivers keep it.

        Parameters
        ----------
        found : CameraInfoFields
            Of the image, which is cut out of the sensor and binned as the driver says.
        """
        if self.published is None:
            return found
        x_offset, y_offset, _, _ = self.published.roi
        bin_x, bin_y = max(self.published.binning_x, 1), max(self.published.binning_y, 1)
        sensor_from_image = np.array(
            [[bin_x, 0.0, x_offset], [0.0, bin_y, y_offset], [0.0, 0.0, 1.0]]
        )
        K = sensor_from_image @ np.reshape(found.k, (3, 3))
        P = sensor_from_image @ np.reshape(found.p, (3, 4))
        return found._replace(
            width=self.published.width,
            height=self.published.height,
            k=tuple(K.ravel().tolist()),
            p=tuple(P.ravel().tolist()),
        )
