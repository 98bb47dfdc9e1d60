"""NumPy array types, by the precision that they hold."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float64Array = NDArray[np.float64]


Float32Array = NDArray[np.float32]


FloatArray = NDArray[np.float32] | NDArray[np.float64]
"""Poses as precise as the recording is: float32 of messages, or float64."""

IntArray = NDArray[np.int64]


BoolArray = NDArray[np.bool_]
