"""People and coverage as markers, while somebody has subscribed; what was seen, always."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from rclpy.clock import Clock, ClockType
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.core.monitoring.alarms import Verdict
from stcalib_ros.io.assemble import CameraImages
from stcalib_ros.ros.buffers import Buffers
from stcalib_ros.ros.camera_buffer import Counts
from stcalib_ros.ros.convert import time_message
from stcalib_ros.ros.coverage import CameraCoverage, Coverage, image_size
from stcalib_ros.ros.coverage_markers import CameraState, coverage_markers
from stcalib_ros.ros.image_planes import planes_of
from stcalib_ros.ros.limits import BACKWARDS_S, CHECK_S, GONE_S, SHOWN_HZ, SIGHT_S, VIEW_PEOPLE_S
from stcalib_ros.ros.lookout import Lookout
from stcalib_ros.ros.marker_shapes import Pen, duration
from stcalib_ros.ros.parameters import Settings
from stcalib_ros.ros.people_markers import people_markers
from stcalib_ros.ros.publishers import Publishers
from stcalib_ros.ros.sightings import SeenPerson
from stcalib_ros.ros.view_frame import view_before, view_by_cameras, view_by_people

_KEPT_MESSAGES = 10
"""Messages of markers that wait for a subscriber who is slow: two seconds of people."""

_TICKS_A_LOOK = 2
"""Ticks of `SHOWN_HZ`, count, after which it is seen whether there is enough for the next look:
copying the lists of images takes a millisecond or two with 12 cameras."""


class Shown:
    """What is shown on a topic, so that what is gone is deleted."""

    def __init__(self) -> None:
        self._there: set[tuple[str, int]] = set()

    def update(self, markers: Sequence[Marker], pen: Pen) -> MarkerArray:
        """Return the message that shows these markers and nothing else."""
        now = {(marker.ns, marker.id) for marker in markers}
        gone = [pen.gone(*key) for key in sorted(self._there - now)]
        self._there = now
        return MarkerArray(markers=[*gone, *markers])


class Views:
    """Publishes ``~/people`` and ``~/coverage``, and the frame to look at them from.

    Parameters
    ----------
    node : rclpy.node.Node
    settings : Settings
    buffers : Buffers
    publishers : Publishers
        Publish the frame, too.

    Attributes
    ----------
    coverage : mapping of str to CameraCoverage
        What the window has seen of every camera, as of the last second.
    """

    def __init__(
        self, node: Any, settings: Settings, buffers: Buffers, publishers: Publishers
    ) -> None:
        self._node, self._settings, self._buffers = node, settings, buffers
        self._tf = publishers
        qos = QoSProfile(depth=_KEPT_MESSAGES, reliability=ReliabilityPolicy.RELIABLE)
        self._people = node.create_publisher(MarkerArray, "~/people_markers", qos)
        self._covered = node.create_publisher(MarkerArray, "~/coverage_markers", qos)
        self._people_shown, self._coverage_shown = Shown(), Shown()
        self._lookout = Lookout(node.get_logger().warning)
        self._calibration: Calibration | None = None
        self._T_ref_view = np.eye(4)
        self._walked: list[SeenPerson] = []
        self._walked_s, self._walked_until_s = 0.0, -math.inf
        self._arriving: Mapping[str, float] = {}
        self._ticks = 0
        self._follower = Coverage(camera.name for camera in settings.cameras)
        self.coverage: Mapping[str, CameraCoverage] = {}
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(1.0 / SHOWN_HZ, self._show_people, clock=steady)

    def begin(self, calibration: Calibration | None) -> None:
        """Show people by another calibration from now on."""
        self._lookout.begin(calibration)
        self._calibration = calibration
        self._walked, self._walked_s, self._walked_until_s = [], 0.0, -math.inf
        if calibration is not None:
            self._T_ref_view = view_by_cameras(calibration)

    def refresh(
        self, settings: Settings, counts: Mapping[str, Counts], verdicts: Mapping[str, Verdict]
    ) -> None:
        """Take note of what the windows hold, and show it; called every second.

        Parameters
        ----------
        settings : Settings
            As they are now.
        counts : mapping of str to Counts
        verdicts : mapping of str to Verdict
            Of the watch, by camera.
        """
        self._settings = settings
        self._arriving = {name: count.age_s for name, count in counts.items()}
        windows = self._buffers.snapshot()
        self.coverage = self._follower.look(
            windows,
            self._buffers.moving(),
            min_score=settings.options.min_score,
            wanted_s=settings.min_motion_s,
            slack_s=2.0 * settings.options.offset_range_s,
        )
        if self._somebody_looks():
            self._show_frame(windows)
        if self._covered.get_subscription_count():
            self._show_coverage(windows, verdicts)

    def _somebody_looks(self) -> bool:
        topics = (self._people, self._covered)
        return any(publisher.get_subscription_count() for publisher in topics)

    def _show_coverage(
        self, windows: Iterable[CameraImages], verdicts: Mapping[str, Verdict]
    ) -> None:
        frame = self._reference_frame(windows)
        sizes = {w.name: s for w in windows if min(s := image_size(w)) > 0}
        calibrated = () if self._calibration is None else self._calibration.cameras
        if not frame:
            return
        pen = self._pen(frame, self._node.get_clock().now().to_msg(), CHECK_S + GONE_S)
        sight = self._lookout.sight
        states = {
            name: CameraState(seen, verdicts.get(name), sight.residual_px(name))
            for name, seen in self.coverage.items()
        }
        planes = planes_of(self._calibration, sizes, self._T_ref_view)
        centres = {camera.name: camera.t_ref_cam for camera in calibrated}
        markers = coverage_markers(states, planes, centres, pen=pen)
        self._covered.publish(self._coverage_shown.update(markers, pen))

    def _show_people(self) -> None:
        if self._calibration is None or not self._people.get_subscription_count():
            return
        self._ticks += 1
        if self._arriving and self._ticks % _TICKS_A_LOOK == 0 and self._lookout.ready:
            self._lookout.look(self._buffers.snapshot(), self._arriving, self._settings.options)
        if (time_s := self._lookout.time_to_show_s()) is None:
            return
        pen = self._pen(self._calibration.reference_frame, time_message(time_s), GONE_S)
        markers = people_markers(
            self._lookout.sight,
            time_s,
            self._calibration,
            planes_of(self._calibration, {}, self._T_ref_view),
            up=self._T_ref_view[:3, 2],
            pen=pen,
        )
        shown = self._people_shown.update(markers, pen)
        if shown.markers:
            self._people.publish(shown)

    def _show_frame(self, windows: Iterable[CameraImages]) -> None:
        """Publish the frame to look from; once people have walked a while, they give it."""
        if self._calibration is None:
            self._T_ref_view = view_before(upright=bool(self._settings.options.world_frame))
        else:
            self._stand_on_the_floor(self._calibration)
        if frame := self._reference_frame(windows):
            self._tf.show_view(self._settings.view_frame, frame, self._T_ref_view)

    def _stand_on_the_floor(self, calibration: Calibration) -> None:
        """Collect people until there are enough of them to tell up and the floor, once."""
        sight = self._lookout.sight
        if sight.end_s < self._walked_until_s - BACKWARDS_S:
            self._walked_until_s = -math.inf
        known = self._walked_s >= VIEW_PEOPLE_S
        if known or not sight.people or sight.start_s < self._walked_until_s:
            return
        self._walked, self._walked_until_s = [*self._walked, *sight.people], sight.end_s
        self._walked_s += SIGHT_S
        if self._walked_s >= VIEW_PEOPLE_S:
            by_people = view_by_people(calibration, self._walked)
            self._T_ref_view = self._T_ref_view if by_people is None else by_people
            self._walked = []

    def _reference_frame(self, windows: Iterable[CameraImages]) -> str:
        """Frame of the result, or what it will be; empty if that is not known yet."""
        if self._calibration is not None:
            return self._calibration.reference_frame
        options = self._settings.options
        reference = options.reference or self._settings.cameras[0].name
        frames = {w.name: w.frame_id or w.images[-1].frame_id for w in windows}
        return options.world_frame or frames.get(reference, "")

    def _pen(self, frame: str, stamp: Any, lifetime_s: float) -> Pen:
        return Pen(Header(stamp=stamp, frame_id=frame), duration(lifetime_s))
