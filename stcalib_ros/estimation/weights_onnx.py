"""From a graph of TensorFlow.js to ONNX: the operations that networks of poses are made of.

The known converter, tf2onnx 1.17, fails on such a graph with NumPy 2 and with TensorFlow 2.21, and
its TensorFlow alone is 1.6 GB on disk. This one needs the package onnx (30 MB), takes a second, and
gives the same bytes each time. Whole numbers have 64 bits throughout, as shapes in ONNX must.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

from stcalib_ros.core.errors import InputError
from stcalib_ros.estimation.weights_tfjs import TfjsGraph, TfjsNode

_OPSET = 17
"""Version of ONNX's operators: the last in which sizes of splits and axes of maxima need no more
inputs; ONNX Runtime reads it since 1.12."""

_IR_VERSION = 8
"""Version of ONNX's file format, the one that belongs to those operators: readable since 1.12."""

_END = 2**31 - 1
"""Index beyond every axis: the end of a slice that has none, as ONNX has it."""

_KINDS = {"DT_FLOAT": TensorProto.FLOAT, "DT_INT32": TensorProto.INT64, "DT_BOOL": TensorProto.BOOL}

_SAME_NAME = {
    "AddV2": "Add",
    "Sub": "Sub",
    "Mul": "Mul",
    "RealDiv": "Div",
    "FloorDiv": "Div",
    "Maximum": "Max",
    "Minimum": "Min",
    "Less": "Less",
    "Greater": "Greater",
    "GreaterEqual": "GreaterOrEqual",
    "Equal": "Equal",
    "LogicalAnd": "And",
    "Abs": "Abs",
    "Sigmoid": "Sigmoid",
    "Exp": "Exp",
    "Reciprocal": "Reciprocal",
    "Identity": "Identity",
    "AddN": "Sum",
    "Shape": "Shape",
    "Size": "Size",
    "Range": "Range",
    "Reshape": "Reshape",
    "Tile": "Tile",
    "GatherNd": "GatherND",
    "Select": "Where",
}
"""Operations that take the same inputs in both; divisions of whole numbers are of positive ones."""


def to_onnx(graph: TfjsGraph, output: str) -> bytes:
    """Convert a graph; the result is a file of ONNX.

    Parameters
    ----------
    graph : TfjsGraph
    output : str
        Name of the node whose value is wanted. Its input is an image, (1, height, width, 3) float.

    Raises
    ------
    InputError
        There is an operation in it that is not known here.
    """
    builder = _Builder(graph.constants)
    for node in graph.nodes:
        if node.op == "Placeholder":
            image = node.name
        elif node.op in _SAME_NAME:
            builder.add(_SAME_NAME[node.op], node.inputs, [node.name])
        elif node.op in _CONVERTERS:
            _CONVERTERS[node.op](builder, node)
        else:
            raise InputError(f"{node.name}: no way to convert the operation {node.op} to ONNX")
    shape = [1, "height", "width", 3]
    model = helper.make_model(
        helper.make_graph(
            builder.nodes,
            "stcalib",
            [helper.make_tensor_value_info(image, TensorProto.FLOAT, shape)],
            [helper.make_tensor_value_info(output, TensorProto.FLOAT, None)],
            builder.used_constants(),
        ),
        opset_imports=[helper.make_opsetid("", _OPSET)],
        ir_version=_IR_VERSION,
    )
    return bytes(model.SerializeToString(deterministic=True))


class _Builder:
    """Nodes of ONNX and the constants that they use."""

    def __init__(self, constants: dict[str, NDArray[Any]]) -> None:
        self.constants = dict(constants)
        self.nodes: list[onnx.NodeProto] = []

    def add(self, op: str, inputs: Sequence[str], outputs: Sequence[str], **given: Any) -> str:
        """Add a node; the first output of a node has no ``:0``."""
        inputs = [name.removesuffix(":0") for name in inputs]
        self.nodes.append(helper.make_node(op, inputs, list(outputs), **given))
        return outputs[0]

    def constant(self, name: str, value: NDArray[Any] | list[int]) -> str:
        """Add a constant of our own; lists are of whole numbers."""
        self.constants[name] = np.asarray(value)
        return name

    def value(self, name: str) -> NDArray[Any]:
        """Value of an input that has to be a constant."""
        try:
            return self.constants[name]
        except KeyError:
            raise InputError(f"{name} is no constant, which ONNX wants there") from None

    def used_constants(self) -> list[onnx.TensorProto]:
        """Return those that a node takes, in their order."""
        used = {name for node in self.nodes for name in node.input}
        return [
            numpy_helper.from_array(np.asarray(value, order="C"), name)
            for name, value in self.constants.items()
            if name in used
        ]

    def channels_first(self, name: str, node: TfjsNode) -> str:
        """Return an image with its channels before its rows, as ONNX has them."""
        return self.add("Transpose", [name], [f"{node.name}/first"], perm=[0, 3, 1, 2])

    def channels_last(self, name: str, node: TfjsNode) -> None:
        """Finish a node whose image has its channels before its rows."""
        self.add("Transpose", [name], [node.name], perm=[0, 2, 3, 1])


