"""Markers of points, lines, surfaces and text, as RViz and Foxglove draw them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Point, Pose, Quaternion, Vector3
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker

from stcalib_ros.core.geometry.so3 import quaternion_from_matrix
from stcalib_ros.core.model.arrays import Float64Array

Color = tuple[float, float, float, float]
"""Red, green, blue and opacity, 0 to 1."""


@dataclass(frozen=True, slots=True)
class Pen:
    """What markers of one message have in common.

    Attributes
    ----------
    header : std_msgs.msg.Header
    lifetime : builtin_interfaces.msg.Duration
        Zero: until they are deleted.
    """

    header: Header
    lifetime: Duration

    def points(
        self, ns: str, number: int, points: Float64Array, size: float, colors: Sequence[Color]
    ) -> Marker:
        """Return balls at points (N, 3), of one color or one each."""
        marker = self._marker(ns, number, Marker.SPHERE_LIST, colors)
        marker.scale = Vector3(x=size, y=size, z=size)
        return _with_points(marker, points)

    def lines(self, ns: str, number: int, ends: Float64Array, width: float, color: Color) -> Marker:
        """Return lines between every two of the points (2 N, 3)."""
        marker = self._marker(ns, number, Marker.LINE_LIST, [color])
        marker.scale = Vector3(x=width)
        return _with_points(marker, ends)

    def triangles(self, ns: str, number: int, corners: Float64Array, color: Color) -> Marker:
        """Return a surface of triangles with corners (3 N, 3)."""
        marker = self._marker(ns, number, Marker.TRIANGLE_LIST, [color])
        marker.scale = Vector3(x=1.0, y=1.0, z=1.0)
        return _with_points(marker, corners)

    def text(
        self, ns: str, number: int, at: Float64Array, height: float, color: Color, text: str
    ) -> Marker:
        """Return text that turns to whoever looks, its middle at a point."""
        marker = self._marker(ns, number, Marker.TEXT_VIEW_FACING, [color])
        marker.pose.position = point(at)
        marker.scale, marker.text = Vector3(z=height), text
        return marker

    def ellipsoid(
        self, ns: str, number: int, centre: Float64Array, half_axes: Float64Array, color: Color
    ) -> Marker:
        """Return an ellipsoid with half axes in the columns (3, 3), at right angles."""
        lengths = np.linalg.norm(half_axes, axis=0)
        R = half_axes / lengths
        if np.linalg.det(R) < 0.0:
            R = R * (1.0, 1.0, -1.0)
        x, y, z, w = map(float, quaternion_from_matrix(R))
        marker = self._marker(ns, number, Marker.SPHERE, [color])
        marker.pose = Pose(position=point(centre), orientation=Quaternion(x=x, y=y, z=z, w=w))
        marker.scale = Vector3(**dict(zip("xyz", map(float, 2.0 * lengths), strict=True)))
        return marker

    def gone(self, ns: str, number: int) -> Marker:
        """Return the deletion of a marker."""
        return Marker(header=self.header, ns=ns, id=number, action=Marker.DELETE)

    def _marker(self, ns: str, number: int, kind: int, colors: Sequence[Color]) -> Marker:
        own = [_color(color) for color in colors]
        return Marker(
            header=self.header,
            ns=ns,
            id=number,
            type=kind,
            pose=Pose(orientation=Quaternion(w=1.0)),
            color=own[0],
            colors=own if len(own) > 1 else [],
            lifetime=self.lifetime,
        )


def duration(seconds: float) -> Duration:
    """Return the message of a duration."""
    whole, rest = divmod(seconds, 1.0)
    return Duration(sec=int(whole), nanosec=round(rest * 1e9))


def point(p: Iterable[float]) -> Point:
    """Return the message of a point (3,)."""
    x, y, z = map(float, p)
    return Point(x=x, y=y, z=z)


def _color(color: Color) -> ColorRGBA:
    r, g, b, a = color
    return ColorRGBA(r=r, g=g, b=b, a=a)


def _with_points(marker: Marker, points: Float64Array) -> Marker:
    marker.points = [Point(x=x, y=y, z=z) for x, y, z in np.asarray(points, float).tolist()]
    return marker
