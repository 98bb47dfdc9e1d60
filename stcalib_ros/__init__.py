"""Calibration of camera extrinsics, clock offsets and identities from people walking.

Implements Lee, Nishino and Nobuhara, "Spatiotemporal Multi-Camera Calibration
using Freely Moving People" (2025), for ROS 2 and without it.

The names in `__all__` are the public interface; everything else may change. They are imported
when they are first used, so that ``import stcalib_ros`` itself loads neither NumPy nor SciPy.

Examples
--------
From a bag, such as the one that comes with the package:

>>> from pathlib import Path
>>> import stcalib_ros as st
>>> bag = Path(st.__file__).parent / "data" / "demo" / "balance.mcap"
>>> calibration = st.calibrate(st.read_bag(bag))
>>> calibration.status.name, len(calibration.cameras)
('OK', 4)

From arrays of poses, without a bag: `camera_from_arrays`.
"""

from __future__ import annotations

from importlib import import_module
from pkgutil import extend_path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from stcalib_ros.core.capture.people import Capture, capture_people
    from stcalib_ros.core.diagnosis.examine import Diagnosis, examine
    from stcalib_ros.core.errors import CalibrationError, Cancelled, InputError, StcalibError
    from stcalib_ros.core.evaluation.metrics import Evaluation, evaluate
    from stcalib_ros.core.model.calibration import (
        Calibration,
        CameraCalibration,
        PersonAssociation,
        Status,
    )
    from stcalib_ros.core.model.from_arrays import camera_from_arrays
    from stcalib_ros.core.model.keypoint_layouts import LAYOUTS, Layout, find_layout
    from stcalib_ros.core.model.lens_knowledge import LensKnowledge, LensStddev
    from stcalib_ros.core.model.recording import (
        CameraRecording,
        Intrinsics,
        LensModel,
        Recording,
        Track,
        keypoints_only,
    )
    from stcalib_ros.core.model.rejection import Rejection, RejectionReason
    from stcalib_ros.core.model.scale_cues import Distance
    from stcalib_ros.core.options import Options
    from stcalib_ros.core.output.floor_plan import PlacedCalibration, placed_on_plan
    from stcalib_ros.core.pipeline import calibrate, run_stages
    from stcalib_ros.core.reconstruction.trajectories import PersonTrajectory
    from stcalib_ros.core.stages import Stages
    from stcalib_ros.core.synthetic.options import SceneOptions
    from stcalib_ros.core.synthetic.scene import simulate
    from stcalib_ros.estimation.film_recording import FilmOptions, read_films
    from stcalib_ros.io.bag import read_bag
    from stcalib_ros.io.bag_writer import write_bag
    from stcalib_ros.io.camera_info_yaml import write_camera_info
    from stcalib_ros.io.exports import export_calibration
    from stcalib_ros.io.results import read_result, write_result

__all__ = [
    "LAYOUTS",
    "Calibration",
    "CalibrationError",
    "CameraCalibration",
    "CameraRecording",
    "Cancelled",
    "Capture",
    "Diagnosis",
    "Distance",
    "Evaluation",
    "FilmOptions",
    "InputError",
    "Intrinsics",
    "Layout",
    "LensKnowledge",
    "LensModel",
    "LensStddev",
    "Options",
    "PersonAssociation",
    "PersonTrajectory",
    "PlacedCalibration",
    "Recording",
    "Rejection",
    "RejectionReason",
    "SceneOptions",
    "Stages",
    "Status",
    "StcalibError",
    "Track",
    "__version__",
    "calibrate",
    "camera_from_arrays",
    "capture_people",
    "evaluate",
    "examine",
    "export_calibration",
    "find_layout",
    "keypoints_only",
    "placed_on_plan",
    "read_bag",
    "read_films",
    "read_result",
    "run_stages",
    "simulate",
    "write_bag",
    "write_camera_info",
    "write_result",
]

# In a ROS 2 workspace the generated messages live in another folder of the same package.
__path__ = extend_path(__path__, __name__)

__version__ = "0.1.0"

_MODULE_OF = {
    "Capture": "core.capture.people",
    "capture_people": "core.capture.people",
    "PersonTrajectory": "core.reconstruction.trajectories",
    "Diagnosis": "core.diagnosis.examine",
    "examine": "core.diagnosis.examine",
    "CalibrationError": "core.errors",
    "Cancelled": "core.errors",
    "InputError": "core.errors",
    "StcalibError": "core.errors",
    "Evaluation": "core.evaluation.metrics",
    "evaluate": "core.evaluation.metrics",
    "Calibration": "core.model.calibration",
    "CameraCalibration": "core.model.calibration",
    "PersonAssociation": "core.model.calibration",
    "Status": "core.model.calibration",
    "camera_from_arrays": "core.model.from_arrays",
    "LAYOUTS": "core.model.keypoint_layouts",
    "Layout": "core.model.keypoint_layouts",
    "find_layout": "core.model.keypoint_layouts",
    "LensKnowledge": "core.model.lens_knowledge",
    "LensStddev": "core.model.lens_knowledge",
    "CameraRecording": "core.model.recording",
    "Intrinsics": "core.model.recording",
    "LensModel": "core.model.recording",
    "Recording": "core.model.recording",
    "Track": "core.model.recording",
    "keypoints_only": "core.model.recording",
    "Rejection": "core.model.rejection",
    "RejectionReason": "core.model.rejection",
    "Distance": "core.model.scale_cues",
    "Options": "core.options",
    "PlacedCalibration": "core.output.floor_plan",
    "placed_on_plan": "core.output.floor_plan",
    "calibrate": "core.pipeline",
    "run_stages": "core.pipeline",
    "Stages": "core.stages",
    "SceneOptions": "core.synthetic.options",
    "simulate": "core.synthetic.scene",
    "FilmOptions": "estimation.film_recording",
    "read_films": "estimation.film_recording",
    "read_bag": "io.bag",
    "write_bag": "io.bag_writer",
    "write_camera_info": "io.camera_info_yaml",
    "export_calibration": "io.exports",
    "read_result": "io.results",
    "write_result": "io.results",
}
"""Module of each public name, below this package."""


if not TYPE_CHECKING:  # type checkers would take it for a module that has every name

    def __getattr__(name: str) -> object:
        if name not in _MODULE_OF:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = getattr(import_module(f"{__name__}.{_MODULE_OF[name]}"), name)
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