def _convolution(builder: _Builder, node: TfjsNode) -> None:
    """Convolution, with its bias and its activation."""
    weights = builder.value(node.inputs[1])
    group = weights.shape[2] if "Depthwise" in node.op else 1
    if group != 1:  # rows, columns, channels, filters of each: filters of one channel follow
        weights = weights.reshape(*weights.shape[:2], 1, -1)
    inputs = [
        builder.channels_first(node.inputs[0], node),
        builder.constant(f"{node.name}/weights", weights.transpose(3, 2, 0, 1)),
        *node.inputs[2:],
    ]
    last = builder.add(
        "Conv",
        inputs,
        [f"{node.name}/conv"],
        strides=node.integers("strides")[1:3],
        auto_pad=_padding(node),
        group=group,
    )
    for activation in node.texts("fused_ops")[1:]:
        last = _activated(builder, node, last, activation)
    builder.channels_last(last, node)


def _activated(builder: _Builder, node: TfjsNode, name: str, activation: str) -> str:
    outputs = [f"{node.name}/active"]
    if activation == "Relu":
        return builder.add("Relu", [name], outputs)
    if activation == "Relu6":
        low = builder.constant("zero", np.zeros((), np.float32))
        high = builder.constant("six", np.full((), 6, np.float32))
        return builder.add("Clip", [name, low, high], outputs)
    raise InputError(f"{node.name}: no way to convert the activation {activation} to ONNX")


def _padding(node: TfjsNode) -> str:
    return "SAME_UPPER" if node.text("padding") == "SAME" else "VALID"


def _max_pool(builder: _Builder, node: TfjsNode) -> None:
    last = builder.add(
        "MaxPool",
        [builder.channels_first(node.inputs[0], node)],
        [f"{node.name}/pool"],
        kernel_shape=node.integers("ksize")[1:3],
        strides=node.integers("strides")[1:3],
        auto_pad=_padding(node),
    )
    builder.channels_last(last, node)


def _resize(builder: _Builder, node: TfjsNode) -> None:
    if node.flag("align_corners"):
        raise InputError(f"{node.name}: no way to convert a resizing with align_corners to ONNX")
    mode = "half_pixel" if node.flag("half_pixel_centers") else "asymmetric"
    first = builder.channels_first(node.inputs[0], node)
    shape = builder.add("Shape", [first], [f"{node.name}/shape"], start=0, end=2)
    sizes = builder.add("Concat", [shape, node.inputs[1]], [f"{node.name}/sizes"], axis=0)
    last = builder.add(
        "Resize",
        [first, "", "", sizes],
        [f"{node.name}/resized"],
        mode="linear",
        coordinate_transformation_mode=mode,
    )
    builder.channels_last(last, node)


def _cast(builder: _Builder, node: TfjsNode) -> None:
    builder.add("Cast", node.inputs, [node.name], to=_KINDS[node.kind("DstT")])


def _squared_difference(builder: _Builder, node: TfjsNode) -> None:
    difference = builder.add("Sub", node.inputs, [f"{node.name}/difference"])
    builder.add("Mul", [difference, difference], [node.name])


def _squeeze(builder: _Builder, node: TfjsNode) -> None:
    axes = builder.constant(f"{node.name}/axes", node.integers("squeeze_dims"))
    builder.add("Squeeze", [node.inputs[0], axes], [node.name])


def _expand_dims(builder: _Builder, node: TfjsNode) -> None:
    axes = builder.constant(f"{node.name}/axes", builder.value(node.inputs[1]).reshape(1))
    builder.add("Unsqueeze", [node.inputs[0], axes], [node.name])


def _pack(builder: _Builder, node: TfjsNode) -> None:
    axis = node.integer("axis")
    axes = builder.constant(f"{node.name}/axes", [axis])
    parts = [
        builder.add("Unsqueeze", [name, axes], [f"{node.name}/part{k}"])
        for k, name in enumerate(node.inputs)
    ]
    builder.add("Concat", parts, [node.name], axis=axis)


