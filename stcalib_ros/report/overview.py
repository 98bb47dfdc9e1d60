"""The picture of a calibration: the room, and one movement before and after."""

from __future__ import annotations

from matplotlib.figure import Figure

from stcalib_ros.report.curves import Movement
from stcalib_ros.report.draw_curves import draw_movement
from stcalib_ros.report.draw_room import draw_room
from stcalib_ros.report.room import Room
from stcalib_ros.report.style import FAINT, camera_colors

_SIZE_INCHES = (10.0, 5.0)


def overview_figure(room: Room, movement: Movement | None) -> Figure:
    """Draw the room on the left, the movement, if there is one, on the right."""
    figure = Figure(figsize=_SIZE_INCHES)
    draw_room(figure.add_axes((0.0, 0.07, 0.6, 0.86)), room)
    figure.text(0.02, 0.94, _room_title(room), fontsize=11, fontweight="bold")
    _caption(figure, 0.02, _room_caption(room))
    if movement is not None:
        unit = "m" if room.metric else "baselines"
        before = figure.add_axes((0.665, 0.585, 0.32, 0.34))
        after = figure.add_axes((0.665, 0.165, 0.32, 0.34), sharex=before, sharey=before)
        colors = camera_colors(camera.name for camera in room.cameras)
        draw_movement(before, after, movement, colors, unit=unit)
        joint = movement.joint.replace("_", " ")
        _caption(
            figure,
            0.625,
            f"Height of the {joint} of person {movement.person_id}: where each camera's line of\n"
            "sight passes nearest to the triangulated joint.",
        )
    return figure


def _room_title(room: Room) -> str:
    people = "1 person" if len(room.people) == 1 else f"{len(room.people)} people"
    return f"{len(room.cameras)} cameras, placed by {people}"


def _room_caption(room: Room) -> str:
    step = "1 m" if room.metric else "half the distance between the first two cameras"
    text = f"Floor grid: {step}. People at four moments."
    if room.true_cameras:
        text += " Thin black: the true cameras."
    return text


def _caption(figure: Figure, x: float, text: str) -> None:
    figure.text(x, 0.02, text, fontsize=8, color=FAINT, va="bottom")
