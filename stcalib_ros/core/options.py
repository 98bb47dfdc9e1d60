"""Everything that can be set, with the default that measured best."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from numbers import Integral, Real
from typing import Any, NamedTuple, TypeVar

from stcalib_ros.core.errors import InputError, did_you_mean
from stcalib_ros.core.model.clock_alignment import AUTO, clock_alignment
from stcalib_ros.core.model.lens_knowledge import LensKnowledge
from stcalib_ros.core.model.scale_cues import Distance, distances_from_list

METHODS = ("correlation", "vmf")
"""Ways to register a pair of cameras: the default, and the paper's own."""

MAX_TEXT = 256
"""Characters. A longer name is refused as an option: ROS 2 limits topic names to about as many."""

INITIAL_ROTATIONS = ("random", "candidates")


class Range(NamedTuple):
    """Least and greatest value of an option; both are allowed, and both are finite."""

    low: float
    high: float


def _within(default: Any, low: float, high: float) -> Any:
    """Field of an options record with its default and its range."""
    return field(default=default, metadata={"range": Range(low, high)})


@dataclass(frozen=True, slots=True)
class RegistrationOptions:
    """Pairwise registration (the paper's Section III).

    Attributes
    ----------
    method : str
        "correlation": epipolar correlation of keypoints at all lags, hypotheses, refinement. "vmf":
        the paper's own method, with its multi-view integration and adjustment as well; see
        `VmfOptions`. The other options here are those of "correlation".
    min_overlap : int
        Minimum number of common frames of two tracks at a lag.
    n_candidates : int
        Number of the best (track, track, lag) triples that take in further tracks.
    n_hypotheses : int
        Maximum number of distinct hypotheses kept of a pair of cameras.
    n_refined : int
        Number of candidates that are refined on the keypoints, the best supported first.
    """

    method: str = "correlation"
    min_overlap: int = _within(12, 2, 10_000)
    n_candidates: int = _within(16, 1, 100_000)
    n_hypotheses: int = _within(12, 1, 1000)
    n_refined: int = _within(6, 1, 1000)

    def __post_init__(self) -> None:
        _require_valid(self, "registration.")
        _require_one_of("registration.method", self.method, METHODS)


@dataclass(frozen=True, slots=True)
class VmfOptions:
    """The paper's own method, where ``registration.method`` is "vmf".

    Attributes
    ----------
    window : int
        T, the frames of a window; the paper takes 5 to 15.
    n_windows : int
        Windows, uniform over the recording, at most.
    n_hypothesised : int
        Source persons that RANSAC takes to be visible in the target view; 0: no RANSAC.
    initial : str
        Rotations that the alternation starts from: "random", or "candidates" that align two
        persons.
    n_starts : int
        How many random ones, at every offset and for every subset of RANSAC.
    search_offsets : bool
        Search the offset of each pair; else registration takes the clocks as they are, and the
        adjustment alone estimates offsets (as in the paper's Table II).
    no_match_rad : float
        Persons whose bones differ by more on average are not matched.
    turn_poses : bool
        Turn monocular poses onto their keypoints first, as the default method does.
    """

    window: int = _within(15, 2, 10_000)
    n_windows: int = _within(20, 1, 10_000)
    n_hypothesised: int = _within(2, 0, 100)
    initial: str = "random"
    n_starts: int = _within(10, 1, 10_000)
    search_offsets: bool = True
    no_match_rad: float = _within(0.5, 0.01, 3.2)
    turn_poses: bool = False

    def __post_init__(self) -> None:
        _require_valid(self, "vmf.")
        _require_one_of("vmf.initial", self.initial, INITIAL_ROTATIONS)


def _require_valid(record: Any, prefix: str) -> None:
    """Check type, finiteness and range of every option of one record.

    Raises
    ------
    InputError
        One is unusable; the message names the key, the value and what is expected.
    """
    for one in fields(record):
        value, key = getattr(record, one.name), f"{prefix}{one.name}"
        if (kind := _KINDS.get(str(one.type))) is not None and not kind.accepts(value):
            raise InputError(f"option {key}: expected {kind.name}, got {value!r}")
        if isinstance(value, str) and (len(value) > MAX_TEXT or not value.isprintable()):
            raise InputError(
                f"option {key}: expected at most {MAX_TEXT} printable characters, got "
                f"{value[:MAX_TEXT]!r}"
            )
        if (bounds := one.metadata.get("range")) and not bounds.low <= value <= bounds.high:
            raise InputError(
                f"option {key} must be {bounds.low:.12g} to {bounds.high:.12g}, got {value!r}"
            )


