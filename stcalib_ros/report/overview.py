"""The picture of a calibration: the room, and one movement before and after."""

from __future__ import annotations

from matplotlib.figure import Figure

from stcalib_ros.report.curves import Movement
from stcalib_ros.report.draw_curves import draw_movement
from stcalib_ros.report.draw_room import draw_room
from stcalib_ros.report.room import Room
from stcalib_ros.report.style import DPI, FAINT, camera_colors

_SIZE_INCHES = (10.0, 5.0)
_RIGHT = 0.665
_LEGEND_COLUMNS = 2
_LEGEND_ROW = 0.033


def overview_figure(room: Room, movement: Movement | None, *, title: str) -> Figure:
    """Draw the room on the left, the movement, if there is one, on the right."""
    figure = Figure(figsize=_SIZE_INCHES, dpi=DPI)
    draw_room(figure.add_axes((0.0, 0.07, 0.6, 0.86)), room)
    figure.text(0.02, 0.945, title, fontsize=11, fontweight="bold")
    _caption(figure, 0.02, _room_caption(room))
    if movement is not None:
        _movement(figure, room, movement)
    return figure


def _movement(figure: Figure, room: Room, movement: Movement) -> None:
    legend = _LEGEND_ROW * -(-len(movement.curves) // _LEGEND_COLUMNS)
    bottom, gap, top = 0.2 + legend, 0.08, 0.935
    height = (top - gap - bottom) / 2.0
    before = figure.add_axes((_RIGHT, top - height, 0.32, height))
    after = figure.add_axes((_RIGHT, bottom, 0.32, height), sharex=before, sharey=before)
    draw_movement(
        before,
        after,
        movement,
        camera_colors(camera.name for camera in room.cameras),
        unit="m" if room.metric else "baselines",
    )
    figure.legend(
        handles=after.get_lines(),
        loc="lower left",
        bbox_to_anchor=(0.612, 0.082),
        ncols=_LEGEND_COLUMNS,
        fontsize=8,
        handlelength=1.2,
        columnspacing=3.0,
        labelspacing=0.3,
    )
    joint = movement.joint.replace("_", " ")
    _caption(
        figure,
        0.62,
        f"Height of the {joint} of person {movement.person_id}: where each camera's line of sight\n"
        "passes nearest to the triangulated joint. Offsets: as found.",
    )


def _room_caption(room: Room) -> str:
    step = "1 m" if room.metric else "half the distance between the first two cameras"
    text = f"Floor grid: {step}. People at four moments."
    if room.true_cameras:
        text += " Thin black: the true cameras."
    return text


def _caption(figure: Figure, x: float, text: str) -> None:
    figure.text(x, 0.02, text, fontsize=7.5, color=FAINT, va="bottom")
