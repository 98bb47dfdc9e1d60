"""What is drawn: stable ids, what is gone is deleted, places and colors as they are said to be."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2: make env")
pytest.importorskip("stcalib_ros.msg", reason="the messages are not built: make env")

from samples import STAMP, calibration
from std_msgs.msg import Header
from visualization_msgs.msg import Marker

from stcalib_ros.core.geometry.lens import project
from stcalib_ros.core.model.keypoint_layouts import find_layout
from stcalib_ros.core.monitoring.alarms import State, Verdict
from stcalib_ros.ros.coverage import CameraCoverage
from stcalib_ros.ros.coverage_markers import CameraState, cell_triangles, coverage_markers
from stcalib_ros.ros.image_planes import frustum_depth, frustum_plane, planes_of
from stcalib_ros.ros.marker_shapes import Pen, duration
from stcalib_ros.ros.markers import accuracy_text, camera_markers
from stcalib_ros.ros.people_markers import color_of, heat, people_markers
from stcalib_ros.ros.recognition import SeenImage
from stcalib_ros.ros.sightings import SeenPerson, Sighting
from stcalib_ros.ros.view_frame import view_before, view_by_cameras
from stcalib_ros.ros.views import Shown

LAYOUT = find_layout("h36m_17")
CALIBRATION = calibration()
PEN = Pen(Header(stamp=STAMP, frame_id="ref"), duration(1.0))
PLANES = planes_of(CALIBRATION, {}, np.eye(4))
UP = np.array([0.0, 0.0, 1.0])
NAN = float("nan")


def person(number: int, x: float = 0.0, *, end_s: float = 2.0) -> SeenPerson:
    """A person 1.6 m high who stands still from 0 s on."""
    joints = np.zeros((3, 17, 3))
    joints[..., 0], joints[..., 2] = x, np.linspace(0.0, 1.6, 17)
    return SeenPerson(number, LAYOUT, np.linspace(0.0, end_s, 3), joints)


def drawn(*people: SeenPerson, time_s: float = 1.0, **images: SeenImage) -> list[Marker]:
    sighting = Sighting(0.0, 2.0, people, {name: (image,) for name, image in images.items()})
    return people_markers(sighting, time_s, CALIBRATION, PLANES, up=UP, pen=PEN)


def keys(markers: list[Marker]) -> set[tuple[str, int]]:
    return {(marker.ns, marker.id) for marker in markers}


def xyz(marker: Marker) -> np.ndarray:
    return np.array([[p.x, p.y, p.z] for p in marker.points])


def test_people_have_their_number_as_id_and_one_color_everywhere():
    markers = drawn(person(4), person(7, 2.0))
    for number in (4, 7):
        own = [m for m in markers if m.id == number and m.ns != "residuals"]
        assert {"joints", "limbs", "people", "paths"} <= {m.ns for m in own}
        colors = {(m.color.r, m.color.g, m.color.b) for m in own}
        assert colors == {color_of(number)[:3]}
    assert color_of(4) != color_of(7)
    assert max(Counter((m.ns, m.id) for m in markers).values()) == 1
    assert [m.text for m in markers if m.text] == ["person 4", "person 7"]


def test_every_marker_has_frame_stamp_and_lifetime_and_something_to_draw():
    image = SeenImage(1.0, np.array([[10.0, 20.0]]), np.array([1.0]), ())
    for marker in drawn(person(0), cam0=image):
        assert (marker.header.frame_id, marker.header.stamp) == ("ref", STAMP)
        assert (marker.lifetime.sec, marker.action) == (1, Marker.ADD)
        assert marker.text or len(marker.points)
        assert np.isfinite(xyz(marker)).all()
        assert marker.pose.orientation.w == 1.0
        if marker.type == Marker.LINE_LIST:
            assert len(marker.points) % 2 == 0


def test_who_has_gone_is_deleted_once():
    shown = Shown()
    both = shown.update(drawn(person(0), person(1, 2.0)), PEN)
    assert all(m.action == Marker.ADD for m in both.markers)
    one = shown.update(drawn(person(1, 2.0)), PEN)
    gone = [m for m in one.markers if m.action == Marker.DELETE]
    assert {m.id for m in gone} == {0}
    assert {"joints", "limbs", "people", "paths"} <= {m.ns for m in gone}
    again = shown.update(drawn(person(1, 2.0)), PEN)
    assert all(m.action == Marker.ADD for m in again.markers)
    assert {m.action for m in shown.update([], PEN).markers} == {Marker.DELETE}


def test_who_is_not_there_at_that_time_is_not_drawn():
    assert drawn(person(0), time_s=3.0) == []
    assert {m.id for m in drawn(person(0), person(1, end_s=4.0), time_s=3.0)} == {1}


def test_keypoints_are_on_the_image_and_redder_the_worse_they_fit():
    usual = CALIBRATION.reprojection_rms_px
    image = SeenImage(1.0, np.array([[0.0, 0.0], [640.0, 480.0]]), np.array([0.0, 9 * usual]), ())
    (dots,) = (m for m in drawn(cam2=image) if m.ns == "residuals")
    assert dots.id == 2
    assert np.allclose(xyz(dots), PLANES["cam2"].corners[[0, 2]])
    assert [(c.r, c.g) for c in dots.colors] == [(0.0, 1.0), (1.0, 0.0)]
    assert heat(0.5)[:2] == (1.0, 1.0)


def test_a_person_in_an_image_is_drawn_where_the_camera_sees_them():
    camera = CALIBRATION.cameras[0]
    joints = camera.R_ref_cam @ np.array([0.3, 0.2, 4.0]) + camera.t_ref_cam
    seen = SeenPerson(0, LAYOUT, np.array([0.0, 1.0]), np.tile(joints, (2, 17, 1)))
    (lines,) = (m for m in drawn(seen) if m.ns == "in cam0")
    (pixel,) = project(np.array([[0.3, 0.2, 4.0]]), camera.intrinsics)
    assert np.allclose(xyz(lines), PLANES["cam0"].place(pixel))
    ray = (xyz(lines)[0] - camera.t_ref_cam) @ camera.R_ref_cam
    assert ray[2] == pytest.approx(frustum_depth(CALIBRATION))


def test_an_image_is_in_front_of_its_camera_with_its_corners_on_the_rays():
    camera = CALIBRATION.cameras[1]
    corners = frustum_plane(camera, 2.0).corners
    local = (corners - camera.t_ref_cam) @ camera.R_ref_cam
    assert np.allclose(local[:, 2], 2.0)
    pixels = [[0, 0], [640, 0], [640, 480], [0, 480]]
    assert np.allclose(project(local, camera.intrinsics), pixels)


def test_images_stand_upright_side_by_side_before_anything_is_calibrated():
    sizes = {f"cam{i}": (640.0, 480.0) for i in range(5)}
    T_ref_view = view_before(upright=False)
    planes = planes_of(None, sizes, T_ref_view)
    across = np.array([plane.across for plane in planes.values()])
    down = np.array([plane.down for plane in planes.values()])
    assert np.allclose(across, [1.0, 0.0, 0.0]), "x of an optical frame is to the right"
    assert np.allclose(down, [0.0, 0.75, 0.0]), "and y down"
    boxes = [plane.corners[[0, 2]][:, :2] for plane in planes.values()]
    for i, (low, high) in enumerate(boxes):
        for other_low, other_high in boxes[:i]:
            assert (low >= other_high).any() or (high <= other_low).any(), "none covers another"


def coverage(cells: np.ndarray, *, moving_s: int = 5, missing: str = "") -> CameraCoverage:
    return CameraCoverage(cells, moving_s, {"cam1": 5}, 10.0, missing)


def state_of(seen: CameraCoverage, verdict: State | None = None) -> CameraState:
    return CameraState(seen, None if verdict is None else Verdict("cam0", verdict), 2.5)


def test_cells_and_bars_are_as_large_as_what_they_show():
    cells = np.zeros((6, 8), dtype=bool)
    cells[0, 1] = cells[5, 7] = True
    triangles = cell_triangles(cells)
    assert triangles.shape == (12, 2)
    assert np.allclose(triangles[:6].min(0), [1 / 8, 0.0])
    assert np.allclose(triangles[6:].max(0), [1.0, 1.0])
    markers = coverage_markers({"cam0": state_of(coverage(cells))}, PLANES, {}, pen=PEN)
    bars = {m.id: xyz(m) for m in markers if m.ns == "bars"}
    plane = PLANES["cam0"]
    along = [np.ptp((bar - plane.origin) @ plane.across) / plane.width**2 for bar in bars.values()]
    assert np.allclose(along, [2 / 48, 0.5, 0.5])


@pytest.mark.parametrize(
    ("state", "color", "words"),
    [
        (state_of(coverage(np.ones((6, 8), bool))), "green", "cam0: ready"),
        (state_of(coverage(np.ones((6, 8), bool), missing="5 s more")), "yellow", "needs 5 s more"),
        (
            state_of(coverage(np.zeros((6, 8), bool), moving_s=0, missing="people who move")),
            "red",
            "needs people who move",
        ),
        (state_of(coverage(np.ones((6, 8), bool)), State.MOVED), "red", "watch: moved"),
        (state_of(coverage(np.ones((6, 8), bool)), State.OK), "green", "residual 2.5 px"),
    ],
)
def test_the_state_of_a_camera_is_said_and_colored(state, color, words):
    markers = coverage_markers({"cam0": state}, PLANES, {}, pen=PEN)
    (text,) = (m for m in markers if m.ns == "states")
    assert words in text.text
    r, g = text.color.r, text.color.g
    assert {"green": r < 0.5 < g, "yellow": min(r, g) > 0.5, "red": g < 0.5 < r}[color]


def test_pairs_have_lines_where_both_are_calibrated_and_share_people():
    cells = np.ones((6, 8), dtype=bool)
    states = {
        name: state_of(CameraCoverage(cells, 9, shared, 10.0, ""))
        for name, shared in {
            "cam0": {"cam1": 12, "cam2": 0},
            "cam1": {"cam0": 12, "cam2": 4},
            "cam2": {"cam0": 0, "cam1": 4},
        }.items()
    }
    centres = {c.name: c.t_ref_cam for c in CALIBRATION.cameras}
    markers = coverage_markers(states, PLANES, centres, pen=PEN)
    assert [(m.id, m.text) for m in markers if m.ns == "shared"] == [(1, "12 s"), (5, "4 s")]
    (line, _) = (m for m in markers if m.ns == "pairs")
    assert np.allclose(xyz(line), [centres["cam0"], centres["cam1"]])
    del centres["cam1"]
    assert not [m for m in coverage_markers(states, PLANES, centres, pen=PEN) if m.ns == "pairs"]
    assert max(Counter((m.ns, m.id) for m in markers).values()) == 1


def test_cameras_are_named_with_their_accuracy_and_an_ellipsoid():
    covariance = np.diag([0.01**2, 0.02**2, 0.03**2, 1e-4, 1e-4, 1e-4])
    sized = replace(CALIBRATION.cameras[0], R_ref_cam=np.eye(3), covariance=covariance)
    shown = camera_markers(replace(CALIBRATION, cameras=(sized,)), stamp=STAMP).markers
    assert [(m.ns, m.action) for m in shown[:1]] == [("", Marker.DELETEALL)]
    assert keys(shown[1:]) == {(ns, 0) for ns in ("frusta", "names", "accuracy", "uncertainty")}
    (ball,) = (m for m in shown if m.ns == "uncertainty")
    sizes = sorted((ball.scale.x, ball.scale.y, ball.scale.z))
    assert np.allclose(sizes, [6 * 0.01, 6 * 0.02, 6 * 0.03], rtol=0.2)
    assert "+-30.0 mm, +-0.57 deg" in accuracy_text(sized, metric=True)
    reference = replace(sized, covariance=np.zeros((6, 6)), time_offset_s=0.0)
    assert accuracy_text(reference, metric=True) == "reference"
    assert "baselines" in accuracy_text(sized, metric=False)


def test_the_view_has_z_up_and_looks_where_the_reference_does():
    sine, cosine = math.sin(0.4), math.cos(0.4)
    down = np.array([[1.0, 0.0, 0.0], [0.0, cosine, -sine], [0.0, sine, cosine]])
    cameras = tuple(
        replace(c, R_ref_cam=np.eye(3), t_ref_cam=np.array([0.0, -y, 0.0]))
        for c, y in zip(CALIBRATION.cameras, (1.0, 0.0, 3.0), strict=True)
    )
    T = view_by_cameras(replace(CALIBRATION, cameras=cameras))
    assert np.allclose(T[:3, :3], view_before(upright=False)[:3, :3])
    assert np.allclose(T @ [0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.0, 1.0]), "the lowest is on the floor"
    assert np.allclose(T @ [0.0, 0.0, 1.0, 1.0], [0.0, -1.0, 0.0, 1.0])
    tilted = tuple(replace(c, R_ref_cam=down) for c in cameras)
    up = view_by_cameras(replace(CALIBRATION, cameras=tilted))[:3, 2]
    assert np.allclose(up, -down[:, 1])
    world = replace(CALIBRATION, frame_id="world")
    assert np.allclose(view_by_cameras(world), np.eye(4))
    assert np.allclose(view_before(upright=True), np.eye(4))
