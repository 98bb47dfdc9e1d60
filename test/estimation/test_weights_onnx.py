"""Graphs of TensorFlow.js give the same values in ONNX as their definition has."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

pytest.importorskip("onnx")
pytest.importorskip("onnxruntime")

import onnxruntime as runtime
from networks import TfjsModel, numbers, text

from stcalib_ros.core.errors import InputError
from stcalib_ros.estimation.weights_onnx import to_onnx
from stcalib_ros.estimation.weights_tfjs import read_tfjs


def run(model: TfjsModel, output: str, image: np.ndarray, folder: Path) -> np.ndarray:
    network = to_onnx(read_tfjs(model.write(folder)), output)
    session = runtime.InferenceSession(network, providers=["CPUExecutionProvider"])
    return session.run(None, {"input": image[None].astype(np.float32)})[0]


@pytest.fixture
def image() -> np.ndarray:
    return np.random.default_rng(1).uniform(-1.0, 1.0, (8, 6, 3)).astype(np.float32)


def same_padding(image: np.ndarray, kernel: int, stride: int) -> np.ndarray:
    """TensorFlow's SAME: what is odd goes below and to the right."""
    rows = [max((-(-n // stride) - 1) * stride + kernel - n, 0) for n in image.shape[:2]]
    return np.pad(image, [(n // 2, n - n // 2) for n in rows] + [(0, 0)])


def test_convolutions_with_their_strides_biases_and_activations(image, tmp_path):
    rng = np.random.default_rng(2)
    weights = rng.normal(size=(3, 3, 3, 4)).astype(np.float16).astype(np.float32)
    bias = rng.normal(size=4).astype(np.float32)
    model = TfjsModel()
    model.constant("w", weights, half=True)
    model.constant("b", bias)
    model.node(
        *("_FusedConv2D", "conv", "input", "w", "b"),
        strides=numbers(1, 2, 2, 1),
        padding=text("SAME"),
        fused_ops={"list": {"s": [text("BiasAdd")["s"], text("Relu6")["s"]]}},
    )
    padded = same_padding(image, 3, 2)
    expected = np.array(
        [
            [np.tensordot(padded[r : r + 3, c : c + 3], weights, 3) + bias for c in (0, 2, 4)]
            for r in (0, 2, 4, 6)
        ]
    )
    result = run(model, "conv", image, tmp_path)[0]
    np.testing.assert_allclose(result, np.clip(expected, 0.0, 6.0), atol=1e-5)


def test_depthwise_convolutions_keep_the_order_of_their_filters(image, tmp_path):
    weights = np.random.default_rng(3).normal(size=(1, 1, 3, 2)).astype(np.float32)
    model = TfjsModel()
    model.constant("w", weights)
    model.node(
        *("DepthwiseConv2dNative", "conv", "input", "w"),
        strides=numbers(1, 1, 1, 1),
        padding=text("VALID"),
    )
    expected = (image[..., None] * weights[0, 0]).reshape(8, 6, 6)
    np.testing.assert_allclose(run(model, "conv", image, tmp_path)[0], expected, rtol=1e-5)


def test_images_are_resized_by_their_edges(image, tmp_path):
    model = TfjsModel()
    model.constant("size", np.array([16, 12]))
    model.node("ResizeBilinear", "big", "input", "size", half_pixel_centers={"b": True})
    expected = cv2.resize(image, (12, 16), interpolation=cv2.INTER_LINEAR)
    np.testing.assert_allclose(run(model, "big", image, tmp_path)[0], expected, atol=1e-5)


@pytest.mark.parametrize(
    ("begin", "end", "strides", "masks", "expected"),
    [
        ([0, 2], [1, 5], [1, 2], {"shrink_axis_mask": 1}, lambda x: x[0, 2:5:2]),
        ([0, 0, 0], [0, 0, 0], [1, 1, 1], {"new_axis_mask": 2}, lambda x: x[:, None]),
        ([0, -1], [0, 0], [1, 1], {"begin_mask": 1, "shrink_axis_mask": 2}, lambda x: x[:, -1]),
        ([1, 0, 2], [0, 0, 0], [1, 1, 3], {"new_axis_mask": 2}, lambda x: x[1:, None, 2::3]),
    ],
)
def test_slices_with_their_masks(begin, end, strides, masks, expected, tmp_path):
    values = np.arange(24, dtype=np.float32).reshape(1, 3, 8, 1)
    ends = 0
    for k in range(len(end)):
        ends |= (end[k] == 0) << k
    model = TfjsModel()
    model.constant("shape", np.array([3, 8]))
    model.node("Reshape", "table", "input", "shape")
    for name, value in (("begin", begin), ("end", end), ("strides", strides)):
        model.constant(name, np.array(value))
    attributes = {name: {"i": str(value)} for name, value in ({"end_mask": ends} | masks).items()}
    model.node("StridedSlice", "part", "table", "begin", "end", "strides", **attributes)
    result = run(model, "part", values.reshape(8, 1, 3), tmp_path)
    np.testing.assert_array_equal(result, expected(values.reshape(3, 8)))


def test_the_best_of_many_with_their_places(tmp_path):
    values = np.random.default_rng(4).permutation(24).astype(np.float32)
    model = TfjsModel()
    model.constant("all", np.array([24]))
    model.constant("count", np.array(3))
    model.constant("width", np.array(6))
    model.constant("axis", np.array(1))
    model.node("Reshape", "row", "input", "all")
    model.node("TopKV2", "best", "row", "count")
    model.node("FloorDiv", "line", "best:1", "width")
    model.node("Cast", "line_f", "line", DstT={"type": "DT_FLOAT"})
    model.node("Pack", "both", "best:0", "line_f", axis={"i": "1"})
    model.node("Unpack", "parts", "both", axis={"i": "1"}, num={"i": "2"})
    model.node("ExpandDims", "first", "parts", "axis")
    model.node("ExpandDims", "second", "parts:1", "axis")
    model.node("ConcatV2", "again", "second", "first", "axis")
    order = np.argsort(-values)[:3]
    result = run(model, "again", values.reshape(8, 1, 3), tmp_path)
    np.testing.assert_array_equal(result, np.column_stack([order // 6, values[order]]))


def test_the_same_graph_gives_the_same_bytes(tmp_path):
    model = TfjsModel()
    model.node("Sigmoid", "out", "input")
    graph = read_tfjs(model.write(tmp_path))
    assert to_onnx(graph, "out") == to_onnx(graph, "out")


def test_an_unknown_operation_is_named(tmp_path):
    model = TfjsModel()
    model.node("FFT", "spectrum", "input")
    with pytest.raises(InputError, match="spectrum: no way to convert the operation FFT"):
        to_onnx(read_tfjs(model.write(tmp_path)), "spectrum")


def test_weights_that_do_not_fit_are_refused(tmp_path):
    model = TfjsModel()
    model.constant("w", np.zeros(3, np.float32))
    path = model.write(tmp_path)
    (tmp_path / "small.bin").write_bytes(b"\0" * 16)
    with pytest.raises(InputError, match="16 bytes of weights, but 12 are described"):
        read_tfjs(path)
    (tmp_path / "small.bin").write_bytes(b"\0" * 8)
    with pytest.raises(InputError, match="no graph model"):
        read_tfjs(path)