class _Kind(NamedTuple):
    """Type of an option: what an error message calls it, and the classes that it accepts."""

    name: str
    classes: tuple[type, ...]

    def accepts(self, value: object) -> bool:
        """Return whether a value is of this type; a bool is no number."""
        return isinstance(value, self.classes) and (bool in self.classes) >= isinstance(value, bool)


_KINDS = {
    "bool": _Kind("bool", (bool,)),
    "int": _Kind("int", (Integral,)),
    "float": _Kind("float", (Real,)),
    "str": _Kind("text", (str,)),
    "str | None": _Kind("text", (str, type(None))),
}
"""Kinds by the annotation of the field."""


def _require_one_of(name: str, value: str, known: Sequence[str]) -> None:
    if value not in known:
        raise InputError(f"option {name} must be one of {', '.join(known)}, got {value!r}")


@dataclass(frozen=True, slots=True)
class IntegrationOptions:
    """Multi-view integration (Section IV).

    Attributes
    ----------
    n_trees : int
        Random spanning trees tried over the pair hypotheses.
    """

    n_trees: int = _within(300, 1, 100_000)

    def __post_init__(self) -> None:
        _require_valid(self, "integration.")


@dataclass(frozen=True, slots=True)
class BundleOptions:
    """Spatiotemporal bundle adjustment (Section IV).

    Attributes
    ----------
    rounds : int
        Rounds of association, adjustment and outlier removal (ISTBA).
    max_iterations : int
        Levenberg-Marquardt steps of a round.
    outlier_factor : float
        Observations above this multiple of the median error are dropped.
    outlier_floor_px : float
        But never below this.
    """

    rounds: int = _within(5, 1, 100)
    max_iterations: int = _within(12, 1, 1000)
    outlier_factor: float = _within(3.0, 1.0, 100.0)
    outlier_floor_px: float = _within(12.0, 0.0, 1000.0)

    def __post_init__(self) -> None:
        _require_valid(self, "bundle.")


@dataclass(frozen=True, slots=True)
class ScaleOptions:
    """Scale cues, fused by their standard deviations.

    Attributes
    ----------
    poses_sigma : float
        Relative standard deviation of the size of metric 3D poses.
    body_height_m, body_height_sigma_m : float
        Mean height of the people and its standard deviation for one of them; 0: not known.
    distances : tuple of Distance
        Known distances.
    """

    poses_sigma: float = _within(0.1, 1e-4, 1.0)
    body_height_m: float = _within(0.0, 0.0, 3.0)
    body_height_sigma_m: float = _within(0.09, 1e-3, 1.0)
    distances: tuple[Distance, ...] = ()

    def __post_init__(self) -> None:
        _require_valid(self, "scale.")


@dataclass(frozen=True, slots=True)
class LensOptions:
    """Lenses that are estimated.

    Attributes
    ----------
    focal_stddev : float
        Relative standard deviation of the focal length that is given, where it is refined.
    principal_point_stddev : float
        Standard deviation of the principal point, from the one given or the middle of the image, as
        a fraction of the width.
    radial_terms : int
        Coefficients of radial distortion that are estimated: k1, or k1 and k2.
    shared : bool
        All cameras have one lens: cameras of one model.
    """

    focal_stddev: float = _within(0.1, 1e-4, 1.0)
    principal_point_stddev: float = _within(0.005, 1e-5, 0.5)
    radial_terms: int = _within(1, 0, 2)
    shared: bool = False

    def __post_init__(self) -> None:
        _require_valid(self, "lens.")


INTRINSICS = tuple(one.value for one in LensKnowledge)
"""What intrinsics can be worth, by the names of the option."""


