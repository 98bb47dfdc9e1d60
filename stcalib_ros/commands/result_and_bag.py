"""What ``people``, ``clocks``, ``draw`` and ``report`` have in common: a result, and its bag."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from stcalib_ros.core.model.recording import Recording
    from stcalib_ros.io.config import Config

# What computes is imported by the functions that need it, for `--help` to be quick.


def add_result_and_bag_arguments(parser: argparse.ArgumentParser, bag: str) -> None:
    """Add ``RESULT.yaml``, ``BAG`` and ``--config``.

    Parameters
    ----------
    parser : ArgumentParser
    bag : str
        What the bag is to be, for the help.
    """
    parser.add_argument("result", type=Path, metavar="RESULT.yaml", help="result of a calibration")
    parser.add_argument("bag", type=Path, metavar="BAG", help=bag)
    parser.add_argument(
        *("-c", "--config"), type=Path, metavar="FILE", help="as for `stcalib calibrate`"
    )


def read_bag_as_configured(args: argparse.Namespace) -> tuple[Recording, Config]:
    """Read the bag by the configuration, and return both.

    Parameters
    ----------
    args : Namespace
        With `bag`, `config` and `decoder`.

    Raises
    ------
    InputError
        A file is unusable.
    """
    from stcalib_ros.commands.terminal import warn
    from stcalib_ros.io.bag import read_bag
    from stcalib_ros.io.config import Config, read_config

    config = Config() if args.config is None else read_config(args.config)
    recording = read_bag(args.bag, selection=config.selection, decoder=args.decoder, warn=warn)
    return recording, config
