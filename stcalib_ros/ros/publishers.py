"""Everything that a calibration in force is published as, for late joiners, too."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Protocol

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Transform, TransformStamped, Vector3
from rclpy.exceptions import InvalidTopicNameException
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo
from visualization_msgs.msg import MarkerArray

from stcalib_ros.core.model.calibration import Calibration
from stcalib_ros.core.model.lens_knowledge import LensKnowledge
from stcalib_ros.msg import CalibrationResult, CameraExtrinsics, CameraIntrinsics, TimeOffset
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


class NamedCamera(Protocol):
    """A camera that something is published of."""

    @property
    def name(self) -> str:
        """Its name in the configuration."""


class PublisherSettings(Protocol):
    """What of the parameters says how to publish."""

    @property
    def cameras(self) -> Sequence[NamedCamera]:
        """All cameras."""

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
    every_lens : bool
        Publish lenses that were given, too, where no driver does.
    """

    def __init__(self, node: Any, settings: PublisherSettings, *, every_lens: bool = False) -> None:
        self._log, self._settings = node.get_logger(), settings
        self._every_lens = every_lens
        per_camera = latched(len(settings.cameras))
        self._result = node.create_publisher(CalibrationResult, "~/result", latched())
        self._extrinsics = node.create_publisher(CameraExtrinsics, "~/extrinsics", per_camera)
        self._offsets = node.create_publisher(TimeOffset, "~/time_offsets", per_camera)
        self._markers = node.create_publisher(MarkerArray, "~/markers", latched())
        self._lenses = {c.name: self._lens_publisher(node, c.name) for c in settings.cameras}
        self._lenses_published: set[str] = set()
        self._tf = self._tf_publisher(node) if settings.publish_tf else None

    def publish(self, calibration: Calibration, result: CalibrationResult) -> None:
        """Publish a calibration, of which `result` is the message, on all topics."""
        self._result.publish(result)
        for extrinsics in result.extrinsics:
            self._extrinsics.publish(extrinsics)
        for offset in result.time_offsets:
            self._offsets.publish(offset)
        self._publish_lenses(result.intrinsics)
        self._markers.publish(camera_markers(calibration, stamp=result.header.stamp))
        self._publish_tf(calibration, result.header.stamp)

    def _publish_lenses(self, lenses: Iterable[CameraIntrinsics]) -> None:
        """Publish those that were estimated, and what follows them: a driver has the others."""
        for lens in lenses:
            publisher = self._lenses.get(lens.camera)
            wanted = self._every_lens or lens.knowledge != LensKnowledge.GIVEN.value
            if publisher is not None and (wanted or lens.camera in self._lenses_published):
                self._lenses_published.add(lens.camera)
                publisher.publish(lens.camera_info)

    def _lens_publisher(self, node: Any, camera: str) -> Any:
        """Return a publisher; None for a camera of a bag whose name can be in no topic."""
        try:
            return node.create_publisher(CameraInfo, f"~/{camera}/camera_info", latched())
        except InvalidTopicNameException:
            self._log.warning(
                f"camera {camera}: its name cannot be part of a topic; CameraInfo is not published"
            )
            return None

    def _publish_tf(self, calibration: Calibration, stamp: Time) -> None:
        if self._tf is None:
            return
        if not calibration.metric and not self._settings.tf_not_metric:
            self._log.warning(
                "/tf_static: not published, since lengths are not metres; "
                "set tf_not_metric to publish all the same"
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
