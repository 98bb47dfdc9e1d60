"""Simulated scenes for measuring accuracy, with the targets of each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction

from benchmarks.accuracy.alterations import Alteration, cut_tracks, without_half_of_joints
from stcalib_ros.core.options import Options
from stcalib_ros.core.synthetic import SceneOptions

SUCCESS = {"E_R": 0.02, "E_t": 0.05, "E_delta": 0.5}
"""A scene is solved if every camera is calibrated and no error is above these."""

MAX_CPU_S = 8.0
"""Largest accepted CPU seconds of one calibration: several times the usual ones."""
MAX_RATIO = 1.5
"""Largest accepted ratio of a median error to that of the easier scenario with the same seeds."""
MAX_2D_RATIO = 1.2
"""Largest accepted ratio of a median error without 3D poses to that with them: both are to end at
the same minimum of the adjustment, which does not use 3D poses. From the project's requirements."""


@dataclass(frozen=True, slots=True)
class KeypointTargets:
    """Targets of a scenario without 3D poses: smallest fraction solved, largest medians."""

    success: Fraction
    medians: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Scenario:
    """A kind of scene.

    Attributes
    ----------
    name, title : str
    options : SceneOptions
        Options of the first scene; the others differ in their seed.
    n_scenes : int
    success : Fraction
        Smallest fraction of scenes to be solved.
    medians, p90 : mapping of str to float
        Largest accepted medians and 90th percentiles of the errors.
    beside : str
        Name of the easier scenario with the same seeds: medians may be up to `MAX_RATIO` times
        those there, unless `cpu_ratio` is given.
    may_refuse : bool
        Whether refusing such a scene counts as much as solving it.
    line_times : str
        Treatment of rolling shutters: "ignored", "given" or "estimated".
    keypoints_only : KeypointTargets or None
        Targets without 3D poses; None: those relative to the same scenes with them, as many solved
        less one and medians within `MAX_2D_RATIO`.
    alter : callable or None
        Changes scenes after they are simulated.
    offset_range_s : float
        Option of the calibration.
    cpu_s : float or None
        Largest accepted median of the CPU seconds.
    max_cpu_s : float
        Largest accepted CPU seconds of one calibration.
    cpu_ratio : float or None
        Largest accepted ratio of the CPU seconds to those of `beside`, in the median; then only
        these are compared.
    """

    name: str
    title: str
    options: SceneOptions
    n_scenes: int
    success: Fraction
    medians: Mapping[str, float] = field(default_factory=dict)
    p90: Mapping[str, float] = field(default_factory=dict)
    beside: str = ""
    may_refuse: bool = False
    line_times: str = "ignored"
    keypoints_only: KeypointTargets | None = None
    alter: Alteration | None = None
    offset_range_s: float = Options().offset_range_s
    cpu_s: float | None = None
    max_cpu_s: float = MAX_CPU_S
    cpu_ratio: float | None = None

    def scene_options(self, index: int) -> SceneOptions:
        """Return the options of one scene."""
        return replace(self.options, seed=self.options.seed + index)


_LONG_CPU_S = 60.0
"""Largest accepted CPU seconds of a clip of 120 s: half of its length. Chosen."""
_MOST = KeypointTargets(Fraction(28, 30))
_ROLLING = SceneOptions(seed=1000, line_time_s=25e-6)

_FORMS = {
    "constant": "the same in the image for every view",
    "views": "another one for each camera",
    "hidden": "joints behind the trunk pulled to the nearer side of it",
    "foreshortened": "growing as a bone points to the camera",
    "sizes": "of another size for each person",
}
"""Forms of keypoint bias that the model of the calibration does not contain."""


def _biased(form: str, title: str) -> Scenario:
    medians = {"E_R": 0.002}
    return Scenario(
        f"bias {form}",
        f"the default scenes with a keypoint bias of 20 mm, {title}",
        SceneOptions(seed=2000, keypoint_bias_mm=20.0, keypoint_bias_form=form),
        30,
        Fraction(29, 30),
        medians,
        keypoints_only=KeypointTargets(Fraction(28, 30), medians),
        cpu_s=4.0,
    )


