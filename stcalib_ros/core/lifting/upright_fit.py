"""Fit of one camera's focal length and vertical to the upright people before it.

The unknowns are the focal length, the vertical, the heights of hips and shoulders of each person
over that of the camera, and where on the floor each pose is; the last are eliminated from the
normal equations.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.model.arrays import Float64Array, IntArray

POINTS = ("ankle", "hip", "shoulder")
"""Points of a body, each the middle of a left and a right joint."""
_SHARE = (0.0, 0.6, 1.0)
"""Ratio of the heights of `POINTS` above the ankles to that of the shoulders. Derived: of an adult;
the fit starts there, and a lean moves the points in this proportion."""
_ALONG = (0.03, 0.015, 0.015)
"""Ratio to the height of the shoulders above the ankles. Standard deviation of `POINTS` along the
body: feet in the air, bent knees. Measured on the walkers of the demo and of simulated scenes."""
_ACROSS = (0.02, 0.015, 0.015)
"""The same across the body, without the lean. Measured as `_ALONG`."""
_LEAN = 0.04
"""rad. Standard deviation of the lean of a body that is upright, in the image. Chosen: 2.3 degrees,
between those of people who stand, and of those who walk and turn."""
_SAME_HEIGHT = 0.1
"""Standard deviation of the logarithm of heights of people about their mean. Derived: adults have
0.05 to 0.06; twice it for steps and beams on which somebody walks."""
_LEAST_SCALE = 0.25
"""Ratio of variances. People who stand still show less than the errors of posture above, which are
not taken to be smaller than half. Measured: 0.25 to 0.5 in simulated walkers."""
_OUTLIER = 3.0
"""Standard deviations. Scale of the Cauchy loss on the error of a pose. Chosen."""
FIRST_TILTS = (0.25, 0.7, -0.25)
"""rad. Tilts of the camera that the fit starts from, until one fits: of a camera on a tripod, under
a ceiling, and near the floor. Measured on people without errors: 2 to 21 degrees are reached from
the first, 35 and 50 from the second, -18 and -12 from the third."""
_ROUNDS = 4
"""Rounds of the fit, each with the scale of the errors of the last. Numerical."""
_STEPS = 4
"""Steps of a round. Numerical: each is nearly a Newton step."""
_LARGEST_STEP = 0.3
"""rad, and logarithm of a ratio. Longer steps are cut. Numerical."""
_LEAST_DAMPING = 1e-6
"""Ratio to the diagonal of the normal equations; damping is not less. Numerical."""
_MOST_DAMPING = 1e3
"""See `_LEAST_DAMPING`: where so much finds no smaller cost, there is none. Numerical."""
_DAMPING_FACTOR = 6.0
"""Ratio by which the damping grows and shrinks. Numerical."""
_DIFFERENCE = 1e-6
"""Step of the numerical derivatives, in the units of the unknowns. Numerical."""
_LEAST_DEPTH = 0.05
"""Depth over that of the ankles. Points of a body are not taken to be nearer. Numerical."""
_COMMON = 3
"""Unknowns of all poses: logarithm of the ratio of focal lengths, tilt, roll. Definition."""
_OWN = len(POINTS) - 1
"""Unknown heights of a person: those above the ankles. Definition."""


@dataclass(frozen=True, slots=True, eq=False)
class UprightPostures:
    """Upright poses of one camera.

    Attributes
    ----------
    points : (N, 3, 2) ndarray
        `POINTS` on the plane z = 1.
    ankles : (N, 2, 2) ndarray
    person : (N,) ndarray of int
        Number of the track.
    time_s : (N,) ndarray
    """

    points: Float64Array
    ankles: Float64Array
    person: IntArray
    time_s: Float64Array


@dataclass(frozen=True, slots=True, eq=False)
class UprightUnknowns:
    """Values of a fit.

    Attributes
    ----------
    common : (3,) ndarray
        Logarithm of the ratio of focal lengths; tilt and roll of the camera, rad.
    heights : (P, 2) ndarray
        Logarithm of the heights of hips and shoulders over ankles, over that of the camera.
    ground : (N, 2) ndarray
        Image of the point of the floor of every pose, at the height of the ankles.
    """

    common: Float64Array
    heights: Float64Array
    ground: Float64Array


@dataclass(frozen=True, slots=True, eq=False)
class _Normal:
    """Normal equations of M unknowns, those of the places eliminated.

    Attributes
    ----------
    each : (N, M, M) ndarray
        Of every pose.
    scores : (N, M) ndarray
        Gradient of half the cost by every pose.
    ground : (N, 2) ndarray
        Negative step of the places if the other unknowns stay.
    ground_by_rest : (N, 2, M) ndarray
        What is added to it for each unit of the steps of the others.
    """

    each: Float64Array
    scores: Float64Array
    ground: Float64Array
    ground_by_rest: Float64Array


class UprightFit:
    """Levenberg-Marquardt fit of focal length, vertical, heights and places to upright poses."""

    def __init__(self, postures: UprightPostures, tilt: float) -> None:
        self.postures = postures
        self.points = postures.points
        body = self.points[:, -1] - self.points[:, 0]
        size = np.linalg.norm(body, axis=-1)
        along = body / size[:, None]
        across = np.stack([-along[:, 1], along[:, 0]], -1)
        self.to_body = np.stack([along, across], 1) / size[:, None, None]
        self.whitening = _whitening()
        up = np.median(along, axis=0)
        self.up = up / np.linalg.norm(up)
        n_people = int(postures.person.max()) + 1
        self.similar = np.zeros((_COMMON + _OWN * n_people,) * 2)
        centring = np.eye(n_people) - 1.0 / n_people
        self.similar[_COMMON:, _COMMON:] = np.kron(centring, np.eye(_OWN)) / _SAME_HEIGHT**2
        common = np.array([0.0, tilt, 0.0])
        below = -_homogeneous(self.points[:, 0]) @ _vertical(common, self.up)
        height = np.median(size) / max(float(np.median(below)), _LEAST_DEPTH)
        heights = np.tile(np.log(height * np.array(_SHARE[1:])), (n_people, 1))
        self.at = UprightUnknowns(common, heights, self.points[:, 0])
        self.scale = 1.0

    def run(self) -> None:
        """Fit, with places and scale of the errors by the fit so far."""
        for k in range(_ROUNDS):
            if k:
                self.points = self._with_middle_of_feet()
                squared = self._squared(self.at)
                self.scale = max(float(np.median(squared)) / _freedom(), _LEAST_SCALE)
            self._descend()

    def _descend(self) -> None:
        damping = _LEAST_DAMPING
        cost = self._cost(self.at)
        for _ in range(_STEPS):
            normal = self._normal_equations()
            H = normal.each.sum(0) + self.similar
            g = normal.scores.sum(0) + self.similar @ self._values(self.at)
            while damping <= _MOST_DAMPING:
                step = -np.linalg.solve(H + damping * np.diag(np.diag(H)), g)
                step = np.clip(step, -_LARGEST_STEP, _LARGEST_STEP)
                there = self._stepped(step, -normal.ground - normal.ground_by_rest @ step)
                cost_there = self._cost(there)
                if cost_there < cost:
                    break
                damping *= _DAMPING_FACTOR
            else:
                break
            self.at, cost = there, cost_there
            damping = max(damping / _DAMPING_FACTOR**2, _LEAST_DAMPING)

    def _with_middle_of_feet(self) -> Float64Array:
        """Return the points with the image of the middle between the feet on the floor.

        The nearer foot is larger in the image: the middle of two points is nearer to the farther.
        """
        ankles = self.postures.ankles
        ratio, up = np.exp(self.at.common[0]), _vertical(self.at.common, self.up)
        below = -(ankles @ up[:2] / ratio + up[2])
        depth = 1.0 / np.maximum(below, _LEAST_DEPTH)
        middle = (depth[..., None] * ankles).sum(1) / depth.sum(1)[:, None]
        return np.concatenate([middle[:, None], self.points[:, 1:]], 1)

    def _residuals(self, own: Float64Array) -> Float64Array:
        """Whitened errors (N, 6) of poses with unknowns (N, 7) of their own."""
        error = _projected(own, self.up) - self.points
        in_body = np.einsum("nab,njb->nja", self.to_body, error)
        return np.asarray(in_body.reshape(len(own), -1) @ self.whitening.T)

    def _own(self, at: UprightUnknowns) -> Float64Array:
        common = np.broadcast_to(at.common, (len(at.ground), _COMMON))
        return np.concatenate([common, at.heights[self.postures.person], at.ground], -1)

    def _squared(self, at: UprightUnknowns) -> Float64Array:
        return np.asarray((self._residuals(self._own(at)) ** 2).sum(-1))

    def _cost(self, at: UprightUnknowns) -> float:
        limit = _OUTLIER**2 * _freedom()
        robust = limit * float(np.log1p(self._squared(at) / (self.scale * limit)).sum())
        values = self._values(at)
        return robust + float(values @ self.similar @ values)

    def _values(self, at: UprightUnknowns) -> Float64Array:
        return np.concatenate([at.common, at.heights.ravel()])

    def _normal_equations(self) -> _Normal:
        own = self._own(self.at)
        error = self._residuals(own)
        shifts = _DIFFERENCE * np.eye(own.shape[1])
        J = np.stack([self._residuals(own + d) - error for d in shifts], -1) / _DIFFERENCE
        J_ground, n = J[..., _COMMON + _OWN :], len(self.similar)
        J_all = np.zeros((*error.shape, n))
        J_all[..., :_COMMON] = J[..., :_COMMON]
        column = _COMMON + _OWN * self.postures.person[:, None] + np.arange(_OWN)
        np.put_along_axis(J_all, column[:, None], J[..., _COMMON : _COMMON + _OWN], -1)
        to_ground = np.linalg.pinv(J_ground)
        rest = J_all - J_ground @ (to_ground @ J_all)
        weight = self._robust_weights(error) / self.scale
        each = weight[:, None, None] * (np.swapaxes(rest, -1, -2) @ rest)
        scores = weight[:, None] * np.einsum("nia,ni->na", rest, error)
        ground = np.einsum("nai,ni->na", to_ground, error)
        return _Normal(each, scores, ground, np.asarray(to_ground @ J_all, np.float64))

    def _robust_weights(self, error: Float64Array) -> Float64Array:
        limit = _OUTLIER**2 * _freedom() * self.scale
        return np.asarray(1.0 / (1.0 + (error**2).sum(-1) / limit))

    def _stepped(self, step: Float64Array, ground: Float64Array) -> UprightUnknowns:
        return UprightUnknowns(
            self.at.common + step[:_COMMON],
            self.at.heights + step[_COMMON:].reshape(self.at.heights.shape),
            self.at.ground + ground,
        )

    def focal_stddev(self, place: IntArray) -> float:
        """Standard deviation of the logarithm of the focal length.

        It is the larger one of two: as if all errors of a place were one, of the size that is
        usual or that all have; and by the errors that each place has.

        Parameters
        ----------
        place : (N,) ndarray of int
            Numbers from 0; poses with one number have one error.
        """
        normal = self._normal_equations()
        weight = self._robust_weights(self._residuals(self._own(self.at)))
        counted = np.bincount(place, weight)[place]
        by_model = np.einsum("n,nab->ab", counted, normal.each) + self.similar
        total = np.stack([np.bincount(place, column) for column in normal.scores.T], -1)
        found = _COMMON + _OWN
        by_errors = total.T @ total * len(total) / max(len(total) - found, 1)
        inverse = np.linalg.inv(normal.each.sum(0) + self.similar)
        return float(max(np.sqrt((inverse @ S @ inverse)[0, 0]) for S in (by_model, by_errors)))


def _freedom() -> int:
    """Residuals of a pose less the unknowns of its place."""
    return 2 * len(POINTS) - 2


def _whitening() -> Float64Array:
    """Return W (6, 6) with ``W C W^T = I`` for the covariance of a pose along and across a body."""
    stddev = np.stack([_ALONG, _ACROSS], -1).ravel()
    lean = np.stack([np.zeros(len(POINTS)), _LEAN * np.array(_SHARE)], -1).ravel()
    return np.asarray(np.linalg.inv(np.linalg.cholesky(np.diag(stddev**2) + np.outer(lean, lean))))


def _homogeneous(x: Float64Array) -> Float64Array:
    return np.concatenate([x, np.ones((*x.shape[:-1], 1))], -1)


def _vertical(common: Float64Array, up_image: Float64Array) -> Float64Array:
    """Return the upward direction (..., 3) of cameras (..., 3), tilted down and rolled.

    Without roll it is that of `up_image` in the image.
    """
    tilt, roll = common[..., 1], common[..., 2]
    aside = np.array([-up_image[1], up_image[0]])
    image = np.cos(roll)[..., None] * up_image + np.sin(roll)[..., None] * aside
    return np.concatenate([np.cos(tilt)[..., None] * image, -np.sin(tilt)[..., None]], -1)


def _projected(own: Float64Array, up_image: Float64Array) -> Float64Array:
    """Return the points (N, 3, 2) of poses with unknowns (N, 7): common, heights and ground."""
    common, heights = own[:, :_COMMON], own[:, _COMMON : _COMMON + _OWN]
    ratio, up = np.exp(own[:, :1]), _vertical(common, up_image)
    ground = _homogeneous(own[:, _COMMON + _OWN :] / ratio)
    below = -(ground * up).sum(-1)
    share = np.concatenate([np.zeros((len(own), 1)), np.exp(heights)], -1) * below[:, None]
    X = ground[:, None] + share[..., None] * up[:, None]
    depth = np.maximum(X[..., 2:], _LEAST_DEPTH)
    return np.asarray(ratio[:, None] * X[..., :2] / depth)
