"""Programs that run networks, which are optional: imported where one is used."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

from stcalib_ros.core.errors import InputError

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
