"""What configurations and parameters say of the lens of a camera."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.lifting.assumed_lenses import lens_by_view
from stcalib_ros.core.model.lens_knowledge import LensKnowledge, lens_knowledge
from stcalib_ros.core.model.recording import Intrinsics, unknown_intrinsics
from stcalib_ros.io.limits import MAX_IMAGE_SIDE, MAX_VIEW_DEG, MIN_VIEW_DEG
from stcalib_ros.io.messages import CameraInfoFields, fields_of_lens
from stcalib_ros.io.plausible import require_name


@dataclass(frozen=True, slots=True)
class LensSettings:
    """What is said of the lens of a camera beside its CameraInfo.

    Attributes
    ----------
    knowledge : LensKnowledge or None
        What the intrinsics are worth; None: as `Options.intrinsics` has it, but ``GIVEN`` where
        `info` is given, and ``REFINE`` where the field of view is and they are not known.
    group : str
        Cameras of one group that is not empty have one lens.
    field_of_view_deg : float or None
        Horizontal field of view by a data sheet, where CameraInfo has no K.
    image_size : (int, int) or None
        Width and height of the image, px, where there is no CameraInfo.
    info : CameraInfoFields or None
        Takes the place of CameraInfo, but for binning and region of interest.
    """

    knowledge: LensKnowledge | None = None
    group: str = ""
    field_of_view_deg: float | None = None
    image_size: tuple[int, int] | None = None
    info: CameraInfoFields | None = None


@dataclass(frozen=True, slots=True)
class LensFile:
    """Lenses of a file that is given for all cameras.

    Attributes
    ----------
    path : str
    lenses : mapping of str to CameraInfoFields
        By camera, as of `stcalib_ros.io.lens_files.read_lens_fields`.
    knowledge : LensKnowledge or None
        What they are worth; None: ``GIVEN``.
    """

    path: str
    lenses: Mapping[str, CameraInfoFields]
    knowledge: LensKnowledge | None = None


LENS_KEYS = ("intrinsics", "lens_group", "field_of_view_deg", "image_size")
"""Entries of a camera in a configuration that are of its lens."""


def lens_settings(given: Mapping[str, Any], path: str) -> LensSettings:
    """Read the entries `LENS_KEYS` of a camera; what is None is not given.

    Parameters
    ----------
    given : mapping of str to object
        May have other entries.
    path : str
        Of the camera in the configuration, for errors: ``camera.cam0``.

    Raises
    ------
    InputError
        An entry is unusable, or two contradict each other.
    """
    said, view, size = (given.get(key) for key in ("intrinsics", "field_of_view_deg", "image_size"))
    group = given.get("lens_group")
    settings = LensSettings(
        None if said is None else lens_knowledge(said, f"option {path}.intrinsics"),
        "" if group is None else require_name(str(group), f"option {path}.lens_group"),
        None if view is None else _view(view, f"option {path}.field_of_view_deg"),
        None if size is None else _size(size, f"option {path}.image_size"),
    )
    if view is not None and settings.knowledge not in (None, LensKnowledge.REFINE):
        raise InputError(
            f"option {path}.field_of_view_deg: a field of view is a first guess for intrinsics: "
            f"refine, not for {said}; leave one of them out"
        )
    return settings


def _view(value: Any, what: str) -> float:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not (is_number and MIN_VIEW_DEG <= value <= MAX_VIEW_DEG):
        raise InputError(
            f"{what}: expected a horizontal field of view of {MIN_VIEW_DEG:g} to {MAX_VIEW_DEG:g} "
            f"degrees, got {value!r}"
        )
    return float(value)


def _size(value: Any, what: str) -> tuple[int, int]:
    sides = value if isinstance(value, list | tuple) else ()
    whole = [n for n in sides if isinstance(n, int) and not isinstance(n, bool)]
    fitting = [n for n in whole if 0 < n <= MAX_IMAGE_SIDE]
    if len(sides) != 2 or len(fitting) != 2:
        raise InputError(
            f"{what}: expected [width, height] of 1 to {MAX_IMAGE_SIDE} px, got {value!r}"
        )
    return fitting[0], fitting[1]


def require_lens_groups(settings: Mapping[str, LensSettings]) -> None:
    """Demand that every group of cameras has more than one.

    Parameters
    ----------
    settings : mapping of str to LensSettings
        By the name of the camera.

    Raises
    ------
    InputError
        A group has one.
    """
    members: dict[str, list[str]] = {}
    for name, one in settings.items():
        members.setdefault(one.group, []).append(name)
    for group, names in members.items():
        if group and len(names) == 1:
            raise InputError(
                f"option camera.{names[0]}.lens_group: {names[0]} is alone in the group "
                f"{group!r}: name the group at every camera that has this lens, or leave it out"
            )


def info_with_size(
    info: CameraInfoFields | None, settings: LensSettings, what: str
) -> CameraInfoFields | None:
    """Return the CameraInfo of a camera, with what settings say in its place.

    Parameters
    ----------
    info : CameraInfoFields or None
        None: nobody publishes one.
    settings : LensSettings
    what : str
        Begins the error.

    Raises
    ------
    InputError
        CameraInfo is for an image of another size than settings say.
    """
    given, size = settings.info, settings.image_size
    if size is None and given is not None:
        size = given.width, given.height
    if size is None:
        return info
    if info is None:
        return given or fields_of_lens(unknown_intrinsics(*size))
    if (info.width, info.height) not in (size, (0, 0)):
        raise InputError(
            f"{what}: the image size is given as {size[0]} x {size[1]} px, but CameraInfo says "
            f"{info.width} x {info.height}; correct it, or leave it out"
        )
    if given is None:
        return info._replace(width=size[0], height=size[1])
    return given._replace(binning_x=info.binning_x, binning_y=info.binning_y, roi=info.roi)


def lens_of_settings(
    lens: Intrinsics, settings: LensSettings, warn: Callable[[str], None], what: str
) -> tuple[Intrinsics, LensKnowledge | None]:
    """Return the lens of a camera to start from, and what it is worth.

    Parameters
    ----------
    lens : Intrinsics
        Of its CameraInfo.
    settings : LensSettings
    warn : callable
        Called where the field of view is not used.
    what : str
        Begins the warning.
    """
    if settings.field_of_view_deg is None:
        known = LensKnowledge.GIVEN if settings.info is not None and lens.known else None
        return lens, settings.knowledge or known
    if lens.known:
        warn(f"{what}: field_of_view_deg is not used, since CameraInfo has a lens")
        return lens, settings.knowledge
    return lens_by_view(lens, settings.field_of_view_deg), LensKnowledge.REFINE