@dataclass(frozen=True, slots=True)
class Options:
    """Options of `stcalib_ros.core.pipeline.calibrate`.

    Attributes
    ----------
    reference : str or None
        Camera that gives the reference frame and clock; None: the first.
    offset_range_s : float
        Clock offsets are searched within plus and minus this; 0: the clocks agree, and none is
        searched or estimated.
    min_score : float
        Joints with a lower score are not used.
    min_common_frames : int
        Minimum number of images of two cameras that can overlap in time.
    seed : int
        Seed of the random spanning trees.
    world_frame : str
        Name of a frame with z up and the floor at 0 to express the poses in; empty: they are in
        the frame of the reference camera.
    estimate_line_time : bool
        Estimate the line times of rolling shutters, from those of the recording on; not with
        ``registration.method`` "vmf".
    intrinsics : str
        What the intrinsics of cameras are worth for which the recording does not say: "given",
        "refine" or "unknown", see `LensKnowledge`; the latter two not with
        ``registration.method`` "vmf".
    align : str
        What is added to stamps before offsets are searched, for clocks that differ by more: "auto":
        a guess, for cameras whose stamps do not overlap with those of the others; "starts": all
        cameras have their first image at one time; "stamps": nothing; or seconds, for all cameras
        but the reference or as "CAM=SECONDS,...". Offsets of the result contain it.
    registration, vmf, integration, bundle, scale, lens : options of their own
        Options of single stages.
    """

    reference: str | None = None
    offset_range_s: float = _within(2.0, 0.0, 3600.0)
    min_score: float = _within(0.3, 0.0, 1.0)
    min_common_frames: int = _within(12, 2, 10_000)
    seed: int = _within(0, 0, 2**31)
    registration: RegistrationOptions = field(default_factory=RegistrationOptions)
    vmf: VmfOptions = field(default_factory=VmfOptions)
    integration: IntegrationOptions = field(default_factory=IntegrationOptions)
    bundle: BundleOptions = field(default_factory=BundleOptions)
    scale: ScaleOptions = field(default_factory=ScaleOptions)
    lens: LensOptions = field(default_factory=LensOptions)
    world_frame: str = ""
    estimate_line_time: bool = False
    intrinsics: str = LensKnowledge.GIVEN.value
    align: str = AUTO

    def __post_init__(self) -> None:
        _require_valid(self, "")
        _require_one_of("intrinsics", self.intrinsics, INTRINSICS)
        clock_alignment(self.align)
        if self.estimate_line_time and self.registration.method == "vmf":
            raise InputError(
                "estimate_line_time: registration.method vmf takes line times as they are given; "
                "give them (line_time_s of a camera), or take correlation"
            )
        if self.intrinsics != LensKnowledge.GIVEN.value and self.registration.method == "vmf":
            raise InputError(
                f"intrinsics: {self.intrinsics}: registration.method vmf takes lenses as they are "
                "given; give them, or take correlation"
            )

    @property
    def synchronised(self) -> bool:
        """Clocks are taken to agree."""
        return self.offset_range_s == 0


_T = TypeVar("_T")


def option_ranges() -> dict[str, Range]:
    """Return the ranges of all options that have one, by key.

    Examples
    --------
    >>> option_ranges()["bundle.rounds"]
    Range(low=1, high=100)
    """
    defaults = Options()
    groups = {f"{f.name}.": getattr(defaults, f.name) for f in fields(defaults)}
    records = {"": defaults} | {key: group for key, group in groups.items() if is_dataclass(group)}
    return {
        f"{prefix}{one.name}": one.metadata["range"]
        for prefix, record in records.items()
        for one in fields(record)
        if "range" in one.metadata
    }


def options_from_mapping(given: Mapping[str, Any]) -> Options:
    """Options from a nested mapping, as a YAML file gives it.

    Raises
    ------
    InputError
        A key is unknown, or a value has the wrong type or is out of its range.
    """
    return _overlay(Options(), given, "")


def _overlay(options: _T, given: Mapping[str, Any], path: str) -> _T:
    known = {f.name: getattr(options, f.name) for f in fields(options)}  # type: ignore[arg-type]
    changes: dict[str, Any] = {}
    for key, value in given.items():
        if key not in known:
            near = did_you_mean(str(key), known) or f": there are {', '.join(known)}"
            raise InputError(f"unknown option {path}{key}{near}")
        changes[key] = _converted(known[key], value, f"{path}{key}")
    return replace(options, **changes)  # type: ignore[type-var]


def _converted(default: Any, value: Any, path: str) -> Any:
    if is_dataclass(default):
        if not isinstance(value, Mapping):
            raise InputError(f"option {path} holds further options, got {value!r}")
        return _overlay(default, value, path + ".")
    if isinstance(default, tuple):
        return distances_from_list(value, path)
    if isinstance(default, float) and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if path == "align" and isinstance(value, int | float) and not isinstance(value, bool):
        return str(value)
    return value
