"""``ros2 run stcalib_ros replay``: calibrates from a bag, publishes the result, plays the bag."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from stcalib_ros.cli import EPILOG, run_command
from stcalib_ros.commands import calibrate
from stcalib_ros.commands.film_arguments import bag_of
from stcalib_ros.commands.parser import CommandParser, add_printing_arguments
from stcalib_ros.ros.limits import WAIT_S

if TYPE_CHECKING:
    from stcalib_ros.core.model.calibration import Calibration
    from stcalib_ros.core.model.recording import Recording

_DESCRIPTION = """\
Calibrate from a bag, publish the result, play the bag to others: each of them if asked to.

  replay walk.mcap --output walk.yaml                 as `stcalib calibrate` does
  replay walk.mcap --output walk.yaml --publish       and publish it, latched, until Ctrl-C
  replay walk.mcap --play --clock                     play, for a live node with use_sim_time
  replay walk.mcap --output walk.yaml --publish --play --clock --loop     everything, for RViz

--publish has the topics of the live node: ~/result, ~/extrinsics, ~/time_offsets, ~/markers and
/tf_static, with its parameters publish_tf, tf_not_metric and tf_suffix. ~ is /replay; to stand in
for the live node: --ros-args -r __node:=calibrator. If there is no trustworthy result, nothing is
published or played, and the exit status is 3.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command: those of ``stcalib calibrate`` and some for ROS."""
    calibrate.add_arguments(parser, output_required=False)
    add_printing_arguments(parser)
    ros = parser.add_argument_group("ROS", "after BAG; what follows --ros-args is for ROS itself")
    ros.add_argument(
        "--publish",
        action="store_true",
        help="publish the result on the live node's topics and stay until interrupted",
    )
    ros.add_argument(
        "--play",
        type=_positive,
        nargs="?",
        const=1.0,
        metavar="RATE",
        help="publish the bag's poses and CameraInfo, RATE times as fast as recorded (default: 1); "
        "after the calibration if --output asks for one, else without any",
    )
    ros.add_argument(
        "--clock",
        type=_positive,
        nargs="?",
        const=40.0,
        metavar="HZ",
        help="with --play: publish the time of the bag on /clock (default: 40 times a second)",
    )
    ros.add_argument(
        "--loop", action="store_true", help="with --play: begin again at the end, until interrupted"
    )
    ros.add_argument(
        "--wait",
        type=_not_negative,
        metavar="S",
        help="with --play: wait at most S seconds until somebody listens to every topic "
        f"(default: {WAIT_S:g})",
    )


def main() -> int:
    """Do what the arguments of the process say.

    Returns
    -------
    int
        Exit status: that of ``stcalib calibrate``, 0 also if interrupted while publishing or
        playing; 2 if ROS is not there.
    """
    try:
        from rclpy.utilities import remove_ros_args

        import stcalib_ros.ros.convert  # noqa: F401
    except ModuleNotFoundError as error:
        print(
            f"replay: no module {error.name!r}: source the workspace's install/setup.bash, "
            "or use `stcalib calibrate`, which needs no ROS",
            file=sys.stderr,
        )
        return 2
    return run_command("replay", lambda: _replay(remove_ros_args(sys.argv)[1:]))


def _replay(argv: Sequence[str]) -> None:
    from stcalib_ros.ros.convert import decode

    args = _parsed(argv)
    args.decoder = decode
    if args.output is None:
        args.bag, calibrated = bag_of(args), None
    else:
        calibrated = calibrate.run(args)
    if args.publish or args.play is not None:
        _serve(args, calibrated)


def _parsed(argv: Sequence[str]) -> argparse.Namespace:
    parser = CommandParser(
        prog="replay",
        description=_DESCRIPTION,
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_arguments(parser)
    args = parser.parse_args(argv)
    if args.output is None and args.play is None:
        parser.error("nothing to do: --output OUT.yaml calibrates, --play plays")
    if args.output is None and (args.publish or args.report is not None):
        parser.error("--publish and --report need a calibration: add --output OUT.yaml")
    if args.play is None and (args.clock is not None or args.loop or args.wait is not None):
        parser.error("--clock, --loop and --wait go with --play")
    return args


def _serve(args: argparse.Namespace, calibrated: tuple[Recording, Calibration] | None) -> None:
    """Publish and play, until done or interrupted."""
    from stcalib_ros.ros.player import Player, PlayOptions
    from stcalib_ros.ros.running import running_node, spin_until

    with running_node("replay") as (node, stop):
        if args.publish and calibrated is not None:
            _publish(node, *calibrated, run_id=f"replay-{args.bag.stem}")
        if args.play is not None:
            wait_s = WAIT_S if args.wait is None else args.wait
            options = PlayOptions(args.play, args.clock, args.loop, wait_s)
            Player(node, args.bag, calibrate.config_of(args).selection, options).play(stop)
        if args.publish:
            node.get_logger().info("the result stays published until interrupted (Ctrl-C)")
            spin_until(stop, node)


def _publish(node: Any, recording: Recording, calibration: Calibration, *, run_id: str) -> None:
    from stcalib_ros.ros.publish import publish_result

    stamps = {camera.name: camera.stamps for camera in recording.cameras}
    rates = {n: (len(s) - 1) / (s[-1] - s[0]) for n, s in stamps.items() if s[-1] > s[0]}
    publish_result(node, calibration, run_id=run_id, frame_rates=rates)


def _positive(text: str) -> float:
    value = float(text)
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is not above 0")
    return value


def _not_negative(text: str) -> float:
    value = float(text)
    if not 0.0 <= value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is below 0")
    return value
