"""Options of a simulated scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.recording import LensModel
from stcalib_ros.core.synthetic.bias_forms import BIAS_FORMS
from stcalib_ros.core.synthetic.people import PEOPLE
from stcalib_ros.core.synthetic.rigs import DISTORTION_TERMS, SceneRig

LENS_MODELS = tuple(model.value for model in DISTORTION_TERMS)
"""Lens models of simulated cameras, by their names in CameraInfo."""


@dataclass(frozen=True, slots=True)
class SceneOptions:
    """Options of `stcalib_ros.core.synthetic.simulate`.

    Attributes
    ----------
    n_cameras, n_people, n_frames : int
        `n_frames` is the length of a recording in frames of the first camera.
    people : str
        "mocap" (procedural where no clips are given), "procedural" (walking, with stops),
        "standing" (nobody moves at all), "gesturing" (at one place) or "alike" (everybody as the
        first, to the frame).
    area_radius_m : float
        People stay within about this of the middle.
    fps : float or tuple of float
        One for all, or one per camera.
    image_size : (int, int)
        Width and height, px.
    focal_px : float or tuple of float
        One for all cameras of a ring, or one per camera.
    lens_model : str
        Model of the lenses of a ring, by its name in CameraInfo.
    distortion : tuple of float
        Coefficients of that model in OpenCV's order; those that are missing are 0.
    principal_point_px : float
        Standard deviation of the principal points about the middle of the image, per axis; each
        camera has its own.
    ring_radius_m, ring_height_m : (float, float)
        Ranges of the distances of cameras from the middle, and of their heights.
    rig : SceneRig or None
        Cameras to be used instead of a ring.
    rig_scale : float
        Factor of the distances between the cameras of `rig`.
    max_offset_frames : float
        Range of the uniform time offsets, plus and minus, in frames of the first camera; the first
        camera has none.
    skew_ppm : float
        Range of the uniform clock skews, plus and minus; the first camera has none.
    stamp_jitter_s : float
        Standard deviation of stamps about the true times of exposure, cut at 0.45 frames.
    drop_rate : float
        Fraction of images that a camera loses.
    line_time_s : float or tuple of float
        Line delay of rolling shutters, seconds per row; one for all, or one per camera. It is not
        part of the recording.
    sigma_px : float
        Standard deviation of the noise of keypoints, per axis.
    keypoint_bias_mm : float
        Root mean square, per axis, of the systematic displacement of keypoints.
    keypoint_bias_form : str
        "harmonic" (a polynomial of the viewing direction), "constant" (the same in the image for
        every view), "views" (another one for each camera), "hidden" (joints behind the trunk are
        pulled to the nearer side of it), "foreshortened" (growing as a bone points to the camera)
        or "sizes" (harmonic, of another size for each person).
    lifter_mm : (float, float)
        Range of the mean joint error (MPJPE) of the 3D poses, per person and camera.
    lifter_depth_ratio : float
        Joint errors along the optical axis over those across.
    tilt_deg : float
        Root mean square of the slow tilt of 3D poses, per person and camera.
    crop_perspective : float
        Fraction of the error of a lifter that assumes to look straight at the person.
    scale_error : float
        Standard deviation of the 3D size of a person (the lifter's prior).
    flip_rate : float
        Fraction of the frames in which left and right are exchanged, 2D and 3D.
    missing : float
        Fraction of the person-frames of a view in which the person is not detected, in stretches.
    occlusions : bool
        People covered by somebody nearer are not observed.
    bursts_per_10s : float
        Short losses (0.2-0.8 s) per person and camera.
    id_switches_per_10s : float
        Exchanges of ids per person and camera, mostly when people are close in the image.
    seed : int
    """

    n_cameras: int = 4
    n_people: int = 3
    n_frames: int = 300
    people: str = "mocap"
    area_radius_m: float = 1.6
    fps: float | tuple[float, ...] = 30.0
    image_size: tuple[int, int] = (1920, 1080)
    focal_px: float | tuple[float, ...] = 1400.0
    lens_model: str = LensModel.PLUMB_BOB.value
    distortion: tuple[float, ...] = ()
    principal_point_px: float = 0.0
    ring_radius_m: tuple[float, float] = (3.5, 5.0)
    ring_height_m: tuple[float, float] = (1.5, 2.8)
    rig: SceneRig | None = None
    rig_scale: float = 1.0
    max_offset_frames: float = 10.0
    skew_ppm: float = 0.0
    stamp_jitter_s: float = 0.0
    drop_rate: float = 0.0
    line_time_s: float | tuple[float, ...] = 0.0
    sigma_px: float = 3.0
    keypoint_bias_mm: float = 0.0
    keypoint_bias_form: str = "harmonic"
    lifter_mm: tuple[float, float] = (30.0, 60.0)
    lifter_depth_ratio: float = 1.5
    tilt_deg: float = 3.0
    crop_perspective: float = 1.0
    scale_error: float = 0.04
    flip_rate: float = 0.01
    missing: float = 0.0
    occlusions: bool = False
    bursts_per_10s: float = 0.0
    id_switches_per_10s: float = 0.2
    seed: int = 0

    def __post_init__(self) -> None:
        for name, bounds in _RANGES.items():
            value = getattr(self, name)
            if not bounds.low <= value <= bounds.high:
                raise InputError(f"{name} must be {bounds.low:g} to {bounds.high:g}, got {value}")
        for name in _FRACTIONS:
            value = getattr(self, name)
            if not 0 <= value < 1 and not (name == "crop_perspective" and value == 1):
                raise InputError(f"{name} must be a fraction between 0 and 1, got {value}")
        for name, bounds in _RANGES_OF_TWO.items():
            values = getattr(self, name)
            if len(values) != 2 or not all(bounds.low <= v <= bounds.high for v in values):
                raise InputError(
                    f"{name} must be two numbers of {bounds.low:g} to {bounds.high:g}, got {values}"
                )
        self._check_names()
        self._check_lens()
        n = self.n_cameras if self.rig is None else len(self.rig.names)
        self.line_times(n)
        rates = self.rates(n)
        n_images = self.n_frames * sum(rate / rates[0] for rate in rates)
        if n_images * self.n_people > MAX_POSES:
            raise InputError(
                f"n_frames, n_cameras and n_people: {n_images:.3g} images of {self.n_people} "
                f"people are more than {MAX_POSES} poses; make one of them smaller"
            )

    def _check_names(self) -> None:
        if self.people not in PEOPLE:
            raise InputError(f"people: expected one of {', '.join(PEOPLE)}, got {self.people!r}")
        if self.keypoint_bias_form not in BIAS_FORMS:
            raise InputError(
                f"keypoint_bias_form: expected one of {', '.join(BIAS_FORMS)},"
                f" got {self.keypoint_bias_form!r}"
            )
        if self.lens_model not in LENS_MODELS:
            raise InputError(
                f"lens_model: expected one of {', '.join(LENS_MODELS)}, got {self.lens_model!r}"
            )

    def _check_lens(self) -> None:
        if len(self.distortion) > (most := DISTORTION_TERMS[LensModel(self.lens_model)]):
            raise InputError(
                f"distortion: {self.lens_model} has {most} coefficients, got {len(self.distortion)}"
            )
        if self.rig is None:
            _per_camera("focal_px", self.focal_px, self.n_cameras, _FOCAL_LENGTHS)

    def rates(self, n_cameras: int) -> tuple[float, ...]:
        """Frame rate of each camera, Hz."""
        return _per_camera("fps", self.fps, n_cameras, _RATES)

    def line_times(self, n_cameras: int) -> tuple[float, ...]:
        """Line time of each camera, seconds per row."""
        return _per_camera("line_time_s", self.line_time_s, n_cameras, _LINE_TIMES)


class _Range(NamedTuple):
    low: float
    high: float


def _per_camera(
    name: str, given: float | tuple[float, ...], n_cameras: int, bounds: _Range
) -> tuple[float, ...]:
    """Value of each camera of an option that is one for all, or one per camera."""
    values = given if isinstance(given, tuple) else (given,) * n_cameras
    if len(values) != n_cameras:
        raise InputError(f"{name}: {len(values)} values for {n_cameras} cameras")
    if not all(bounds.low <= value <= bounds.high for value in values):
        raise InputError(f"{name} must be {bounds.low:g} to {bounds.high:g}, got {given}")
    return values


_RANGES = {
    "n_cameras": _Range(1, 1000),
    "n_people": _Range(1, 1000),
    "n_frames": _Range(2, 10_000_000),
    "area_radius_m": _Range(0.01, 1000.0),
    "principal_point_px": _Range(0.0, 1e5),
    "rig_scale": _Range(1e-3, 1000.0),
    "max_offset_frames": _Range(0.0, 1e6),
    "skew_ppm": _Range(0.0, 1e5),
    "stamp_jitter_s": _Range(0.0, 10.0),
    "sigma_px": _Range(0.0, 1e4),
    "keypoint_bias_mm": _Range(0.0, 1e4),
    "lifter_depth_ratio": _Range(0.0, 100.0),
    "tilt_deg": _Range(0.0, 180.0),
    "scale_error": _Range(0.0, 1.0),
    "bursts_per_10s": _Range(0.0, 100.0),
    "id_switches_per_10s": _Range(0.0, 100.0),
    "seed": _Range(0, 2**63),
}
"""Far beyond what cameras and people do: what is outside is a mistake. Chosen."""

_RANGES_OF_TWO = {
    "ring_radius_m": _Range(0.0, 1000.0),
    "ring_height_m": _Range(0.0, 1000.0),
    "lifter_mm": _Range(0.0, 1e4),
    "image_size": _Range(16, 100_000),
}
"""The same of what has two values."""

_RATES = _Range(0.1, 1000.0)
"""Frame rates, Hz: from time lapse to high-speed cameras. Chosen; what is outside is a mistake."""

_FOCAL_LENGTHS = _Range(1.0, 1e6)
"""Focal lengths, px: far beyond those of cameras. Chosen; what is outside is a mistake."""

MAX_LINE_TIME_S = 1e-3
"""Seconds per row, as large as the live node takes it: a readout of a second at 1000 rows."""

_LINE_TIMES = _Range(0.0, MAX_LINE_TIME_S)
"""Line times of rolling shutters, seconds per row: from a global shutter to the slowest one."""

MAX_POSES = 10_000_000
"""Persons times images. A scene of more is not simulated: it would take 10 GB. The largest of the
benchmarks has 0.5 million. Chosen."""

_FRACTIONS = ("drop_rate", "crop_perspective", "flip_rate", "missing")
