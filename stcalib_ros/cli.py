"""The command ``stcalib``."""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING

from stcalib_ros import __version__
from stcalib_ros.commands.parser import CommandParser, add_printing_arguments
from stcalib_ros.core.errors import StcalibError, one_line
from stcalib_ros.threads import use_one_thread

if TYPE_CHECKING:
    from stcalib_ros.io.bag import Decoder

INTERRUPTED = 130
"""Exit status after Ctrl-C, as shells report it: 128 plus the number of SIGINT."""

_MAX_ERROR = 5000
"""Characters. An error is cut here: one that names each of 64 cameras with its reason fits."""

_OF_BAGS = ("mcap", "lz4", "zstandard")
"""Packages that only bags need; those of a distribution do not bring the first."""

_COMMANDS = {
    "calibrate": "calibrate the cameras of a bag",
    "clocks": "print how to trim videos so that they are synchronous",
    "draw": "draw the people of a result into films",
    "doctor": "show what is in a bag, and predict whether it will calibrate",
    "estimate": "make a bag from films, with a pose estimator",
    "evaluate": "compare a result with the true values",
    "report": "write the report of a result, for the browser",
    "people": "write how people in a bag move in 3D",
    "simulate": "make a simulated bag, with the true values",
    "convert": "make a bag from pose files of other programs",
    "export": "write a result in the format of another program",
    "place": "put a result into the frame of a floor plan or map",
    "models": "list pose estimators, or fetch their weights",
    "completion": "print a script for shell completion",
}

_DESCRIPTION = """\
Calibrate cameras from people walking: where cameras are, how clocks differ, who is who.
Needs no ROS; within ROS, `ros2 run stcalib_ros replay` does the same as `stcalib calibrate`.
"""

EPILOG = """\
exit status:
  0    done, and the files are there
  2    unusable arguments or files
  3    no trustworthy calibration from this data
  130  interrupted (Ctrl-C); nothing half done is left behind
"""


def main(argv: Sequence[str] | None = None, *, decoder: Decoder | None = None) -> int:
    """Run ``stcalib``.

    Parameters
    ----------
    argv : sequence of str, optional
        Arguments without the program's name; default: those of the process.
    decoder : callable, optional
        Decodes the messages of bags, as `stcalib_ros.io.bag.read_bag` has it.

    Returns
    -------
    int
        Exit status: 0 done, 2 unusable arguments or files, 3 no trustworthy calibration,
        130 interrupted.
    """
    use_one_thread()
    argv = sys.argv[1:] if argv is None else list(argv)

    def command() -> None:
        args = _parser([arg for arg in argv if not arg.startswith("-")][:1]).parse_args(argv)
        args.decoder = decoder
        args.run(args)

    return run_command("stcalib", command)


def run_command(name: str, command: Callable[[], object]) -> int:
    """Run a command; an error becomes one line on standard error and an exit status.

    Parameters
    ----------
    name : str
        Begins the line.
    command : callable

    Returns
    -------
    int
        0, the exit status of the error, or `INTERRUPTED`.
    """
    try:
        command()
        sys.stdout.flush()
    except StcalibError as error:
        return _failed(name, error, error.exit_status)
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in _OF_BAGS:
            raise
        what = f"bags need the Python package {error.name}: install it with pip install mcap"
        return _failed(name, what, StcalibError.exit_status)
    except KeyboardInterrupt:
        return _failed(name, "interrupted", INTERRUPTED)
    except BrokenPipeError:  # as in `stcalib ... | head`
        _close_output()
    except OSError as error:  # of a full disk below standard output, of rights on the way to a file
        _close_output()
        return _failed(name, error, StcalibError.exit_status)
    except MemoryError:
        what = "out of memory: use a shorter part of the data, or fewer people"
        return _failed(name, what, StcalibError.exit_status)
    return 0


def _failed(name: str, error: Exception | str, status: int) -> int:
    print(f"{name}: {one_line(str(error), _MAX_ERROR)}", file=sys.stderr)
    return status


def _close_output() -> None:
    """Have the end of the process not write what standard output did not take."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def whole_parser() -> argparse.ArgumentParser:
    """Return the parser with all commands and their options."""
    return _parser(_COMMANDS)


def _parser(called: Collection[str]) -> argparse.ArgumentParser:
    """Parser with the options of the commands that are called; the others are not imported."""
    parser = CommandParser(
        prog="stcalib",
        description=_DESCRIPTION,
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"stcalib {__version__}")
    subparsers = parser.add_subparsers(metavar="COMMAND", required=True)
    for name, summary in _COMMANDS.items():
        command = subparsers.add_parser(
            name,
            help=summary,
            epilog=EPILOG,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        if name in called:
            module = importlib.import_module(f"stcalib_ros.commands.{name}")
            command.description = module.DESCRIPTION
            module.add_arguments(command)
            add_printing_arguments(command)
            command.set_defaults(run=module.run)
    return parser