SCENARIOS = (
    Scenario(
        "default",
        "4 cameras, 3 people, 300 frames, 3 px, lifter 30-60 mm and 3 degrees, id switches",
        SceneOptions(seed=1000),
        30,
        Fraction(29, 30),
        {"E_R": 0.001, "E_t": 0.001, "E_delta": 0.03},
        keypoints_only=KeypointTargets(
            Fraction(1), {"E_R": 0.0003, "E_t": 0.0002, "E_delta": 0.003}
        ),
        cpu_s=1.2,
    ),
    Scenario(
        "bias",
        "the same with a view-dependent keypoint bias of 20 mm",
        SceneOptions(seed=2000, keypoint_bias_mm=20.0),
        50,
        Fraction(49, 50),
        {"E_R": 0.004, "E_t": 0.003, "E_delta": 0.05},
        {"E_R": 0.009},
        cpu_s=4.0,
    ),
    Scenario(
        "crowd",
        "6 people, 25 % missing per view, occlusions, id switches, 20 mm keypoint bias",
        SceneOptions(
            seed=3000,
            n_people=6,
            area_radius_m=2.0,
            missing=0.25,
            occlusions=True,
            bursts_per_10s=1.0,
            keypoint_bias_mm=20.0,
        ),
        30,
        Fraction(13, 15),
        cpu_s=4.0,
    ),
    *(_biased(form, title) for form, title in _FORMS.items()),
    # In one of them the person repeats a clip exactly and in place: the motion is periodic, the
    # time offset is ambiguous by a period, and refusing is right.
    Scenario(
        "one",
        "one person",
        SceneOptions(seed=4000, n_people=1),
        30,
        Fraction(9, 10),
    ),
    Scenario(
        "wide",
        "lenses of 125 degrees in a room of five metres",
        SceneOptions(
            seed=8000, focal_px=500.0, ring_radius_m=(2.2, 3.0), area_radius_m=1.8, occlusions=True
        ),
        30,
        Fraction(19, 20),
    ),
    Scenario("short", "two seconds", SceneOptions(seed=5000, n_frames=60), 30, Fraction(28, 30)),
    Scenario(
        "gesturing",
        "two people who stand and gesture, five seconds",
        SceneOptions(seed=6000, n_people=2, people="gesturing", n_frames=150),
        30,
        Fraction(28, 30),
        may_refuse=True,
    ),
    Scenario(
        "rates",
        "the default scenes at 30, 25, 60 and 30 fps, 10 % of images lost, 5 ms of jitter",
        SceneOptions(seed=1000, fps=(30.0, 25.0, 60.0, 30.0), drop_rate=0.1, stamp_jitter_s=0.005),
        30,
        Fraction(19, 20),
        beside="default",
    ),
    Scenario(
        "shutter ignored",
        "the default scenes with rolling shutters of 25 us per row, treated as global ones",
        _ROLLING,
        30,
        Fraction(9, 10),
    ),
    Scenario(
        "shutter",
        "the same, line delays given",
        _ROLLING,
        30,
        Fraction(1),
        {"E_R": 0.0005, "E_t": 0.0005, "E_delta": 0.03},
        line_times="given",
    ),
    Scenario(
        "shutter estimated",
        "the same, line delays estimated",
        _ROLLING,
        30,
        Fraction(1),
        {"E_R": 0.0005, "E_t": 0.0005, "E_delta": 0.03},
        line_times="estimated",
    ),
    Scenario(
        "small",
        "images in which people are 60 px tall, 1.5 px",
        SceneOptions(seed=1000, image_size=(288, 162), focal_px=210.0, sigma_px=1.5),
        30,
        Fraction(28, 30),
        may_refuse=True,
        keypoints_only=_MOST,
    ),
    Scenario(
        "half",
        "the default scenes without half of the joints of each image",
        SceneOptions(seed=1000),
        30,
        Fraction(28, 30),
        may_refuse=True,
        keypoints_only=_MOST,
        alter=without_half_of_joints,
    ),
    Scenario(
        "cut",
        "the default scenes, tracks cut every 15 images",
        SceneOptions(seed=1000),
        30,
        Fraction(28, 30),
        may_refuse=True,
        keypoints_only=_MOST,
        alter=cut_tracks,
    ),
    Scenario(
        "long",
        "the default with 120 s, offsets searched within 2 s",
        SceneOptions(seed=9000, n_frames=3600),
        3,
        Fraction(1),
        max_cpu_s=_LONG_CPU_S,
    ),
    Scenario(
        "long, 60 s",
        "the same, offsets searched within 60 s",
        SceneOptions(seed=9000, n_frames=3600, max_offset_frames=1800.0),
        3,
        Fraction(1),
        beside="long",
        max_cpu_s=_LONG_CPU_S,
        offset_range_s=60.0,
        cpu_ratio=2.0,
    ),
)
"""Scenarios of the table, in its order."""

HARD = (
    Scenario(
        "poor poses",
        "3D poses with errors of 110 mm, two seconds",
        SceneOptions(seed=7000, n_people=2, n_frames=60, lifter_mm=(110.0, 110.0)),
        50,
        Fraction(1),
        may_refuse=True,
    ),
    Scenario(
        "alike",
        "two people with identical motion",
        SceneOptions(seed=7100, n_people=2, people="alike", n_frames=90),
        50,
        Fraction(1),
        may_refuse=True,
    ),
    Scenario(
        "moments",
        "one second",
        SceneOptions(seed=7200, n_people=2, n_frames=30),
        50,
        Fraction(1),
        may_refuse=True,
    ),
    Scenario(
        "glimpses",
        "two people, each observed by a camera for a quarter of the time",
        SceneOptions(seed=7300, n_people=2, n_frames=150, missing=0.75),
        50,
        Fraction(1),
        may_refuse=True,
    ),
)
"""Scenarios that often cannot be solved, and must never give a wrong result with status OK."""
