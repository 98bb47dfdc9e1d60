"""Programs that run networks, which are optional: imported where one is used."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.arrays import FloatArray

_ERRORS_ONLY = 3
"""Severity, as ONNX Runtime counts it: warnings, such as those of unknown hardware, stay away."""


def require_package(module: str, extra: str) -> Any:
    """Import an optional package.

    Raises
    ------
    InputError
        It is not installed, or cannot be loaded.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        package = module.partition(".")[0].replace("_", "-")
        raise InputError(
            f"the Python package {package} is missing ({error}): install it with "
            f'pip install "stcalib-ros[{extra}]"'
        ) from error


def onnx_session(path: Path, threads: int, extra: str) -> Any:
    """Load a network into ONNX Runtime, on the processor.

    Raises
    ------
    InputError
        ONNX Runtime is not installed, or the file is no network.
    """
    runtime = require_package("onnxruntime", extra)
    options = runtime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.log_severity_level = _ERRORS_ONLY
    try:
        return runtime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # of its own kinds, which are not all public
        raise InputError(f"cannot read the network {path}: {error}") from error


class LitertNetwork:
    """A network of TensorFlow Lite on the processor; called with its input, returns its outputs.

    Raises
    ------
    InputError
        LiteRT is not installed, or the file is no network of one square image.
    """

    def __init__(self, path: Path, threads: int, extra: str) -> None:
        litert = require_package("ai_edge_litert.interpreter", extra)
        try:
            self._interpreter = litert.Interpreter(str(path), num_threads=threads)
            self._interpreter.allocate_tensors()
        except (ValueError, RuntimeError) as error:
            raise InputError(f"cannot read the network {path}: {error}") from error
        (self._input,) = self._interpreter.get_input_details()
        self._outputs = [d["index"] for d in self._interpreter.get_output_details()]

    @property
    def input_size(self) -> int:
        """Side of the image that it takes, px."""
        return int(self._input["shape"][1])

    def __call__(self, values: FloatArray) -> list[FloatArray]:
        """Run it on an image (1, side, side, 3) of float32."""
        self._interpreter.set_tensor(self._input["index"], values)
        self._interpreter.invoke()
        return [self._interpreter.get_tensor(index) for index in self._outputs]
