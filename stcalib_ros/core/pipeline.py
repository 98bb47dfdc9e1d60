"""The calibration, from a recording to poses and clocks: a row of stages."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stcalib_ros.core import stba
from stcalib_ros.core.association import Association, associate
from stcalib_ros.core.averaging import Rig, connected_groups, integrate
from stcalib_ros.core.epipolar import refine_pair
from stcalib_ros.core.errors import CalibrationError, Cancelled
from stcalib_ros.core.hypotheses import PairHypothesis, register_pair
from stcalib_ros.core.lift import LiftedCamera, lift_recording
from stcalib_ros.core.observations import Observations, observe
from stcalib_ros.core.options import Options
from stcalib_ros.core.skeleton import Skeleton, common_skeleton
from stcalib_ros.core.timeline import common_step, sample_camera
from stcalib_ros.core.types import Recording
