"""The picture of a calibration: the room, and one movement before and after."""

from __future__ import annotations

from matplotlib.figure import Figure

from stcalib_ros.report.curves import Movement
from stcalib_ros.report.draw_curves import draw_movement
from stcalib_ros.report.draw_room import draw_room
from stcalib_ros.report.room import Room
from stcalib_ros.report.style import camera_colors

_SIZE_INCHES = (10.0, 5.0)


def overview_figure(room: Room, movement: Movement | None) -> Figure:
    """Draw the room on the left, the movement, if there is one, on the right."""
    figure = Figure(figsize=_SIZE_INCHES)
    draw_room(figure.add_axes((0.0, 0.03, 0.6, 0.9)), room)
    if movement is not None:
        before = figure.add_axes((0.66, 0.57, 0.32, 0.34))
        after = figure.add_axes((0.66, 0.12, 0.32, 0.34), sharex=before, sharey=before)
        colors = camera_colors(camera.name for camera in room.cameras)
        draw_movement(before, after, movement, colors, unit="m" if room.metric else "baselines")
    return figure
