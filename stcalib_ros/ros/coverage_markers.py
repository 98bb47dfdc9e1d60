"""What the window has seen, as markers: cells and bars at every image, lines between cameras."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from visualization_msgs.msg import Marker

from stcalib_ros.core.model.arrays import BoolArray, Float64Array
from stcalib_ros.core.monitoring.alarms import Verdict
from stcalib_ros.ros.coverage import CameraCoverage
from stcalib_ros.ros.image_planes import ImagePlane
from stcalib_ros.ros.marker_shapes import Color, Pen

_GOOD: Color = (0.2, 0.8, 0.3, 1.0)
"""Red, green, blue and opacity, 0 to 1: what is enough, and cameras that agree."""
_MORE: Color = (0.95, 0.7, 0.1, 1.0)
"""Red, green, blue and opacity, 0 to 1: what is not enough yet."""
_BAD: Color = (0.9, 0.2, 0.2, 1.0)
"""As `_GOOD`: what lacks altogether, and cameras that have changed."""
_CELL_ALPHA = 0.25
"""Opacity, 0 to 1, of cells: what lies behind an image is still to be seen."""
_FRAME, _GRID = 0.008, 0.002
"""Fractions of the width of an image: widths of its frame and of the lines of its cells. Chosen by
looking at them."""
_MARGIN = 0.03
"""Fraction of an image by which its frame is larger, so that the frustum does not cover it. Chosen
by looking at it."""
_BAR_TOP, _BAR_STEP, _BAR_HEIGHT = 1.06, 0.09, 0.06
"""Heights of an image: how far below its top the first bar begins, each further one, and the height
of a bar. Chosen by looking at them."""
_BAR_NAME = -0.1
"""Fraction of the width of an image: middle of the name of a bar, to the left of it. Chosen by
looking at it."""
_TEXT_TOP, _TEXT_HEIGHT = 1.46, 0.055
"""Fractions of the height of an image: middle of the text below its top; and of its width: height
of the text. Chosen by looking at them."""
_TEXT_WIDTH = 36
"""Characters of a line of text, about as wide as the image. Chosen by looking at it."""
_PAIR_LINE, _PAIR_TEXT = 0.02, 0.1
"""Fractions of the width of an image: lines between cameras and the height of the text on them.
Chosen by looking at them."""


@dataclass(frozen=True, slots=True)
class CameraState:
    """What is shown of one camera besides its image.

    Attributes
    ----------
    coverage : CameraCoverage
    verdict : Verdict or None
        Of the watch; None: it is not watched.
    residual_px : float
        Median error of its keypoints; NaN: not known.
    """

    coverage: CameraCoverage
    verdict: Verdict | None
    residual_px: float

    @property
    def color(self) -> Color:
        """Red: changed, or nothing of it can be used; yellow: more is needed; else green."""
        if self.verdict is not None and self.verdict.state.alarm:
            return _BAD
        if not self.coverage.missing:
            return _GOOD
        return _MORE if self.coverage.moving_s else _BAD

    def text(self, name: str) -> str:
        """Say what the bars show, and what is missing."""
        seen = self.coverage
        other, best_s = seen.best
        lines = [
            f"{name}: needs {seen.missing}" if seen.missing else f"{name}: ready",
            f"image {100 * seen.share:.0f} %, moving {seen.moving_s} s"
            + (f", shared {best_s} s with {other}" if best_s else ""),
        ]
        if self.verdict is not None and np.isfinite(self.residual_px):
            lines.append(f"residual {self.residual_px:.1f} px, watch: {self.verdict.state.value}")
        elif self.verdict is not None:
            lines.append(f"watch: {self.verdict.state.value}")
        return "\n".join(part for line in lines for part in textwrap.wrap(line, _TEXT_WIDTH))


def coverage_markers(
    states: Mapping[str, CameraState],
    planes: Mapping[str, ImagePlane],
    centres: Mapping[str, Float64Array],
    *,
    pen: Pen,
) -> list[Marker]:
    """Return what the window has seen.

    Parameters
    ----------
    states : mapping of str to CameraState
        By camera, in the order of the configuration.
    planes : mapping of str to ImagePlane
        Where their images are shown; those without any are left out.
    centres : mapping of str to (3,) ndarray
        Places of the cameras that are calibrated, in the reference frame.
    pen : Pen

    Returns
    -------
    list of visualization_msgs.msg.Marker
        Namespaces ``images`` (frames, by state), ``cells`` (their lines), ``seen`` (the cells in
        which keypoints were), ``bars``, ``bar frames`` and ``bar names`` (share of the image,
        seconds of motion, seconds shared), ``states`` (text), ``pairs`` and ``shared`` (text). Ids
        by the order of the cameras; of bars, three for each, and of pairs, number of cameras times
        the first plus the second.
    """
    markers = []
    for number, (name, state) in enumerate(states.items()):
        if (plane := planes.get(name)) is not None:
            markers += _image(number, plane, state, pen)
            markers += _bars(number, plane, state.coverage, pen)
            width, height = plane.size
            at = plane.place(np.array([0.5 * width, _TEXT_TOP * height]))
            text_height = _TEXT_HEIGHT * plane.width
            markers.append(
                pen.text("states", number, at, text_height, state.color, state.text(name))
            )
    return [*markers, *_pairs(states, planes, centres, pen)]


def _image(number: int, plane: ImagePlane, state: CameraState, pen: Pen) -> list[Marker]:
    rows, columns = state.coverage.cells.shape
    width, height = plane.size
    grid = [
        end
        for k in range(1, columns)
        for end in ((k * width / columns, 0.0), (k * width / columns, height))
    ]
    grid += [
        end
        for k in range(1, rows)
        for end in ((0.0, k * height / rows), (width, k * height / rows))
    ]
    lines, color = plane.place(np.array(grid)), state.color
    middle = plane.corners.mean(0)
    around = middle + (1.0 + _MARGIN) * (plane.corners - middle)
    markers = [
        pen.lines("images", number, _outline(around), _FRAME * plane.width, color),
        pen.lines("cells", number, lines, _GRID * plane.width, color),
    ]
    if state.coverage.cells.any():
        corners = plane.place(cell_triangles(state.coverage.cells) * plane.size)
        markers.append(pen.triangles("seen", number, corners, (*_GOOD[:3], _CELL_ALPHA)))
    return markers


def cell_triangles(cells: BoolArray) -> Float64Array:
    """Return two triangles (6 N, 2) for each of N cells, in fractions of the image."""
    rows, columns = cells.shape
    row, column = np.nonzero(cells)
    corner = np.array([[0, 0], [1, 0], [1, 1], [0, 0], [1, 1], [0, 1]])
    places = np.stack([column, row], axis=-1)[:, None] + corner
    return np.asarray(places.reshape(-1, 2) / (columns, rows))


def _bars(number: int, plane: ImagePlane, coverage: CameraCoverage, pen: Pen) -> Iterator[Marker]:
    """Yield a bar each for the image, for motion and for what is shared, with their frames."""
    fractions = {
        "image": coverage.share,
        "motion": min(coverage.moving_s / coverage.wanted_s, 1.0),
        "shared": min(coverage.best[1] / coverage.wanted_s, 1.0),
    }
    width, height = plane.size
    for k, (name, fraction) in enumerate(fractions.items()):
        top, marker_id = (_BAR_TOP + k * _BAR_STEP) * height, 3 * number + k
        bottom = top + _BAR_HEIGHT * height
        full = _rectangle(plane, width, top, bottom)
        yield pen.lines("bar frames", marker_id, _outline(full), _GRID * plane.width, _MORE)
        at = plane.place(np.array([_BAR_NAME * width, 0.5 * (top + bottom)]))
        text_height = _TEXT_HEIGHT * plane.width
        yield pen.text("bar names", marker_id, at, text_height, _MORE, name)
        if fraction > 0.0:
            a, b, c, d = _rectangle(plane, fraction * width, top, bottom)
            color = _GOOD if fraction >= 1.0 or k == 0 else _MORE
            yield pen.triangles("bars", marker_id, np.stack([a, b, c, a, c, d]), color)


def _rectangle(plane: ImagePlane, width: float, top: float, bottom: float) -> Float64Array:
    return plane.place(np.array([[0.0, top], [width, top], [width, bottom], [0.0, bottom]]))


def _outline(corners: Float64Array) -> Float64Array:
    """Both ends, in turn, of the sides (8, 3) of a rectangle."""
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1).reshape(-1, 3)


def _pairs(
    states: Mapping[str, CameraState],
    planes: Mapping[str, ImagePlane],
    centres: Mapping[str, Float64Array],
    pen: Pen,
) -> Iterator[Marker]:
    """Yield a line and the seconds that they share for every two calibrated cameras that do."""
    names = list(states)
    for i, a in enumerate(names):
        for j in range(i + 1, len(names)):
            b, seen = names[j], states[a].coverage
            shared_s = seen.shared_s.get(b, 0)
            if not shared_s or a not in centres or b not in centres:
                continue
            color = _GOOD if shared_s >= seen.wanted_s else _MORE
            ends, width = np.stack([centres[a], centres[b]]), planes[a].width
            number = i * len(names) + j
            yield pen.lines("pairs", number, ends, _PAIR_LINE * width, color)
            height = _PAIR_TEXT * width
            yield pen.text("shared", number, ends.mean(0), height, color, f"{shared_s} s")
