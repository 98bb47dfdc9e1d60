"""YAML files in, with errors of one line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from stcalib_ros.core.errors import InputError


class _Loader(yaml.SafeLoader):
    """Safe, and strict about keys that are given twice."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Build a mapping; a key that is there twice is an error."""
        keys = [self.construct_object(key, deep=True) for key, _ in node.value]
        for key in keys:
            if isinstance(key, str) and keys.count(key) > 1:
                raise yaml.constructor.ConstructorError(
                    None, None, f"{key!r} is given twice", node.start_mark
                )
        return super().construct_mapping(node, deep)


def read_yaml(path: Path) -> Any:
    """Content of a YAML file.

    Raises
    ------
    InputError
        The file cannot be read, is not YAML, or gives a key twice.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise InputError(f"no such file: {path}") from None
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is not a text file") from error
    return parse_yaml(text, str(path))


def parse_yaml(text: str, what: str) -> Any:
    """Content of YAML text; `what` names it in errors.

    Raises
    ------
    InputError
        It is not YAML, or gives a key twice.
    """
    try:
        return yaml.load(text, Loader=_Loader)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise InputError(f"{what} is not valid YAML: {' '.join(str(error).split())}") from error