def _unpack(builder: _Builder, node: TfjsNode) -> None:
    axis = node.integer("axis")
    axes = builder.constant(f"{node.name}/axes", [axis])
    outputs = _outputs(node, node.integer("num"))
    parts = [f"{name}/part" for name in outputs]
    builder.add("Split", node.inputs, parts, axis=axis)
    for part, output in zip(parts, outputs, strict=True):
        builder.add("Squeeze", [part, axes], [output])


def _split(builder: _Builder, node: TfjsNode) -> None:
    axis = int(builder.value(node.inputs[0]))
    builder.add("Split", [node.inputs[1]], _outputs(node, node.integer("num_split")), axis=axis)


def _outputs(node: TfjsNode, count: int) -> list[str]:
    return [node.name, *(f"{node.name}:{k}" for k in range(1, count))]


def _concat(builder: _Builder, node: TfjsNode) -> None:
    *parts, axis = node.inputs
    builder.add("Concat", parts, [node.name], axis=int(builder.value(axis)))


def _fill(builder: _Builder, node: TfjsNode) -> None:
    shape, value = node.inputs
    builder.add("Expand", [value, shape], [node.name])


def _top_k(builder: _Builder, node: TfjsNode) -> None:
    count = builder.constant(f"{node.name}/count", builder.value(node.inputs[1]).reshape(1))
    builder.add("TopK", [node.inputs[0], count], _outputs(node, 2))


def _arg_max(builder: _Builder, node: TfjsNode) -> None:
    axis = int(builder.value(node.inputs[1]))
    builder.add("ArgMax", [node.inputs[0]], [node.name], axis=axis, keepdims=0)


def _max(builder: _Builder, node: TfjsNode) -> None:
    axes = builder.value(node.inputs[1]).reshape(-1).tolist()
    keep = int(node.flag("keep_dims"))
    builder.add("ReduceMax", [node.inputs[0]], [node.name], axes=axes, keepdims=keep)


def _sum(builder: _Builder, node: TfjsNode) -> None:
    axes = builder.constant(f"{node.name}/axes", builder.value(node.inputs[1]).reshape(-1))
    keep = int(node.flag("keep_dims"))
    builder.add("ReduceSum", [node.inputs[0], axes], [node.name], keepdims=keep)


def _strided_slice(builder: _Builder, node: TfjsNode) -> None:
    """Part of an array, as in ``x[1:, 0, newaxis]``; masks have a bit for each of the indices."""
    begin, end, strides = (builder.value(name).tolist() for name in node.inputs[1:])
    starts: list[int] = []
    ends: list[int] = []
    squeezed: list[int] = []
    new: list[int] = []
    for k, (low, high) in enumerate(zip(begin, end, strict=True)):

        def masked(name: str, bit: int = 1 << k) -> bool:
            return bool(node.integer(name) & bit)

        if masked("new_axis_mask"):
            new.append(k)
            strides.pop(k - len(new) + 1)
            continue
        if masked("shrink_axis_mask"):
            squeezed.append(len(starts))
            starts.append(low)
            ends.append(low + 1 or _END)
            continue
        starts.append(0 if masked("begin_mask") else low)
        ends.append(_END if masked("end_mask") else high)
    names = [
        builder.constant(f"{node.name}/{name}", value)
        for name, value in (
            ("starts", starts),
            ("ends", ends),
            ("axes", list(range(len(starts)))),
            ("strides", strides),
        )
    ]
    last = builder.add("Slice", [node.inputs[0], *names], [f"{node.name}/slice"])
    if squeezed:  # without axes, ONNX takes all of length one
        axes = builder.constant(f"{node.name}/squeezed", squeezed)
        last = builder.add("Squeeze", [last, axes], [f"{node.name}/squeeze"])
    new_axes = builder.constant(f"{node.name}/new", np.array(new, np.int64))
    builder.add("Unsqueeze", [last, new_axes], [node.name])


_CONVERTERS: dict[str, Callable[[_Builder, TfjsNode], None]] = {
    **dict.fromkeys(("_FusedConv2D", "Conv2D"), _convolution),
    **dict.fromkeys(("FusedDepthwiseConv2dNative", "DepthwiseConv2dNative"), _convolution),
    "MaxPool": _max_pool,
    "ResizeBilinear": _resize,
    "Cast": _cast,
    "Sum": _sum,
    "Max": _max,
    "SquaredDifference": _squared_difference,
    "Squeeze": _squeeze,
    "ExpandDims": _expand_dims,
    "Pack": _pack,
    "Unpack": _unpack,
    "Split": _split,
    "ConcatV2": _concat,
    "Fill": _fill,
    "TopKV2": _top_k,
    "ArgMax": _arg_max,
    "StridedSlice": _strided_slice,
}
