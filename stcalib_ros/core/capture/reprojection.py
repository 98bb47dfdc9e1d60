"""People in the images of calibrated cameras: their triangulated joints, projected."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stcalib_ros.core.capture.limits import MAX_MOMENTS, MAX_OUTSIDE, SAME_PERSON
from stcalib_ros.core.geometry.lens import project
from stcalib_ros.core.geometry.robust import median_of_known
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.calibration import Calibration, CameraCalibration
from stcalib_ros.core.model.clocks import clock_correction
from stcalib_ros.core.model.recording import CameraRecording, Recording
from stcalib_ros.core.reconstruction.trajectories import PersonTrajectory

_ROW_STEPS = 2
"""Steps in which the row of a joint and its time, with a rolling shutter, are found: in the time of
the rows that somebody has moved by, they move by less than a row. Numerical."""


@dataclass(frozen=True, slots=True, eq=False)
class ImageOfPeople:
    """One image of one camera with the people in it.

    Attributes
    ----------
    camera : CameraCalibration
    stamp_s : float
        After the first image of the camera, seconds by its own clock.
    time_s : float
        By the reference clock, seconds since `Recording.epoch_ns`.
    projected : mapping of int to (J, 2) ndarray
        Joints of people, triangulated by all cameras and projected into this one, px, by
        `PersonTrajectory.person_id`; NaN where one is not known or not in view.
    found : (P, J', 2) ndarray
        Keypoints as the pose estimator found them, px; NaN where there is none.
    residual_px : float
        Root mean square distance of found joints from those projected; NaN without any.
    n_compared : int
        How many these are.
    """

    camera: CameraCalibration
    stamp_s: float
    time_s: float
    projected: Mapping[int, Float64Array]
    found: Float64Array
    residual_px: float
    n_compared: int


@dataclass(frozen=True, slots=True, eq=False)
class PeopleInImages:
    """All that is needed to draw the people of a recording into its images.

    Attributes
    ----------
    recording : Recording
    calibration : Calibration
    people : sequence of PersonTrajectory
        From `capture_people`.
    found : mapping of str to mapping of int to (P, J, 2) ndarray
        Keypoints of each image with people, px, by camera and the number of the image.
    """

    recording: Recording
    calibration: Calibration
    people: Sequence[PersonTrajectory]
    found: Mapping[str, Mapping[int, Float64Array]]

    def times_s(self) -> Float64Array:
        """Times (N,) of the reference camera's images, or those of the first one, on its clock."""
        times = reference_times(self.recording, self.calibration)
        return times.get(self.calibration.reference, next(iter(times.values())))

    def at(self, time_s: float) -> tuple[ImageOfPeople, ...]:
        """Return the image of every camera that is nearest to a time by the reference clock.

        Cameras that recorded nothing within a period of it are left out.
        """
        times = reference_times(self.recording, self.calibration)
        cameras = {camera.name: camera for camera in self.recording.cameras}
        found = []
        for pose in self.calibration.cameras:
            if pose.name not in times:
                continue
            own = times[pose.name]
            number = int(np.abs(own - time_s).argmin())
            if abs(own[number] - time_s) <= float(np.median(np.diff(own))):
                found.append(self._image(pose, cameras[pose.name], number, float(own[number])))
        return tuple(found)

    def best_time_s(self) -> float:
        """Return the time at which most joints are found near where they are projected."""
        times = self.times_s()
        times = times[:: -(-len(times) // MAX_MOMENTS)]
        images = [self.at(float(time_s)) for time_s in times]
        counts = [sum(image.n_compared for image in one) for one in images]
        squares = [
            float(np.nansum([one.n_compared * one.residual_px**2 for one in images_then]))
            for images_then in images
        ]
        rms = np.sqrt(np.array(squares) / np.maximum(counts, 1))
        return float(times[np.lexsort((rms, -np.array(counts)))[0]])

    def _image(
        self, pose: CameraCalibration, camera: CameraRecording, number: int, time_s: float
    ) -> ImageOfPeople:
        projected = {}
        for person in self.people:
            joints = joints_in_image(person, pose, time_s)
            if np.isfinite(joints).any():
                projected[person.person_id] = joints
        nobody = np.zeros((0, camera.layout.n_joints, 2))
        found = self.found[camera.name].get(number, nobody)
        away = _distances(projected, found, self._joints(camera))
        rms = float(np.sqrt(np.mean(away**2))) if len(away) else float("nan")
        stamp_s = float(camera.stamps[number] - camera.stamps[0])
        return ImageOfPeople(pose, stamp_s, time_s, projected, found, rms, len(away))

    def _joints(self, camera: CameraRecording) -> list[tuple[int, int]]:
        """Return pairs of the people's and the camera's numbers of joints of one name."""
        theirs = camera.layout.joint_names
        names = self.people[0].layout.joint_names if self.people else ()
        return [(k, theirs.index(name)) for k, name in enumerate(names) if name in theirs]


def people_in_images(
    recording: Recording,
    calibration: Calibration,
    people: Sequence[PersonTrajectory],
    *,
    min_score: float,
) -> PeopleInImages:
    """Return the people of a recording, to be drawn into its images.

    Parameters
    ----------
    recording : Recording
    calibration : Calibration
    people : sequence of PersonTrajectory
        From `stcalib_ros.core.capture.people.capture_people`.
    min_score : float
        Keypoints with a lower score are not there.
    """
    found = {camera.name: _found(camera, min_score) for camera in recording.cameras}
    return PeopleInImages(recording, calibration, people, found)


def reference_times(recording: Recording, calibration: Calibration) -> dict[str, Float64Array]:
    """Return the times of the images of the calibrated cameras by the reference clock.

    Parameters
    ----------
    recording : Recording
    calibration : Calibration

    Returns
    -------
    dict of str to (N,) ndarray
        Seconds since `Recording.epoch_ns`, by camera.
    """
    since_epoch_s = recording.epoch_ns * 1e-9 - calibration.epoch_s
    known = {camera.name: camera for camera in calibration.cameras}
    times = {}
    for camera in recording.cameras:
        if (own := known.get(camera.name)) is not None and len(camera.stamps) > 1:
            times[camera.name] = camera.stamps + clock_correction(
                own.time_offset_s, own.clock_skew, camera.stamps + since_epoch_s
            )
    return times


def joints_in_image(
    person: PersonTrajectory, camera: CameraCalibration, time_s: float
) -> Float64Array:
    """Return the joints (J, 2) of a person in an image, px; NaN where they are out of view.

    With a rolling shutter, each joint is where it was when its row was exposed.

    Parameters
    ----------
    person : PersonTrajectory
    camera : CameraCalibration
    time_s : float
        Of row 0 of the image, as `PersonTrajectory.times_s`.
    """
    times_s = np.full(person.joints_ref.shape[1], time_s)
    pixels = _projected(person, camera, times_s)
    for _ in range(_ROW_STEPS if camera.line_time_s else 0):
        rows = np.where(np.isfinite(pixels[:, 1]), pixels[:, 1], 0.0)
        pixels = _projected(person, camera, time_s + camera.line_time_s * rows)
    size = np.array([camera.intrinsics.width, camera.intrinsics.height])
    away = np.abs(pixels / size - 0.5).max(-1)
    if not (2 * away <= 1).any():
        return np.full_like(pixels, np.nan)
    return np.where((away <= 0.5 + MAX_OUTSIDE)[:, None], pixels, np.nan)


def _projected(
    person: PersonTrajectory, camera: CameraCalibration, times_s: Float64Array
) -> Float64Array:
    """Pixels (J, 2) of joints, each at its own time (J,)."""
    at = (times_s - person.times_s[0]) / _step_s(person)
    first = np.clip(np.floor(at).astype(int), 0, max(len(person.times_s) - 2, 0))
    weight = at - first
    number = np.arange(len(at))
    one = person.joints_ref[first, number]
    other = person.joints_ref[np.minimum(first + 1, len(person.times_s) - 1), number]
    inside = (at >= -1.0) & (at <= len(person.times_s))
    joints = one + np.clip(weight, 0.0, 1.0)[:, None] * (other - one)
    joints = np.where(
        np.isfinite(joints), joints, np.where(np.round(weight)[:, None] < 1, one, other)
    )
    joints = np.where(inside[:, None], joints, np.nan)
    pixels = project((joints - camera.t_ref_cam) @ camera.R_ref_cam, camera.intrinsics)
    return np.asarray(pixels)


def _step_s(person: PersonTrajectory) -> float:
    return float(np.diff(person.times_s[:2])[0]) if len(person.times_s) > 1 else 1.0


def _found(camera: CameraRecording, min_score: float) -> dict[int, Float64Array]:
    """Keypoints (P, J, 2) of each image with people."""
    found: dict[int, list[Float64Array]] = {}
    for track in camera.tracks:
        known = np.where(track.scores[..., None] >= min_score, track.keypoints, np.nan)
        for frame, keypoints in zip(track.frames, known, strict=True):
            found.setdefault(int(frame), []).append(keypoints)
    return {frame: np.array(one, dtype=np.float64) for frame, one in found.items()}


def _distances(
    projected: Mapping[int, Float64Array], found: Float64Array, pairs: Sequence[tuple[int, int]]
) -> Float64Array:
    """Distances of found joints from those of the person who is nearest, px."""
    if not projected or not len(found) or not pairs:
        return np.zeros(0)
    mine, theirs = np.array(pairs).T
    people = np.stack(list(projected.values()))[:, mine]
    away = np.linalg.norm(found[:, None, theirs] - people[None], axis=-1)
    typical = median_of_known(away)
    height = np.nanmax(people[..., 1], -1) - np.nanmin(people[..., 1], -1)
    nearest = np.nanargmin(np.where(np.isfinite(typical), typical, np.inf), axis=1)
    rows = np.arange(len(found))
    same = typical[rows, nearest] < SAME_PERSON * height[nearest]
    chosen = away[rows[same], nearest[same]]
    return np.asarray(chosen[np.isfinite(chosen)])
