"""Small networks of the forms that the estimators have, made of a few operations of ONNX."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
from onnx import TensorProto, helper, numpy_helper

N_JOINTS = 17
CANDIDATES = 6


def save(
    path: Path,
    nodes: list[Any],
    constants: dict[str, Any],
    inputs: dict[str, list[Any]],
    outputs: list[str],
) -> Path:
    graph = helper.make_graph(
        nodes,
        "small",
        [helper.make_tensor_value_info(n, TensorProto.FLOAT, s) for n, s in inputs.items()],
        [helper.make_tensor_value_info(n, TensorProto.FLOAT, None) for n in outputs],
        [numpy_helper.from_array(np.asarray(v), n) for n, v in constants.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    path.write_bytes(model.SerializeToString())
    return path


def brightest_pixel_movenet(path: Path, scores: list[float]) -> Path:
    """All joints at the brightest pixel, 0.25 px beyond its centre as MoveNet is, of six persons.

    Parameters
    ----------
    scores : list of float
        Of the six persons; that of joints is always 0.9.
    """
    node = helper.make_node
    nodes = [
        node("ReduceMean", ["input"], ["grey"], axes=[3], keepdims=0),
        node("Shape", ["grey"], ["shape"]),
        node("Slice", ["shape", "one", "three"], ["sides"]),
        node("Slice", ["shape", "two", "three"], ["width"]),
        node("Reshape", ["grey", "flat"], ["pixels"]),
        node("ArgMax", ["pixels"], ["index"], axis=0),
        node("Div", ["index", "width"], ["row"]),
        node("Mod", ["index", "width"], ["column"]),
        node("Concat", ["row", "column"], ["place"], axis=0),
        node("Cast", ["place"], ["place_f"], to=TensorProto.FLOAT),
        node("Cast", ["sides"], ["sides_f"], to=TensorProto.FLOAT),
        node("Add", ["place_f", "beyond"], ["place_beyond"]),
        node("Div", ["place_beyond", "sides_f"], ["fraction"]),
        node("Concat", ["fraction", "joint_score"], ["joint"], axis=0),
        node("Tile", ["joint", "repeats"], ["joints"]),
        node("Reshape", ["joints", "persons"], ["all_joints"]),
        node("Concat", ["all_joints", "rest"], ["output"], axis=2),
    ]
    rest = np.zeros((1, CANDIDATES, 5), np.float32)
    rest[0, :, 4] = scores
    constants = {
        "one": np.array([1]),
        "two": np.array([2]),
        "three": np.array([3]),
        "flat": np.array([-1]),
        "beyond": np.full(2, 0.25, np.float32),
        "joint_score": np.full(1, 0.9, np.float32),
        "repeats": np.array([CANDIDATES * N_JOINTS]),
        "persons": np.array([1, CANDIDATES, 3 * N_JOINTS]),
        "rest": rest,
    }
    return save(path, nodes, constants, {"input": [1, "height", "width", 3]}, ["output"])


def constant_network(path: Path, outputs: dict[str, np.ndarray], side: int | str) -> Path:
    """Give the same values for every image (1, 3, side, side); it counts in by nothing."""
    node = helper.make_node
    nodes = [
        node("ReduceMin", ["input"], ["smallest"], keepdims=0),
        node("Mul", ["smallest", "zero"], ["nothing"]),
        *(node("Add", [f"{name}_value", "nothing"], [name]) for name in outputs),
    ]
    constants = {f"{name}_value": value.astype(np.float32) for name, value in outputs.items()}
    constants["zero"] = np.zeros((), np.float32)
    return save(path, nodes, constants, {"input": [1, 3, side, side]}, list(outputs))


def text(value: str) -> dict[str, str]:
    return {"s": base64.b64encode(value.encode()).decode()}


def numbers(*values: int) -> dict[str, Any]:
    return {"list": {"i": [str(value) for value in values]}}


class TfjsModel:
    """A graph model of TensorFlow.js in the making."""

    def __init__(self) -> None:
        self.nodes: list[dict[str, Any]] = [{"name": "input", "op": "Placeholder", "attr": {}}]
        self.weights: list[dict[str, Any]] = []
        self.data = b""

    def constant(self, name: str, value: Any, *, half: bool = False) -> str:
        array = np.asarray(value)
        kind = "int32" if array.dtype.kind == "i" else "float32"
        entry: dict[str, Any] = {"name": name, "shape": list(array.shape), "dtype": kind}
        if half:
            entry["quantization"] = {"dtype": "float16", "original_dtype": "float32"}
        self.weights.append(entry)
        self.data += array.astype("<i4" if kind == "int32" else "<f2" if half else "<f4").tobytes()
        self.nodes.append({"name": name, "op": "Const", "attr": {}})
        return name

    def node(self, op: str, name: str, *inputs: str, **attributes: Any) -> str:
        self.nodes.append({"name": name, "op": op, "input": list(inputs), "attr": attributes})
        return name

    def write(self, folder: Path) -> Path:
        (folder / "small.bin").write_bytes(self.data)
        model = {
            "modelTopology": {"node": self.nodes},
            "weightsManifest": [{"paths": ["small.bin"], "weights": self.weights}],
        }
        path = folder / "small.json"
        path.write_text(json.dumps(model))
        return path
