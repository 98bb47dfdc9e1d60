"""What the window has seen of every camera, and what is still missing; knows no ROS."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.arrays import BoolArray
from stcalib_ros.io.assemble import CameraImages
from stcalib_ros.io.messages import NS, PoseImage, lens
from stcalib_ros.ros.limits import GRID_COLUMNS, GRID_ROWS
from stcalib_ros.ros.readiness import shared_both_ways_s


@dataclass(frozen=True, slots=True, eq=False)
class CameraCoverage:
    """What the window of one camera holds.

    Attributes
    ----------
    cells : (rows, columns) ndarray of bool
        Parts of the image in which a keypoint was observed.
    moving_s : int
        Seconds in which somebody moves.
    shared_s : mapping of str to int
        Seconds of motion that it shares with each other camera.
    wanted_s : float
        Seconds that it must share with one of them.
    missing : str
        What it takes before it can be calibrated; empty: nothing.
    """

    cells: BoolArray
    moving_s: int
    shared_s: Mapping[str, int]
    wanted_s: float
    missing: str

    @property
    def share(self) -> float:
        """Fraction of the cells in which a keypoint was observed."""
        return float(self.cells.mean())

    @property
    def best(self) -> tuple[str, int]:
        """The camera with which it shares most, and the seconds; ("", 0) if there is no other."""
        return max(self.shared_s.items(), key=lambda item: item[1], default=("", 0))


def cells_seen(
    images: Iterable[PoseImage], size: tuple[int, int], *, min_score: float
) -> BoolArray:
    """Return in which cells of an image keypoints were observed.

    Parameters
    ----------
    images : iterable of PoseImage
    size : (int, int)
        Width and height, px.
    min_score : float
        Joints with a lower score do not count.

    Returns
    -------
    (GRID_ROWS, GRID_COLUMNS) ndarray of bool
        The first row is the top of the image.
    """
    seen = np.zeros((GRID_ROWS, GRID_COLUMNS), dtype=bool)
    points = [i.keypoints[i.joint_scores >= min_score] for i in images if len(i.keypoints)]
    if not points or min(size) < 1:
        return seen
    with np.errstate(invalid="ignore"):
        place = np.concatenate(points) / size
        place = place[((place >= 0.0) & (place < 1.0)).all(-1)]
    column, row = (place * (GRID_COLUMNS, GRID_ROWS)).astype(np.int64).T
    seen[row, column] = True
    return seen


class ImageGrid:
    """Cells of one camera's image by whole seconds, so that every image is looked at once."""

    def __init__(self) -> None:
        self._cells: dict[int, BoolArray] = {}
        self._until_ns = -1
        self._size = (0, 0)

    def update(
        self, images: Sequence[PoseImage], size: tuple[int, int], *, min_score: float
    ) -> BoolArray:
        """Take in what is new of a window, forget what has left it, and return the cells seen.

        Parameters are those of `cells_seen`.
        """
        stamps = [image.stamp_ns for image in images]
        newest_ns = max(stamps, default=-1)
        if size != self._size or newest_ns < self._until_ns:
            self._cells, self._until_ns, self._size = {}, -1, size
        oldest = min(stamps, default=0) // NS
        self._cells = {second: cells for second, cells in self._cells.items() if second >= oldest}
        new: dict[int, list[PoseImage]] = {}
        for image in images:
            if image.stamp_ns > self._until_ns:
                new.setdefault(image.stamp_ns // NS, []).append(image)
        for second, those in new.items():
            cells = cells_seen(those, size, min_score=min_score)
            self._cells[second] = self._cells.get(second, cells) | cells
        self._until_ns = newest_ns
        seen = np.zeros((GRID_ROWS, GRID_COLUMNS), dtype=bool)
        for cells in self._cells.values():
            seen |= cells
        return seen


class Coverage:
    """Follows the windows of all cameras.

    Parameters
    ----------
    names : iterable of str
        Of all cameras.
    """

    def __init__(self, names: Iterable[str]) -> None:
        self._grids = {name: ImageGrid() for name in names}

    def look(
        self,
        windows: Iterable[CameraImages],
        moving: Mapping[str, Set[int]],
        *,
        min_score: float,
        wanted_s: float,
        slack_s: float,
    ) -> dict[str, CameraCoverage]:
        """Return the coverage of every camera.

        Parameters
        ----------
        windows : iterable of CameraImages
            What there is of the cameras that have images and a CameraInfo.
        moving : mapping of str to set of int
            Whole seconds in which somebody moves, by camera, of those that can be calibrated.
        min_score : float
            Joints with a lower score do not count.
        wanted_s, slack_s : float
            `min_motion_s` and `slack_s` of `stcalib_ros.ros.readiness.ready_cameras`.
        """
        found = {window.name: window for window in windows}
        return {
            name: _coverage(name, grid, found.get(name), moving, min_score, wanted_s, slack_s)
            for name, grid in self._grids.items()
        }


def image_size(window: CameraImages) -> tuple[int, int]:
    """Return width and height, px, of the image that keypoints are in; (0, 0) if not known."""
    try:
        known = lens(window.info, rectified=window.images[0].rectified, topic=window.info_topic)
    except InputError:
        return 0, 0
    return known.width, known.height


def _coverage(
    name: str,
    grid: ImageGrid,
    window: CameraImages | None,
    moving: Mapping[str, Set[int]],
    min_score: float,
    wanted_s: float,
    slack_s: float,
) -> CameraCoverage:
    images = () if window is None else tuple(window.images)
    size = (0, 0) if window is None else image_size(window)
    own = moving.get(name, set())
    shared_s = {
        other: shared_both_ways_s(own, seconds, slack_s)
        for other, seconds in moving.items()
        if other != name
    }
    there = name in moving and window is not None
    return CameraCoverage(
        cells=grid.update(images, size, min_score=min_score),
        moving_s=len(own),
        shared_s=shared_s,
        wanted_s=wanted_s,
        missing=_missing(len(own), shared_s, wanted_s) if there else "poses, or a lens",
    )


def _missing(moving_s: int, shared_s: Mapping[str, int], wanted_s: float) -> str:
    """Say what it takes until a camera that sends poses is ready."""
    if not moving_s:
        return "people who move"
    best_s = max(shared_s.values(), default=0)
    if best_s >= wanted_s:
        return ""
    return f"{wanted_s - best_s:.0f} s more of people whom another camera sees, too"
