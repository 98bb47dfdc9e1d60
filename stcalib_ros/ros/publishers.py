"""Everything that a calibration in force is published as, for late joiners, too."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Protocol

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from rclpy.exceptions import InvalidTopicNameException
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo
from std_msgs.msg import Header
from visualization_msgs.msg import MarkerArray

from stcalib_ros.core.geometry.so3 import quaternion_from_matrix
from stcalib_ros.core.model.arrays import Float64Array
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
        self._node = node
        self._tf: tuple[Any, Any] | None = None
        self._frames: list[TransformStamped] = []
        self._view: TransformStamped | None = None
        self._has_tf = True
        if settings.publish_tf:
            self._open_tf()

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

    def show_view(self, name: str, parent: str, T_ref_view: Float64Array) -> None:
        """Publish a frame to look from on /tf_static, whatever the unit of length is.

        It has no children, so that it fits into any tree of frames.

        Parameters
        ----------
        name : str
            Its name; empty: it is not published.
        parent : str
            Reference frame.
        T_ref_view : (4, 4) ndarray
        """
        x, y, z, w = map(float, quaternion_from_matrix(T_ref_view[:3, :3]))
        place = dict(zip("xyz", map(float, T_ref_view[:3, 3]), strict=True))
        frame = TransformStamped(
            header=Header(frame_id=parent),
            child_frame_id=name,
            transform=Transform(
                translation=Vector3(**place), rotation=Quaternion(x=x, y=y, z=z, w=w)
            ),
        )
        if name and frame != self._view:
            self._view = frame
            self._open_tf()
            self._send_frames()

    def _publish_tf(self, calibration: Calibration, stamp: Time) -> None:
        if self._tf is None or not self._settings.publish_tf:
            return
        self._frames = []
        if calibration.metric or self._settings.tf_not_metric:
            self._frames = transforms(calibration, stamp=stamp, suffix=self._settings.tf_suffix)
            self._send_frames()
            return
        self._log.warning(
            "/tf_static: not published, since lengths are not metres; "
            "set tf_not_metric to publish all the same"
        )

    def _send_frames(self) -> None:
        """Send all frames in one message: who comes late gets the last one only."""
        if self._tf is not None:
            message_type, publisher = self._tf
            view = [] if self._view is None else [self._view]
            publisher.publish(message_type(transforms=[*self._frames, *view]))

    def _open_tf(self) -> None:
        """Open /tf_static, once: tf2's own broadcaster does not replace what it has sent."""
        if self._tf is not None or not self._has_tf:
            return
        try:
            from tf2_msgs.msg import TFMessage
        except ModuleNotFoundError:
            self._has_tf = False
            self._log.warning(
                "/tf_static: not published, since the package tf2_msgs is not installed; "
                "everything else works"
            )
            return
        self._tf = TFMessage, self._node.create_publisher(TFMessage, "/tf_static", latched())
