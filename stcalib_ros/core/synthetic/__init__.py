"""Simulated recordings with a known answer."""

from stcalib_ros.core.synthetic.bias_forms import BIAS_FORMS
from stcalib_ros.core.synthetic.changes import CameraChange
from stcalib_ros.core.synthetic.clips import MotionClip
from stcalib_ros.core.synthetic.options import LENS_MODELS, SceneOptions
from stcalib_ros.core.synthetic.paper_scene import paper_scene
from stcalib_ros.core.synthetic.people import PEOPLE, PersonMotion
from stcalib_ros.core.synthetic.rigs import SceneRig
from stcalib_ros.core.synthetic.scene import Scene, simulate

__all__ = [
    "BIAS_FORMS",
    "LENS_MODELS",
    "PEOPLE",
    "CameraChange",
    "MotionClip",
    "PersonMotion",
    "Scene",
    "SceneOptions",
    "SceneRig",
    "paper_scene",
    "simulate",
]
