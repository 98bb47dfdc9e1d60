"""The parser of all commands: errors in one line with the next step, and help."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from typing import Any, NoReturn

from stcalib_ros.core.errors import did_you_mean

_UNUSABLE = 2
"""Exit status where arguments cannot be used, as `InputError` has it."""


class CommandParser(argparse.ArgumentParser):
    """A parser whose errors are one line, and which knows what a mistyped word could be.

    Without any argument it prints its help, if it needs some.
    """

    def parse_known_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: Any = None
    ) -> tuple[argparse.Namespace, list[str]]:
        """Parse, as `argparse.ArgumentParser.parse_known_args` does."""
        words = list(sys.argv[1:] if args is None else args)
        if not words and any(action.required for action in self._actions):
            self.print_help(sys.stderr)
            self.exit(_UNUSABLE)
        self._require_known(words)
        return super().parse_known_args(words, namespace)

    def error(self, message: str) -> NoReturn:
        """Print one line and end with exit status 2."""
        self.exit(_UNUSABLE, f"{self.prog}: {message} (see {self.prog} --help)\n")

    def _require_known(self, words: Sequence[str]) -> None:
        """Before anything is missed: a mistyped option is usually what is missing."""
        options = list(self._option_string_actions)
        own = words[: words.index("--")] if "--" in words else words
        if self._subparsers is not None:  # what follows the command is its own
            command = next((i for i, word in enumerate(own) if not word.startswith("-")), len(own))
            own = own[:command]
        for word in own:
            name = word.partition("=")[0]
            if name.startswith("--") and not any(o.startswith(name) for o in options):
                self.error(f"unknown option {name}{did_you_mean(name, options)}")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Name what is near to an unknown choice, or all choices."""
        if action.choices is None or value in action.choices:
            return
        choices = [str(choice) for choice in action.choices]
        hint = did_you_mean(str(value), choices) or f": there are {', '.join(choices)}"
        if action.dest == argparse.SUPPRESS:
            self.error(f"unknown command {value}{hint}")
        raise argparse.ArgumentError(action, f"unknown value {str(value)!r}{hint}")


def add_printing_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what every command has: how much it prints, and as what."""
    group = parser.add_argument_group("printing")
    group.add_argument("--json", action="store_true", help="print one JSON object instead of text")
    group.add_argument("-q", "--quiet", action="store_true", help="print warnings and errors only")
    group.add_argument(
        "-v", "--verbose", action="store_true", help="also print how long every stage took"
    )
