"""The limits that decide whether a camera, and with it a calibration, is published or refused.

They are fields of a record, so that decisions can be replayed with changed ones.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class CheckThresholds:
    """Limits of `camera_checks.rejection` and of what follows from it.

    Where nothing else is said, a limit was chosen on the simulated scenes of
    ``benchmarks.accuracy.level``, and is not verified on real recordings.

    *Measured* is what ``benchmarks.accuracy.limits`` counts. On 154 simulated solutions all 19
    wrong ones are refused, and 18 of 135 good ones. On 24 solutions of one real clip, 16 of 20
    wrong ones are refused, and none of 4 good ones. *Alone* is without all other limits: most
    wrong solutions violate several.
    """

    min_inliers: int = 400
    """Keypoints, count. A camera needs as many inliers. Keypoints of one image are correlated: with
    17 of a person these are 24 images of one person. Chosen on simulated scenes, short ones.
    Measured: alone it refuses 10 wrong simulated and 3 wrong real solutions, no good ones; 20 %
    either way changes nothing."""

    min_inlier_fraction: float = 0.55
    """Ratio. Inliers over all keypoints of the associated persons of a camera, at least: else its
    intrinsics are wrong or persons are exchanged. Chosen on simulated scenes.
    Measured: alone it refuses 3 wrong real solutions, no simulated ones. It guards against wrong
    intrinsics, which the benchmark does not have."""

    min_explained_fraction: float = 0.5
    """Ratio. Inliers over all keypoints of a camera, of whomever, at least; unless its pose is
    certain by the three limits that begin with ``certain``. Two cameras that share nobody still
    find a pose at which somebody's steps agree for a while. Chosen on simulated scenes.
    Measured: alone it refuses 15 wrong and no good simulated, and 10 wrong real solutions. 20 %
    larger it would refuse the 4 wrong real ones that are published, and no further good one; 20 %
    smaller, 2 more wrong real ones would be published."""

    min_shared_s: float = 2.5
    """Seconds. Motion that a camera shares with others, summed over persons, from which on
    `min_explained_fraction` is enough: in a second or two, other steps fit by chance. Chosen on
    simulated scenes, short ones.
    Measured: without it 3 wrong simulated and 2 more wrong real solutions are published, and 13
    more good ones; 20 % smaller, 2 more wrong real ones."""

    min_explained_fraction_if_short: float = 0.7
    """Ratio. As `min_explained_fraction`, for a camera that shares less than `min_shared_s`.
    Chosen on simulated scenes, short ones.
    Measured: 20 % smaller, 2 wrong simulated solutions are published and 10 more good ones; 20 %
    larger, 12 more good ones are refused."""

    certain_rotation_stddev: float = 0.005
    """Radians. Below it the rotation is certain enough to allow a small explained fraction: a third
    of `max_rotation_stddev`. Chosen on simulated scenes.
    Measured: without this exception 2 more good simulated solutions are refused, and no wrong one;
    20 % either way changes nothing."""

    certain_bone_rotation: float = 0.1
    """Radians. Below it the monocular poses confirm the rotation, and allow the same: a third of
    `max_bone_rotation`. Sound simulated scenes stay below it.
    Measured: without it 2 more wrong real solutions are published; 20 % either way changes
    nothing."""

    certain_offset_peak_ratio: float = 3.0
    """Ratio of errors. Above it the time offset is distinct, and allows the same. Chosen on
    simulated scenes.
    Measured: nothing in the benchmark depends on it. It guards against strangers who walk in step,
    where another offset fits nearly as well."""

    max_bone_rotation: float = 0.3
    """Radians. Angle between the rotation of a camera and that of the monocular bones from which on
    persons count as exchanged: three times what sound simulated scenes have.
    Measured: alone it refuses 1 wrong simulated and 8 wrong real solutions, no good ones; 20 %
    either way changes nothing."""

    max_depth_ratio: float = 1.6
    """Ratio. Distance of people by triangulation over that by their size, relative to the other
    cameras: between 1 / 1.6 and 1.6, else persons count as exchanged. Sound simulated scenes are
    within 10 %.
    Measured: alone it refuses 2 wrong real solutions, no simulated ones; 20 % either way changes
    nothing."""

    max_rotation_stddev: float = 0.015
    """Radians. Largest standard deviation of a rotation; 7.5 cm at a distance of 5 m. Chosen on
    simulated scenes.
    Measured: alone it refuses 10 wrong and 1 good simulated, and 10 wrong real solutions; 20 %
    either way changes nothing."""

    max_position_stddev: float = 0.10
    """Ratio. Largest standard deviation of a position over the distance from the people. Chosen on
    simulated scenes.
    Measured: alone it refuses 2 wrong simulated and 3 wrong real solutions, no good ones; 20 %
    either way changes nothing."""

    max_offset_stddev_frames: float = 1.0
    """Frames. Largest standard deviation of a time offset. Derived: with more, the images that are
    combined are not the nearest ones.
    Measured: alone it refuses 2 wrong real solutions, no simulated ones; 20 % either way changes
    nothing."""

    min_offset_peak_ratio: float = 1.2
    """Ratio. Error at the best other time offset over the error at the one found, at least.
    Periodic motion and people who stand bring it down to 1. Chosen on simulated scenes.
    Measured: alone it refuses 5 wrong real solutions, and 1 good simulated one; 20 % larger, 5
    more good ones are refused."""

    many_outliers: float = 0.2
    """Ratio. Fraction of outliers from which on offsets are also compared in all keypoints, as
    those that are outliers here may fit at the true offset. Chosen on simulated scenes: seed 2004
    with clips that repeat themselves."""

    min_offset_peak_ratio_with_outliers: float = 1.1
    """Ratio. As `min_offset_peak_ratio`, in all keypoints. Chosen on the same scene.
    Measured: alone it refuses 2 wrong and 2 good simulated, and 6 wrong real solutions; without
    it 1 more good one is published."""

    max_failed_fraction: float = 0.5
    """Ratio. Cameras that fail are left out one by one while they are fewer than this fraction of
    all; else the solution as a whole is refused. Derived: of half and more, nothing says that it
    is they who are wrong."""


DEFAULT = CheckThresholds()
"""The limits that are in use."""
