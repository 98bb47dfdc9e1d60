"""``stcalib completion``: have a shell complete commands and options."""

from __future__ import annotations

import argparse

from stcalib_ros.core.errors import InputError

_SHELLS = ("bash", "zsh", "tcsh")

DESCRIPTION = """\
Print what makes a shell complete the commands and options of stcalib.

  stcalib completion bash > ~/.local/share/bash-completion/completions/stcalib
  stcalib completion zsh > ~/.zfunc/_stcalib       (with ~/.zfunc in fpath)

Needs the package shtab: pip install 'stcalib-ros[completion]'.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("shell", choices=_SHELLS, metavar="SHELL", help=", ".join(_SHELLS))


def run(args: argparse.Namespace) -> None:
    """Print the script of a shell.

    Raises
    ------
    InputError
        The package that writes it is missing.
    """
    try:
        import shtab
    except ModuleNotFoundError:
        raise InputError(
            "completion needs the Python package shtab: pip install 'stcalib-ros[completion]'"
        ) from None
    from stcalib_ros.cli import whole_parser

    print(shtab.complete(whole_parser(), args.shell))
