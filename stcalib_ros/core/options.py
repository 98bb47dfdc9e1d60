"""Everything that can be set, with the default that measured best."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any, TypeVar

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.scale_cues import Distance, distances_from_list

METHODS = ("correlation", "vmf")
"""Ways to register a pair of cameras: the default, and the paper's own."""

INITIAL_ROTATIONS = ("random", "candidates")


@dataclass(frozen=True, slots=True)
class RegistrationOptions:
    """Pairwise registration (the paper's Section III).

    Attributes
    ----------
    method : str
        "correlation": cross-covariance at all lags, hypotheses, refinement. "vmf": the paper's
        own method, with its multi-view integration and adjustment as well; see `VmfOptions`. The
        other options here are those of "correlation".
    min_overlap : int
        Samples that two tracks must share at a lag for it to count.
    n_candidates : int
        Best (track, track, lag) triples that vote.
    n_hypotheses : int
        Distinct hypotheses kept of a pair of cameras.
    n_refined : int
        How many of them are refined on the key points.
    """

    method: str = "correlation"
    min_overlap: int = 12
    n_candidates: int = 200
    n_hypotheses: int = 12
    n_refined: int = 5

    def __post_init__(self) -> None:
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
        Turn monocular poses onto their key points first, as the default method does.
    """

    window: int = 15
    n_windows: int = 20
    n_hypothesised: int = 2
    initial: str = "random"
    n_starts: int = 10
    search_offsets: bool = True
    no_match_rad: float = 0.5
    turn_poses: bool = False

    def __post_init__(self) -> None:
        _require_one_of("vmf.initial", self.initial, INITIAL_ROTATIONS)
        for name, low in {"window": 2, "n_windows": 1, "n_hypothesised": 0, "n_starts": 1}.items():
            if getattr(self, name) < low:
                raise InputError(f"vmf.{name} must be at least {low}, got {getattr(self, name)}")
        if not self.no_match_rad > 0:
            raise InputError(f"vmf.no_match_rad must be above 0, got {self.no_match_rad}")


def _require_one_of(name: str, value: str, known: Sequence[str]) -> None:
    if value not in known:
        raise InputError(f"{name} must be one of {', '.join(known)}, got {value!r}")


@dataclass(frozen=True, slots=True)
class IntegrationOptions:
    """Multi-view integration (Section IV).

    Attributes
    ----------
    n_trees : int
        Random spanning trees tried over the pair hypotheses.
    """

    n_trees: int = 300


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

    rounds: int = 5
    max_iterations: int = 12
    outlier_factor: float = 3.0
    outlier_floor_px: float = 12.0


@dataclass(frozen=True, slots=True)
class ScaleOptions:
    """What says how long a metre is; all of it together, each by its deviation.

    Attributes
    ----------
    poses_sigma : float
        How far the size of 3D poses that are said to be metric may be off, as a share.
    body_height_m, body_height_sigma_m : float
        Mean height of the people, and its deviation for one of them; 0: not known.
    distances : tuple of Distance
        Known distances.
    """

    poses_sigma: float = 0.1
    body_height_m: float = 0.0
    body_height_sigma_m: float = 0.09
    distances: tuple[Distance, ...] = ()

    def __post_init__(self) -> None:
        if not self.poses_sigma > 0 or not self.body_height_sigma_m > 0:
            raise InputError(
                "scale: deviations must be above 0, got poses_sigma "
                f"{self.poses_sigma} and body_height_sigma_m {self.body_height_sigma_m}"
            )
        if self.body_height_m < 0:
            raise InputError(
                f"scale.body_height_m must be above 0, or 0: not known; got {self.body_height_m}"
            )


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
        Images that two cameras must share in time.
    seed : int
        Of the random spanning trees.
    world_frame : str
        Name of a frame with z up and the floor at 0 to express the poses in; empty: they are in
        the frame of the reference camera.
    estimate_line_time : bool
        Estimate the line times of rolling shutters, from those of the recording on; not with
        ``registration.method`` "vmf".
    registration, vmf, integration, bundle, scale : options of their own
        Options of single stages.
    """

    reference: str | None = None
    offset_range_s: float = 2.0
    min_score: float = 0.3
    min_common_frames: int = 12
    seed: int = 0
    registration: RegistrationOptions = field(default_factory=RegistrationOptions)
    vmf: VmfOptions = field(default_factory=VmfOptions)
    integration: IntegrationOptions = field(default_factory=IntegrationOptions)
    bundle: BundleOptions = field(default_factory=BundleOptions)
    scale: ScaleOptions = field(default_factory=ScaleOptions)
    world_frame: str = ""
    estimate_line_time: bool = False

    def __post_init__(self) -> None:
        if not self.offset_range_s >= 0:
            raise InputError(f"offset_range_s must be at least 0, got {self.offset_range_s}")
        if self.estimate_line_time and self.registration.method == "vmf":
            raise InputError(
                "estimate_line_time: registration.method vmf takes line times as they are given; "
                "give them (line_time_s of a camera), or take correlation"
            )

    @property
    def synchronised(self) -> bool:
        """Clocks are taken to agree."""
        return self.offset_range_s == 0


_T = TypeVar("_T")


def options_from_mapping(given: Mapping[str, Any]) -> Options:
    """Options from a nested mapping, as a YAML file gives it.

    Raises
    ------
    InputError
        A key is unknown or a value has the wrong type; the message lists what there is.
    """
    return _overlay(Options(), given, "")


def _overlay(options: _T, given: Mapping[str, Any], path: str) -> _T:
    known = {f.name: getattr(options, f.name) for f in fields(options)}  # type: ignore[arg-type]
    changes: dict[str, Any] = {}
    for key, value in given.items():
        if key not in known:
            raise InputError(f"unknown option {path}{key}: there are {', '.join(known)}")
        changes[key] = _converted(known[key], value, f"{path}{key}")
    return replace(options, **changes)  # type: ignore[type-var]


def _converted(default: Any, value: Any, path: str) -> Any:
    if is_dataclass(default):
        if not isinstance(value, Mapping):
            raise InputError(f"option {path} holds further options, got {value!r}")
        return _overlay(default, value, path + ".")
    if isinstance(default, tuple):
        return distances_from_list(value, path)
    if isinstance(default, bool) or isinstance(value, bool):
        fits = isinstance(default, bool) and isinstance(value, bool)
    elif default is None:
        fits = value is None or isinstance(value, str)
    elif isinstance(default, float):
        fits = isinstance(value, int | float)
        value = float(value) if fits else value
    else:
        fits = isinstance(value, type(default))
    if fits:
        return value
    wanted = "text" if default is None else type(default).__name__
    raise InputError(f"option {path}: expected {wanted}, got {value!r}")
