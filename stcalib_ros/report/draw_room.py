"""The room as a picture: cameras, people, floor."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.patches import Polygon
from matplotlib.patheffects import withStroke

from stcalib_ros.core.reconstruction import bones
from stcalib_ros.core.types import FloatArray
from stcalib_ros.report.room import Person, PlacedCamera, Room
from stcalib_ros.report.style import FLOOR, INK, PEOPLE, camera_colors
from stcalib_ros.report.view import View, best_view

_MOMENTS = 4
_FRUSTUM = 0.16
"""Depth of a frustum, in the size of the scene."""
_HALO = [withStroke(linewidth=2.5, foreground="white")]


def draw_room(ax: Axes, room: Room) -> None:
    """Draw cameras as frusta, people at a few moments with the trails of their feet, and the floor.

    True cameras, where given, are thin outlines.
    """
    view = best_view(room)
    size = _size(room)
    _floor(ax, room, view)
    for person, color in zip(room.people, PEOPLE * len(room.people), strict=False):
        _person(ax, person, view, color)
    for camera in room.true_cameras:
        _outline(ax, camera, view, _FRUSTUM * size)
    colors = camera_colors(camera.name for camera in room.cameras)
    for camera in room.cameras:
        _camera(ax, camera, view, _FRUSTUM * size, colors[camera.name])
    ax.set_aspect("equal")
    ax.set_axis_off()
    ax.autoscale_view()
    ax.margins(0.04)


def _size(room: Room) -> float:
    centres = np.array([camera.centre for camera in room.cameras])
    return float(np.linalg.norm(np.ptp(centres, axis=0)))


def _floor(ax: Axes, room: Room, view: View) -> None:
    """Grid of one metre, or of half the first baseline, under everything."""
    step = 1.0 if room.metric else 0.5
    points = [c.centre for c in room.cameras]
    points += [p.joints[np.isfinite(p.joints[..., 0])].reshape(-1, 3).mean(0) for p in room.people]
    xy = np.array(points)[:, :2]
    low, high = np.floor(xy.min(0) / step) - 0.0, np.ceil(xy.max(0) / step) + 0.0
    xs, ys = (np.arange(a, b + 1) * step for a, b in zip(low, high, strict=True))
    lines = [np.array([[x, ys[0], 0], [x, ys[-1], 0]]) for x in xs]
    lines += [np.array([[xs[0], y, 0], [xs[-1], y, 0]]) for y in ys]
    corners = np.array(
        [[xs[0], ys[0], 0], [xs[-1], ys[0], 0], [xs[-1], ys[-1], 0], [xs[0], ys[-1], 0]]
    )
    ax.add_patch(Polygon(view.project(corners), facecolor="#F6F7F8", edgecolor="none", zorder=0))
    segments = [view.project(line) for line in lines]
    ax.add_collection(LineCollection(segments, colors=FLOOR, linewidths=0.6, zorder=0.1))


def _person(ax: Axes, person: Person, view: View, color: str) -> None:
    known = np.isfinite(person.joints[..., 0]).mean(1) > 0.5
    if not known.any():
        return
    _trails(ax, person, view, color)
    whole = np.flatnonzero(known)
    moments = whole[np.linspace(0, len(whole) - 1, _MOMENTS).round().astype(int)]
    for k, alpha in zip(moments, np.linspace(0.22, 1.0, _MOMENTS), strict=True):
        _skeleton(ax, person, int(k), view, color, float(alpha))
    top = person.joints[moments[-1]]
    top = top[np.nanargmax(top[:, 2])]
    x, y = view.project(top)
    ax.annotate(
        f"person {person.trajectory.person_id}",
        (x, y),
        (0, 9),
        textcoords="offset points",
        ha="center",
        color=color,
        fontsize=7,
        zorder=30,
        path_effects=_HALO,
    )


def _skeleton(ax: Axes, person: Person, k: int, view: View, color: str, alpha: float) -> None:
    joints = person.joints[k]
    pairs = [p for p in bones(person.trajectory.layout) if np.isfinite(joints[list(p), 0]).all()]
    segments = [view.project(joints[list(pair)]) for pair in pairs]
    z = 10 + view.nearness(joints) * 1e-3
    ax.add_collection(
        LineCollection(
            segments, colors=color, linewidths=1.5, alpha=alpha, zorder=z, capstyle="round"
        )
    )


def _trails(ax: Axes, person: Person, view: View, color: str) -> None:
    for foot in person.feet:
        if "ankle" not in person.trajectory.layout.joint_names[foot]:
            continue
        path = person.joints[:, foot] * [1.0, 1.0, 0.0]
        ax.plot(*view.project(path).T, color=color, linewidth=1.0, alpha=0.6, zorder=1)


def _camera(ax: Axes, camera: PlacedCamera, view: View, depth: float, color: str) -> None:
    corners = camera.frustum(depth)
    z = 12 + view.nearness(corners) * 1e-3
    page, apex = view.project(corners), view.project(camera.centre)
    ax.add_patch(Polygon(page, facecolor=color, alpha=0.22, edgecolor="none", zorder=z))
    rays = [np.array([apex, corner]) for corner in page]
    edge = [np.array([page[i], page[(i + 1) % 4]]) for i in range(4)]
    ax.add_collection(
        LineCollection([*rays, *edge], colors=color, linewidths=1.4, zorder=z, capstyle="round")
    )
    ax.plot(
        *_foot(camera, view).T, color=color, linewidth=0.8, alpha=0.55, ls=(0, (1, 2)), zorder=2
    )
    ax.plot(*apex, "o", color=color, markersize=3.2, zorder=z)
    ax.annotate(
        camera.name,
        tuple(apex),
        (0, 8),
        textcoords="offset points",
        ha="center",
        color=color,
        fontsize=9,
        fontweight="bold",
        zorder=31,
        path_effects=_HALO,
    )


def _foot(camera: PlacedCamera, view: View) -> FloatArray:
    """Plumb line from a camera to the floor, on the page."""
    return view.project(np.array([camera.centre, camera.centre * [1.0, 1.0, 0.0]]))


def _outline(ax: Axes, camera: PlacedCamera, view: View, depth: float) -> None:
    page = view.project(camera.frustum(depth))
    apex = view.project(camera.centre)
    rays = [np.array([apex, corner]) for corner in page]
    edge = [np.array([page[i], page[(i + 1) % 4]]) for i in range(4)]
    ax.add_collection(LineCollection([*rays, *edge], colors=INK, linewidths=0.7, zorder=11))
