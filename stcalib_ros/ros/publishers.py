"""Everything that a calibration in force is published as, for late joiners, too."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Transform, TransformStamped, Vector3
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from visualization_msgs.msg import MarkerArray

from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.msg import CalibrationResult, CameraExtrinsics, TimeOffset
from stcalib_ros.ros.convert import extrinsics_messages
from stcalib_ros.ros.markers import camera_markers


def latched(depth: int = 1) -> QoSProfile:
    """QoS by which those who come late get the last `depth` messages."""
    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )


def transforms(calibration: Calibration, *, stamp: Time, suffix: str) -> list[TransformStamped]:
    """T_ref_cam of all cameras for /tf_static, but of the one whose frame is the reference.

    Parameters
    ----------
    calibration : Calibration
    stamp : builtin_interfaces.msg.Time
    suffix : str
        Added to the child frames.
    """
    out = []
    for extrinsics in extrinsics_messages(calibration, stamp=stamp):
        if extrinsics.child_frame_id == calibration.reference_frame:
            continue
        pose = extrinsics.pose.pose
        p = pose.position
        out.append(
            TransformStamped(
                header=extrinsics.header,
                child_frame_id=extrinsics.child_frame_id + suffix,
                transform=Transform(
                    translation=Vector3(x=p.x, y=p.y, z=p.z), rotation=pose.orientation
                ),
            )
        )
    return out


class PublisherSettings(Protocol):
    """What of the parameters says how to publish."""

    @property
    def cameras(self) -> Sequence[object]:
        """One entry of each camera."""

    @property
    def publish_tf(self) -> bool:
        """Publish on /tf_static."""

    @property
    def tf_not_metric(self) -> bool:
        """Also if lengths are not metres."""

    @property
    def tf_suffix(self) -> str:
        """Added to child frames on /tf_static."""


class Publishers:
    """Latched topics of the node.

    Parameters
    ----------
    node : rclpy.node.Node
    settings : PublisherSettings
    """

    def __init__(self, node: Any, settings: PublisherSettings) -> None:
        self._log, self._settings = node.get_logger(), settings
        per_camera = latched(len(settings.cameras))
        self._result = node.create_publisher(CalibrationResult, "~/result", latched())
        self._extrinsics = node.create_publisher(CameraExtrinsics, "~/extrinsics", per_camera)
        self._offsets = node.create_publisher(TimeOffset, "~/time_offsets", per_camera)
        self._markers = node.create_publisher(MarkerArray, "~/markers", latched())
        self._tf = self._tf_publisher(node) if settings.publish_tf else None

    def publish(self, calibration: Calibration, result: CalibrationResult) -> None:
        """Publish a calibration, of which `result` is the message, on all topics."""
        self._result.publish(result)
        for extrinsics in result.extrinsics:
            self._extrinsics.publish(extrinsics)
        for offset in result.time_offsets:
            self._offsets.publish(offset)
        self._markers.publish(camera_markers(calibration, stamp=result.header.stamp))
        self._publish_tf(calibration, result.header.stamp)

    def _publish_tf(self, calibration: Calibration, stamp: Time) -> None:
        if self._tf is None:
            return
        if not calibration.metric and not self._settings.tf_not_metric:
            self._log.warning(
                "/tf_static: not published, since lengths are not metres; "
                "set tf_not_metric to have it all the same"
            )
            return
        message_type, publisher = self._tf
        suffix = self._settings.tf_suffix
        publisher.publish(
            message_type(transforms=transforms(calibration, stamp=stamp, suffix=suffix))
        )

    def _tf_publisher(self, node: Any) -> tuple[Any, Any] | None:
        """Own publisher: tf2's broadcaster does not replace what it has sent."""
        try:
            from tf2_msgs.msg import TFMessage
        except ModuleNotFoundError:
            self._log.warning(
                "/tf_static: not published, since the package tf2_msgs is not installed; "
                "everything else works"
            )
            return None
        return TFMessage, node.create_publisher(TFMessage, "/tf_static", latched())
