"""The poses that messages of other packages give, with the fields of ``PersonPose3DArray``."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

from stcalib_ros.io.limits import MAX_COUNT

NO_TRACK = -1
"""Id of a person whom nobody tracks. Ids of messages are uint32, so that no tracker gives it."""

_MAX_DIGITS = 10
"""Digits of an id that is a number: as many as the largest uint32 has. By definition."""


def track_id_of(text: str) -> int:
    """Return the id that a text stands for: its number, else a checksum of it.

    Parameters
    ----------
    text : str
        Empty: nobody tracks that person.

    Examples
    --------
    >>> track_id_of("12"), track_id_of("")
    (12, -1)
    """
    if not text:
        return NO_TRACK
    if text.isascii() and text.isdecimal() and len(text) <= _MAX_DIGITS and int(text) <= MAX_COUNT:
        return int(text)
    return zlib.crc32(text.encode())


def person(
    track_id: int,
    score: float,
    *,
    keypoints: Any = (),
    joints: Any = (),
    joint_scores: Any = (),
) -> SimpleNamespace:
    """Fields of a ``PersonPose3D``; arrays of any shape, row by row; empty: nothing is known."""
    return SimpleNamespace(
        track_id=track_id,
        score=score,
        joints=joints,
        keypoints=keypoints,
        joint_scores=joint_scores,
    )


def poses(
    header: SimpleNamespace,
    persons: list[SimpleNamespace],
    *,
    layout: str,
    joint_names: Sequence[str] = (),
    rectified: bool = False,
    metric: bool = False,
    project: bool = False,
    fractions: bool = False,
) -> SimpleNamespace:
    """Fields of a ``PersonPose3DArray``, and what to do with them.

    Parameters
    ----------
    header, persons, layout, joint_names, rectified, metric : object
        As in that message; ids are `NO_TRACK` where nobody tracks.
    project : bool
        Keypoints are where the lens projects the joints, which are where they are in the frame of
        the camera.
    fractions : bool
        Keypoints are fractions of the image, of which the upper left corner is (0, 0).
    """
    return SimpleNamespace(
        header=header,
        layout=layout,
        joint_names=joint_names,
        rectified=rectified,
        metric=metric,
        project=project,
        fractions=fractions,
        persons=persons,
    )
