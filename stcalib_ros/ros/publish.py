"""``ros2 run stcalib_ros publish``: a finished result on the topics of the live node."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stcalib_ros.cli import EPILOG, run_command
from stcalib_ros.commands.parser import CommandParser

if TYPE_CHECKING:
    from stcalib_ros.core.model.calibration import Calibration, CameraCalibration

_DESCRIPTION = """\
Publish a result file, latched, until Ctrl-C.

  publish walk.yaml
  publish walk.yaml --ros-args -p tf_suffix:=_calibrated

It has the topics of the live node: ~/result, ~/extrinsics, ~/time_offsets, ~/markers, /tf_static,
with the node's parameters publish_tf, tf_not_metric and tf_suffix, and the lens of every camera on
~/CAMERA/camera_info. ~ is /publish; to stand in for the live node:
--ros-args -r __node:=calibrator.
"""


@dataclass(frozen=True, slots=True)
class _PublisherSettings:
    """As `stcalib_ros.ros.publishers.PublisherSettings` has it."""

    cameras: Sequence[CameraCalibration]
    publish_tf: bool
    tf_not_metric: bool
    tf_suffix: str


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("result", type=Path, metavar="RESULT.yaml", help="result file to publish")


def publish_result(
    node: Any,
    calibration: Calibration,
    *,
    run_id: str,
    frame_rates: Mapping[str, float] | None = None,
    every_lens: bool = False,
) -> None:
    """Publish a calibration, stamped with the end of its data, as the live node does.

    Parameters
    ----------
    node : rclpy.node.Node
    calibration : Calibration
    run_id : str
    frame_rates : mapping of str to float, optional
        Images per second by camera.
    every_lens : bool
        Also lenses that were given, which in general a driver publishes.
    """
    from stcalib_ros.ros.convert import calibration_result, time_message
    from stcalib_ros.ros.parameter_specs import TF_SPECS
    from stcalib_ros.ros.parameters import declared, require_known
    from stcalib_ros.ros.publishers import Publishers

    tf = {spec.name: declared(node, spec) for spec in TF_SPECS}
    require_known(node)
    settings = _PublisherSettings(calibration.cameras, **tf)
    stamp = time_message(calibration.window_s[1])
    result = calibration_result(calibration, run_id=run_id, stamp=stamp, frame_rates=frame_rates)
    Publishers(node, settings, every_lens=every_lens).publish(calibration, result)


def main() -> int:
    """Do what the arguments of the process say.

    Returns
    -------
    int
        Exit status: 0 interrupted; 2 if the file is unusable, or ROS is not there.
    """
    try:
        from rclpy.utilities import remove_ros_args

        import stcalib_ros.ros.convert  # noqa: F401
    except ModuleNotFoundError as error:
        print(
            f"publish: no module {error.name!r}: source the workspace's install/setup.bash",
            file=sys.stderr,
        )
        return 2
    return run_command("publish", lambda: _publish(remove_ros_args(sys.argv)[1:]))


def _publish(argv: Sequence[str]) -> None:
    from stcalib_ros.io.results import read_usable_result
    from stcalib_ros.ros.running import running_node, spin_until

    path = _parsed(argv).result
    calibration = read_usable_result(path)
    with running_node("publish") as (node, stop):
        publish_result(node, calibration, run_id=f"file-{path.stem}", every_lens=True)
        node.get_logger().info(
            f"{path}: {len(calibration.cameras)} cameras stay published until interrupted (Ctrl-C)"
        )
        spin_until(stop, node)


def _parsed(argv: Sequence[str]) -> argparse.Namespace:
    parser = CommandParser(
        prog="publish",
        description=_DESCRIPTION,
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_arguments(parser)
    return parser.parse_args(argv)
