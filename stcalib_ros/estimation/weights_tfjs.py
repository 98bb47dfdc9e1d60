"""Graph models of TensorFlow.js: a file with the graph, and one with the weights."""

from __future__ import annotations

import base64
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stcalib_ros.core.errors import InputError

_TYPES = {"float32": "<f4", "float16": "<f2", "int32": "<i4", "bool": "|b1"}
"""Types of numbers in a file of weights, by the names that the format gives them."""


@dataclass(frozen=True, slots=True)
class TfjsNode:
    """One operation of a graph.

    Attributes
    ----------
    name, op : str
        Its own name, and that of the operation, as in TensorFlow.
    inputs : tuple of str
        Names of nodes; ``name:1`` is the second output of a node.
    attributes : dict
        As in the file, by name.
    """

    name: str
    op: str
    inputs: tuple[str, ...]
    attributes: dict[str, Any]

    def integers(self, name: str) -> list[int]:
        """Return a list of whole numbers among the attributes; empty where it is not given."""
        return [int(i) for i in self.attributes.get(name, {}).get("list", {}).get("i", [])]

    def integer(self, name: str) -> int:
        """Return a whole number among the attributes; 0 where it is not given."""
        return int(self.attributes.get(name, {}).get("i", 0))

    def flag(self, name: str) -> bool:
        """Return a truth value among the attributes; false where it is not given."""
        return bool(self.attributes.get(name, {}).get("b", False))

    def kind(self, name: str) -> str:
        """Return a type of numbers among the attributes, as in ``DT_INT32``."""
        return str(self.attributes[name]["type"])

    def text(self, name: str) -> str:
        """Return a text among the attributes."""
        return base64.b64decode(self.attributes[name]["s"]).decode()

    def texts(self, name: str) -> list[str]:
        """Return a list of texts among the attributes; empty where it is not given."""
        coded = self.attributes.get(name, {}).get("list", {}).get("s", [])
        return [base64.b64decode(text).decode() for text in coded]


@dataclass(frozen=True, slots=True)
class TfjsGraph:
    """A graph model.

    Attributes
    ----------
    nodes : tuple of TfjsNode
        Each after those that it takes its inputs from; without the constants.
    constants : dict of ndarray
        Weights and other constants, by the names of their nodes: float32, int64 or bool.
    """

    nodes: tuple[TfjsNode, ...]
    constants: dict[str, NDArray[Any]]


def read_tfjs(path: Path) -> TfjsGraph:
    """Read a graph model with its weights, which are in files beside it.

    Raises
    ------
    InputError
        A file is missing, damaged, or of another form.
    """
    try:
        model = json.loads(path.read_text(encoding="utf-8"))
        constants: dict[str, NDArray[Any]] = {}
        for group in model["weightsManifest"]:
            data = b"".join((path.parent / name).read_bytes() for name in group["paths"])
            constants |= _weights(group["weights"], data)
        nodes = [_node(node) for node in model["modelTopology"]["node"]]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path} is no graph model of TensorFlow.js: {error}") from error
    return TfjsGraph(tuple(n for n in nodes if n.op != "Const"), constants)


def _node(node: dict[str, Any]) -> TfjsNode:
    inputs = tuple(node.get("input", ()))
    return TfjsNode(node["name"], node["op"], inputs, node.get("attr", {}))


def _weights(entries: list[dict[str, Any]], data: bytes) -> dict[str, NDArray[Any]]:
    """Cut the contents of a file of weights into arrays."""
    arrays, start = {}, 0
    for entry in entries:
        stored = entry.get("quantization", {}).get("dtype", entry["dtype"])
        count = int(np.prod(entry["shape"], dtype=np.int64))
        array = np.frombuffer(data, _TYPES[stored], count, start).reshape(entry["shape"])
        arrays[entry["name"]] = array.astype(_in_use(entry["dtype"]))
        start += array.nbytes
    if start != len(data):
        raise ValueError(f"{len(data)} bytes of weights, but {start} are described")
    return arrays


def _in_use(kind: str) -> type[np.generic]:
    if kind == "int32":  # ONNX has shapes and indices in 64 bits
        return np.int64
    return np.bool_ if kind == "bool" else np.float32
