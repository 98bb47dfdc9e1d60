"""The unknowns of the cameras, each described once, and their places in the normal equations.

Whatever an unknown of a camera does to a keypoint is a displacement of the point in the axes of
that camera: a rotation by ``e`` moves it by ``e x y``, a translation by ``e``, a delay of the
image by the velocity. One more unknown is one more `CameraUnknown`, named in the list of those to
estimate: solver, refinement and covariance take it from their `ParameterLayout`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from stcalib_ros.core.bundle.gauge import camera_centres, spread, spread_gradient
from stcalib_ros.core.bundle.lenses import Lenses
from stcalib_ros.core.bundle.point_views import PointTimes, PointView
from stcalib_ros.core.bundle.scaled_system import ScaledSystem, propagate
from stcalib_ros.core.geometry.so3 import exp_so3
from stcalib_ros.core.model.arrays import BoolArray, Float32Array, Float64Array, IntArray


@dataclass(frozen=True, slots=True, eq=False)
class CameraUnknown:
    """One unknown of every camera.

    Attributes
    ----------
    name : str
        In the names of the covariance.
    unit : str
    retract : callable, optional
        Cameras after a step (C, size). Default: the step is added to the values of the unknown.
    size : int
        Number of its components; more than one with a `retract` of its own only.
    of_clock : bool
        Known where the clocks are synchronised.
    relative : bool
        Measured against the reference camera, whose own is fixed.
    of_lens : bool
        The same in cameras that have one lens.
    row : int, optional
        Of a correction of a lens: its row in `Lenses`.
    delay : callable, optional
        Of an unknown that delays the keypoints: their delay per unit of it.
    displacements : callable, optional
        Of any other: displacements (..., size, 3, P) of the points in the axes of the cameras, per
        unit of each component. One without `retract` acts linearly: points move by its value
        times this.
    """

    name: str
    unit: str
    retract: Callable[[Cameras, Float64Array], Cameras] | None = None
    size: int = 1
    of_clock: bool = False
    relative: bool = True
    of_lens: bool = False
    row: int | None = None
    delay: Callable[[PointTimes], Float32Array | Float64Array] | None = None
    displacements: Callable[[PointView], Float64Array] | None = None

    def derivative(self, view: PointView) -> Float64Array:
        """Displacements (..., size, 3, P) of points in the axes of the cameras, per unit."""
        if self.delay is not None:
            moved = view.velocity * self.delay(view.times)[..., None, :]
            return np.asarray(moved[..., None, :, :])
        if self.displacements is None:
            raise TypeError(f"unknown {self.name}: needs a delay or displacements")
        return self.displacements(view)

    def stepped(self, cameras: Cameras, step: Float64Array) -> Cameras:
        """Cameras after a step (C, size)."""
        if self.retract is not None:
            return self.retract(cameras, step)
        value = cameras.value(self) + step[:, 0]
        return replace(cameras, further={**cameras.further, self: value})


@dataclass(frozen=True, slots=True, eq=False)
class Cameras:
    """Values of the unknowns of C cameras.

    Attributes
    ----------
    R : (C, 3, 3) ndarray
        ``x_cam = R @ x_ref + t``.
    t : (C, 3) ndarray
    shift : (C,) ndarray
        Corrections of the time offsets, s.
    further : mapping of CameraUnknown to (C,) ndarray
        Values of further unknowns; 0 where missing.
    lenses : Lenses or None
        None where all are given.
    """

    R: Float64Array
    t: Float64Array
    shift: Float64Array
    further: Mapping[CameraUnknown, Float64Array] = field(default_factory=dict)
    lenses: Lenses | None = None

    def value(self, unknown: CameraUnknown) -> Float64Array:
        """Values (C,) of a further unknown."""
        return np.asarray(self.further.get(unknown, np.zeros(len(self.t))))

    def length(self) -> float:
        """Length that the gauge holds: the spread of the centres."""
        return spread(camera_centres(self.R, self.t))

    def scaled(self, factor: float) -> Cameras:
        """The cameras of a scene that is larger by a factor."""
        return replace(self, t=factor * self.t)

    def only(self, c: int) -> Cameras:
        """One camera."""
        own = slice(c, c + 1)
        further = {unknown: value[own] for unknown, value in self.further.items()}
        lens = None if self.lenses is None else self.lenses.only(c)
        return Cameras(self.R[own], self.t[own], self.shift[own], further, lens)

    def delay(self, times: PointTimes) -> Float64Array:
        """Delay of keypoints against the times of the observations, s: (C, 1) or (..., C, P)."""
        delay = self.shift[:, None]
        for unknown, value in self.further.items():
            if unknown.delay is not None:
                delay = delay + value[:, None] * unknown.delay(times)
        return np.asarray(delay)

    def displaced(self, view: PointView) -> Float64Array:
        """Points (..., C, 3, P) in the frames of the cameras, moved by further unknowns."""
        Z = view.Z
        for unknown, value in self.further.items():
            if unknown.displacements is not None and value.any():
                Z = Z + value[:, None, None] * unknown.derivative(view)[..., 0, :, :]
        return Z


def _rotated(cameras: Cameras, step: Float64Array) -> Cameras:
    return replace(cameras, R=exp_so3(step) @ cameras.R)


def _translated(cameras: Cameras, step: Float64Array) -> Cameras:
    return replace(cameras, t=cameras.t + step)


def _shifted(cameras: Cameras, step: Float64Array) -> Cameras:
    return replace(cameras, shift=cameras.shift + step[:, 0])


def _by_rotation(view: PointView) -> Float64Array:
    y = view.y
    out = np.zeros((*y.shape[:-2], 3, *y.shape[-2:]))
    for b in range(3):
        i, k = (b + 1) % 3, (b + 2) % 3
        out[..., b, i, :], out[..., b, k, :] = -y[..., k, :], y[..., i, :]
    return out


def _by_translation(view: PointView) -> Float64Array:
    return np.broadcast_to(np.eye(3)[..., None], (*view.y.shape[:-2], 3, *view.y.shape[-2:]))


ROTATION = CameraUnknown("rotation", "rad", _rotated, 3, displacements=_by_rotation)
TRANSLATION = CameraUnknown("translation", "length", _translated, 3, displacements=_by_translation)
TIME_OFFSET = CameraUnknown("time_offset", "s", _shifted, of_clock=True, delay=lambda _: np.ones(1))
CLOCK_SKEW = CameraUnknown("clock_skew", "s/s", of_clock=True, delay=lambda times: times.since_s)
LINE_DELAY = CameraUnknown("line_delay", "s/row", relative=False, delay=lambda times: times.row)

_WORLD_STDDEV = 0.1
"""Radians. Standard deviation of the orientation of a world that nothing else holds: where all
images are taken at the same times. Numerical: far more than adjustments turn a camera by."""
WORLD_STEP = 0.005
"""Radians. How far the world turns in one adjustment, about. Measured: points move in straight
lines; with 0.1 the demo takes twice the steps, with 0.005 principal points are as accurate."""

POSE_AND_CLOCK = (ROTATION, TRANSLATION, TIME_OFFSET)
"""Unknowns of every adjustment, in the order of its columns."""

FURTHER_UNKNOWNS = (CLOCK_SKEW, LINE_DELAY)
"""Unknowns that are estimated where the recording determines them."""


@dataclass(frozen=True, slots=True, eq=False)
class ParameterLayout:
    """Which unknowns of which cameras are estimated, and their columns in the normal equations.

    The columns of one camera stand together, in the order of `unknowns`. The gauge is the pose and
    clock of the reference camera and the spread of the centres.

    Attributes
    ----------
    n_cameras : int
    synchronised : bool
        The clocks are known to agree.
    further : tuple of CameraUnknown
        Beside pose and time offset.
    estimated : tuple of (C,) ndarray of bool
        Cameras of which each further unknown is estimated; of the others it keeps its value.
    group : (C,) ndarray of int, optional
        Cameras with one number have one lens. Default: all have their own.
    """

    n_cameras: int
    synchronised: bool = False
    further: tuple[CameraUnknown, ...] = ()
    estimated: tuple[BoolArray, ...] = ()
    group: IntArray | None = None

    @property
    def unknowns(self) -> tuple[CameraUnknown, ...]:
        """All unknowns of a camera."""
        return POSE_AND_CLOCK + self.further

    @property
    def block(self) -> int:
        """Number of columns of one camera."""
        return sum(unknown.size for unknown in self.unknowns)

    @property
    def size(self) -> int:
        """Number of columns of all cameras."""
        return self.block * self.n_cameras

    def with_unknown(self, unknown: CameraUnknown, cameras: BoolArray) -> ParameterLayout:
        """Layout with one more unknown, of some cameras (C,); the same if of none."""
        if not cameras.any():
            return self
        further, estimated = (*self.further, unknown), (*self.estimated, cameras)
        return replace(self, further=further, estimated=estimated)

    def of_camera(self, c: int) -> slice:
        """Columns of one camera."""
        return slice(self.block * c, self.block * (c + 1))

    def within(self, unknown: CameraUnknown) -> slice:
        """Columns of an unknown within those of its camera."""
        at = self.unknowns.index(unknown)
        begin = sum(one.size for one in self.unknowns[:at])
        return slice(begin, begin + unknown.size)

    def columns(self, unknown: CameraUnknown) -> IntArray:
        """Columns (C, size) of an unknown of every camera."""
        own = np.arange(self.block)[self.within(unknown)]
        return np.asarray(self.block * np.arange(self.n_cameras)[:, None] + own)

    def scalars(self, unknown: CameraUnknown) -> IntArray:
        """Columns (C,) of an unknown of one component."""
        return self.columns(unknown)[:, 0]

    def find(self, name: str) -> CameraUnknown:
        """Unknown of a name.

        Raises
        ------
        KeyError
            It is not among those of the layout.
        """
        for unknown in self.unknowns:
            if unknown.name == name:
                return unknown
        raise KeyError(f"{name}: not among {', '.join(one.name for one in self.unknowns)}")

    def free(self) -> IntArray:
        """Columns that are estimated, increasing."""
        chosen = np.ones((self.n_cameras, self.block), dtype=bool)
        masks = (np.ones(self.n_cameras, dtype=bool),) * len(POSE_AND_CLOCK) + self.estimated
        for unknown, mask in zip(self.unknowns, masks, strict=True):
            own = mask & (not (unknown.of_clock and self.synchronised))
            own[0] &= not unknown.relative or (unknown is ROTATION and self.turns_reference)
            chosen[:, self.within(unknown)] = own[:, None]
        return np.flatnonzero(chosen)

    @property
    def turns_reference(self) -> bool:
        """Whether the reference camera turns against the world, by which its orientation is held.

        Velocities are fixed in the world. If it could not turn, they would hold it where it is,
        and with it the principal point, which is off as it is turned.
        """
        pairs = zip(self.further, self.estimated, strict=True)
        return any(unknown.row is not None and bool(mask.any()) for unknown, mask in pairs)

    def estimating(self, unknown: CameraUnknown, cameras: BoolArray) -> ParameterLayout:
        """The same columns, a further unknown estimated for some cameras (C,) only."""
        pairs = zip(self.further, self.estimated, strict=True)
        masks = tuple(cameras if one is unknown else mask for one, mask in pairs)
        return replace(self, estimated=masks)

    def held(self) -> ParameterLayout:
        """The same columns, none of the further unknowns estimated."""
        none = np.zeros(self.n_cameras, dtype=bool)
        return replace(self, estimated=(none,) * len(self.further))

    def without_lenses(self) -> ParameterLayout:
        """The same columns, no correction of a lens estimated."""
        none = np.zeros(self.n_cameras, dtype=bool)
        pairs = zip(self.further, self.estimated, strict=True)
        masks = tuple(mask if one.row is None else none for one, mask in pairs)
        return replace(self, estimated=masks)

    def common(self, other: ParameterLayout) -> tuple[IntArray, IntArray]:
        """Columns of the unknowns that both layouts have, in this one and in the other."""
        both = [one for one in self.unknowns if one in other.unknowns]
        mine, theirs = (
            np.concatenate([layout.columns(one).ravel() for one in both])
            for layout in (self, other)
        )
        return mine, theirs

    def scale_direction(self, cameras: Cameras) -> Float64Array:
        """Unit vector (size,) along which the length of the gauge grows fastest."""
        out = np.zeros(self.size)
        by_rotation, by_translation = spread_gradient(cameras.R, cameras.t)
        out[self.columns(ROTATION)] = by_rotation
        out[self.columns(TRANSLATION)] = by_translation
        return np.asarray(out / np.linalg.norm(out))

    def n_free(self) -> int:
        """Number of unknowns that are estimated, those of a shared lens counted once."""
        return int(self._steps().shape[1])

    def _steps(self) -> Float64Array:
        """Steps (size, n) that the columns can take: each its own, or with those of one lens."""
        free = self.free()
        number = np.arange(self.size)
        for unknown in self.further if self.group is not None else ():
            if unknown.of_lens:
                columns = self.scalars(unknown)
                number[columns] = columns[self.group]
        _, step = np.unique(number[free], return_inverse=True)
        steps = np.zeros((self.size, int(step.max(initial=-1)) + 1))
        steps[free, step] = 1.0
        return steps

    def _in_gauge(self, H: Float64Array, cameras: Cameras) -> tuple[ScaledSystem, Float64Array]:
        steps = self._steps()
        scale = self.scale_direction(cameras) @ steps
        return ScaledSystem.of(steps.T @ H @ steps, scale), steps

    def solve(self, H: Float64Array, g: Float64Array, cameras: Cameras) -> Float64Array:
        """Solution (C, block) of ``H x = g`` in the gauge; 0 where nothing is estimated."""
        system, steps = self._in_gauge(H, cameras)
        out = steps @ system.solve(g @ steps)
        return np.asarray(out.reshape(self.n_cameras, self.block))

    def inverse(self, H: Float64Array, cameras: Cameras) -> Float64Array:
        """Covariance (size, size) of normal equations H in the gauge.

        Rows of what is not estimated are zero. What is not observable has an infinite variance, and
        no covariance with anything.
        """
        system, steps = self._in_gauge(H, cameras)
        return propagate(steps, system.inverse())

    def prior(
        self, cameras: Cameras, *, world_stddev: float = _WORLD_STDDEV
    ) -> tuple[Float64Array, Float64Array]:
        """What was known of the lenses: inverse variances (size,), and the unknowns' deviations.

        And of the orientation of the world, so that there is one.
        """
        information, deviation = np.zeros((2, self.size))
        if self.turns_reference:
            information[self.columns(ROTATION)[0]] = world_stddev**-2
        lenses = cameras.lenses
        if lenses is not None:
            known = lenses.information()
            for unknown in self.further:
                if unknown.row is not None:
                    own = self.scalars(unknown)
                    information[own] = known[unknown.row]
                    deviation[own] = cameras.value(unknown) - lenses.mean[unknown.row]
        return information, deviation

    def retract(self, cameras: Cameras, step: Float64Array) -> Cameras:
        """Cameras after a step (C, block)."""
        for unknown in self.unknowns:
            cameras = unknown.stepped(cameras, step[:, self.within(unknown)])
        return cameras

    def names(self, cameras: Sequence[str]) -> tuple[str, ...]:
        """Names ``camera.unknown`` by camera and unknown, in the order of the columns."""
        return tuple(f"{camera}.{unknown.name}" for camera in cameras for unknown in self.unknowns)
