"""The room as a picture: cameras, people, floor."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.patches import Polygon
from matplotlib.patheffects import withStroke
from matplotlib.text import Annotation
from matplotlib.transforms import Bbox

from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.output.gravity import ANKLES, HEAD, SHOULDERS
from stcalib_ros.core.reconstruction.trajectories import bones
from stcalib_ros.report.room import FACE, Person, PlacedCamera, Room
from stcalib_ros.report.style import FLOOR, FLOOR_LINES, INK, PEOPLE, camera_colors
from stcalib_ros.report.view import View, best_view, crown, frustum_depth

_MOMENTS = 4
"""Time steps at which people are drawn; the captions name the number."""
_FAINTEST = 0.2
"""Opacity of the first of them."""
_MIN_KNOWN = 0.5
"""Fraction of the joints. A person is drawn at a time step if more of them are known."""
_NAMED = 4
"""People. With more, labels are their numbers alone."""
_HALO = [withStroke(linewidth=2.5, foreground="white")]
_LABEL_DISTANCE = 11.0
"""Points. From what is labelled to the label."""
_BESIDE = 0.5
"""Sine. A label that is off by more than this in a direction stands beside its object there."""
_ABOVE = 30.0
"""Drawing order of labels: above everything else."""
_RISE, _CLEARANCE, _MAX_RISES = 3.0, 4.0, 12
"""Points, points and steps. Labels that overlap are raised step by step until there is a gap."""


def draw_room(ax: Axes, room: Room) -> None:
    """Draw cameras as frusta, people at a few time steps, the paths of their feet, the floor.

    True cameras, where given, are thin outlines.
    """
    view, depth = best_view(room), frustum_depth(room)
    _floor(ax, room, view)
    for i, person in enumerate(room.people):
        name = str(person.person_id) if len(room.people) > _NAMED else f"person {person.person_id}"
        _person(ax, person, name, view, PEOPLE[i % len(PEOPLE)])
    for camera in room.true_cameras:
        _outline(ax, camera, view, depth, zorder=9.0, color=INK, linewidth=0.7)
    colors = camera_colors(camera.name for camera in room.cameras)
    for camera in room.cameras:
        _camera(ax, camera, view, depth, colors[camera.name])
    ax.set_aspect("equal")
    ax.set_axis_off()
    ax.margins(0.01)
    ax.autoscale_view()
    ax.apply_aspect()
    for text in ax.texts:
        ax.update_datalim(text.get_window_extent().transformed(ax.transData.inverted()).corners())
    ax.autoscale_view()
    ax.apply_aspect()
    _separate_labels([text for text in reversed(ax.texts) if isinstance(text, Annotation)])


def _floor(ax: Axes, room: Room, view: View) -> None:
    step = 1.0 if room.metric else 0.5
    points = [np.array([camera.centre for camera in room.cameras])]
    points += [  # of the people not all: a few points may be far off
        np.percentile(known, [2, 98], axis=0)
        for person in room.people
        if len(known := _known(person.joints))
    ]
    xy = np.concatenate(points)[:, :2] / step
    xs, ys = (
        step * np.arange(np.floor(low), np.ceil(high) + 1.0)
        for low, high in zip(xy.min(0), xy.max(0), strict=True)
    )
    lines = [[[x, ys[0], 0.0], [x, ys[-1], 0.0]] for x in xs]
    lines += [[[xs[0], y, 0.0], [xs[-1], y, 0.0]] for y in ys]
    corners = np.array([[x, y, 0.0] for x, y in _around(xs[0], xs[-1], ys[0], ys[-1])])
    ax.add_patch(Polygon(view.project(corners), facecolor=FLOOR, edgecolor="none", zorder=0))
    segments = list(view.project(np.array(lines)))
    ax.add_collection(LineCollection(segments, colors=FLOOR_LINES, linewidths=0.7, zorder=0.1))


def _around(left: float, right: float, near: float, far: float) -> list[tuple[float, float]]:
    return [(left, near), (right, near), (right, far), (left, far)]


def _known(joints: Float64Array) -> Float64Array:
    return np.asarray(joints[np.isfinite(joints).all(-1)])


def _person(ax: Axes, person: Person, name: str, view: View, color: str) -> None:
    for path in person.of(ANKLES).swapaxes(0, 1):
        ax.plot(*view.project(path).T, color=color, linewidth=1.2, alpha=0.35, zorder=1)
    moments = _moments(person)
    for k, alpha in zip(moments, np.linspace(_FAINTEST, 1.0, len(moments)), strict=True):
        _skeleton(ax, person, k, view, color, float(alpha))
    if moments:
        top = view.project(crown(_known(person.joints[moments[-1]])))
        _label(ax, name, top, np.array([0.0, 1.0]), color)


def _moments(person: Person) -> list[int]:
    """Of every part of the time, the step at which most joints of the person are known."""
    known = np.isfinite(person.joints[..., 0]).mean(1)
    parts = np.array_split(np.arange(len(known)), _MOMENTS)
    best = [int(part[known[part].argmax()]) for part in parts if len(part)]
    return [k for k in best if known[k] > _MIN_KNOWN]


def _skeleton(ax: Axes, person: Person, k: int, view: View, color: str, alpha: float) -> None:
    joints = person.joints[k]
    pairs = [
        [i, j]
        for i, j in bones(person.layout)
        if np.isfinite(joints[[i, j], 0]).all()
        and not FACE & {person.layout.joint_names[i], person.layout.joint_names[j]}
    ]
    segments = [view.project(joints[pair]) for pair in pairs]
    zorder = 10.0 + 1e-3 * view.nearness(joints) + 1e-6 * k
    head, shoulders = (_known(person.of(part)[k]) for part in (HEAD, SHOULDERS))
    if len(head):
        middle = head.mean(0)
        if len(shoulders) == 2:
            segments.append(view.project(np.array([shoulders.mean(0), middle])))
        x, y = view.project(middle)
        ax.plot(x, y, "o", color=color, alpha=alpha, markersize=5, mew=0, zorder=zorder)
    ax.add_collection(
        LineCollection(
            segments, colors=color, linewidths=1.5, alpha=alpha, zorder=zorder, capstyle="round"
        )
    )


def _camera(ax: Axes, camera: PlacedCamera, view: View, depth: float, color: str) -> None:
    corners = camera.frustum(depth)
    zorder = 10.0 + 1e-3 * view.nearness(corners)
    page, apex = view.project(corners), view.project(camera.centre)
    plumb = view.project(np.array([camera.centre, camera.centre * [1.0, 1.0, 0.0]]))
    ax.plot(*plumb.T, color=color, linewidth=0.8, alpha=0.6, linestyle=(0, (1, 2)), zorder=2)
    ax.add_patch(Polygon(page, facecolor=color, alpha=0.25, edgecolor="none", zorder=zorder))
    _outline(ax, camera, view, depth, zorder=zorder, color=color, linewidth=1.5)
    ax.plot(*apex, "o", color=color, markersize=3.5, zorder=zorder)
    _label(ax, camera.name, apex, apex - page.mean(0), color, fontweight="bold", fontsize=10)


def _outline(
    ax: Axes, camera: PlacedCamera, view: View, depth: float, *, zorder: float, **line: Any
) -> None:
    page, apex = view.project(camera.frustum(depth)), view.project(camera.centre)
    edges = [page[[i, (i + 1) % 4]] for i in range(4)]
    rays = [np.array([apex, corner]) for corner in page]
    ax.add_collection(LineCollection([*edges, *rays], zorder=zorder, capstyle="round", **line))


def _separate_labels(labels: Sequence[Annotation]) -> None:
    """Raise labels that overlap another one; the first ones stay."""
    placed: list[Bbox] = []
    for label in labels:
        for _ in range(_MAX_RISES):
            if not any(label.get_window_extent().overlaps(other) for other in placed):
                break
            x, y = label.xyann
            label.xyann = (x, y + _RISE)
        placed.append(label.get_window_extent().padded(_CLEARANCE))


def _label(
    ax: Axes, text: str, at: Float64Array, towards: Float64Array, color: str, **font: Any
) -> None:
    """Write beside a point, in the direction `towards`."""
    direction = towards / max(float(np.linalg.norm(towards)), 1e-9)
    horizontal = (
        "center" if abs(direction[0]) < _BESIDE else "left" if direction[0] > 0 else "right"
    )
    vertical = "center" if abs(direction[1]) < _BESIDE else "bottom" if direction[1] > 0 else "top"
    ax.annotate(
        text,
        (float(at[0]), float(at[1])),
        tuple((_LABEL_DISTANCE * direction).tolist()),
        textcoords="offset points",
        ha=horizontal,
        va=vertical,
        color=color,
        zorder=_ABOVE,
        path_effects=_HALO,
        **font,
    )
