"""Why a calibration, or a camera of it, is rejected; and what is remarked on a good one: as data.

The sentences that people read are made from these records by `rejection_text`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum


class RejectionReason(str, Enum):
    """Code of a reason; the value is what files, messages and ``--json`` carry."""

    # Before anything is computed
    TOO_FEW_CAMERAS = "TOO_FEW_CAMERAS"
    NO_PERSONS = "NO_PERSONS"
    KEYPOINTS_NORMALISED = "KEYPOINTS_NORMALISED"
    LENS_UNKNOWN = "LENS_UNKNOWN"
    FOCAL_LENGTH_ABSURD = "FOCAL_LENGTH_ABSURD"
    PRINCIPAL_POINT_OFF_CENTRE = "PRINCIPAL_POINT_OFF_CENTRE"
    KEYPOINTS_OUTSIDE_IMAGE = "KEYPOINTS_OUTSIDE_IMAGE"
    KEYPOINTS_IN_CORNER = "KEYPOINTS_IN_CORNER"
    KEYPOINTS_COINCIDE = "KEYPOINTS_COINCIDE"
    SCORES_BELOW_LIMIT = "SCORES_BELOW_LIMIT"
    STREAM_FROZEN = "STREAM_FROZEN"
    IDS_ARE_NO_TRACKS = "IDS_ARE_NO_TRACKS"
    STAMPS_IN_BUNCHES = "STAMPS_IN_BUNCHES"
    STAMPS_TOO_CLOSE = "STAMPS_TOO_CLOSE"
    CLOCK_EPOCH_DIFFERS = "CLOCK_EPOCH_DIFFERS"
    NO_TEMPORAL_OVERLAP = "NO_TEMPORAL_OVERLAP"
    NO_MOTION = "NO_MOTION"
    # Cameras that are not connected
    NO_SHARED_MOTION = "NO_SHARED_MOTION"
    NO_PARALLAX = "NO_PARALLAX"
    NO_SHARED_OBSERVATIONS = "NO_SHARED_OBSERVATIONS"
    DISCONNECTED = "DISCONNECTED"
    UNMATCHED_OBSERVATIONS = "UNMATCHED_OBSERVATIONS"
    MIRRORED_VIEW = "MIRRORED_VIEW"
    # Faults of one camera that its residuals show
    IMAGE_RESIZED = "IMAGE_RESIZED"
    IMAGE_TURNED = "IMAGE_TURNED"
    DISTORTION_DISAGREES = "DISTORTION_DISAGREES"
    LENS_UNDETERMINED = "LENS_UNDETERMINED"
    LENS_NEEDS_PARALLAX = "LENS_NEEDS_PARALLAX"
    LENS_IMPLAUSIBLE = "LENS_IMPLAUSIBLE"
    CLOCK_NOT_STEADY = "CLOCK_NOT_STEADY"
    POSE_CHANGED = "POSE_CHANGED"
    PART_DISAGREES = "PART_DISAGREES"
    # Checks of a camera
    TOO_FEW_INLIERS = "TOO_FEW_INLIERS"
    TOO_MANY_OUTLIERS = "TOO_MANY_OUTLIERS"
    TOO_LITTLE_EXPLAINED = "TOO_LITTLE_EXPLAINED"
    TOO_LITTLE_SHARED_TIME = "TOO_LITTLE_SHARED_TIME"
    LOOKALIKES = "LOOKALIKES"
    BONES_DISAGREE = "BONES_DISAGREE"
    DISTANCES_DISAGREE = "DISTANCES_DISAGREE"
    LIMBS_DISAGREE = "LIMBS_DISAGREE"
    NOTHING_TO_VERIFY = "NOTHING_TO_VERIFY"
    ROTATION_UNCERTAIN = "ROTATION_UNCERTAIN"
    POSITION_UNCERTAIN = "POSITION_UNCERTAIN"
    OFFSET_AMBIGUOUS = "OFFSET_AMBIGUOUS"
    OFFSET_AMBIGUOUS_WITH_OUTLIERS = "OFFSET_AMBIGUOUS_WITH_OUTLIERS"
    OFFSET_UNCERTAIN = "OFFSET_UNCERTAIN"
    # The solution as a whole
    RIVAL_SOLUTION = "RIVAL_SOLUTION"
    LARGE_RESIDUALS = "LARGE_RESIDUALS"
    NOT_CONVERGED = "NOT_CONVERGED"
    INCONSISTENT_SCALE = "INCONSISTENT_SCALE"
    NO_VERTICAL = "NO_VERTICAL"
    # Motion that explains one of the above
    PERIODIC_MOTION = "PERIODIC_MOTION"
    IDENTICAL_MOTION = "IDENTICAL_MOTION"
    COLLINEAR_MOTION = "COLLINEAR_MOTION"
    # Runs that did not come to an end
    CANCELLED = "CANCELLED"
    INPUT_UNUSABLE = "INPUT_UNUSABLE"
    SOLVER_FAILED = "SOLVER_FAILED"
    # Files of versions with other codes
    UNSPECIFIED = "UNSPECIFIED"


@dataclass(frozen=True, slots=True)
class Rejection:
    """One reason, with the numbers that decided.

    Attributes
    ----------
    reason : RejectionReason
    cameras : tuple of str
        Cameras that it is about, a group of connected ones together; empty: the calibration.
    measured, limit : float
        Measured value and the limit that it violates, both in `unit`; NaN where the reason is
        not one number.
    unit : str
        ``rad``, ``s``, ``frames``, ``cameras``, ... ; empty for ratios and fractions.
    others : tuple of str
        Cameras, or sources of scale, that it was compared with.
    values : mapping of str to float
        Further numbers that the sentence names; units are in the names.
    detail : str
        Text of somebody else that is quoted, such as that of an error.
    """

    reason: RejectionReason
    cameras: tuple[str, ...] = ()
    measured: float = math.nan
    limit: float = math.nan
    unit: str = ""
    others: tuple[str, ...] = ()
    values: Mapping[str, float] = field(default_factory=dict, hash=False)
    detail: str = ""


class RemarkCode(str, Enum):
    """Code of a remark on a calibration that can be used, or on its input."""

    LEAST_CONSTRAINED_CAMERA = "LEAST_CONSTRAINED_CAMERA"
    SHARE_MORE_VIEW = "SHARE_MORE_VIEW"
    MOVE_FASTER = "MOVE_FASTER"
    LEAVE_THE_LINE = "LEAVE_THE_LINE"
    RECORD_LONGER = "RECORD_LONGER"
    CLOCK_SKEW_NOT_OBSERVABLE = "CLOCK_SKEW_NOT_OBSERVABLE"
    VERIFIED_BY_LIMBS_ALONE = "VERIFIED_BY_LIMBS_ALONE"
    PEOPLE_OF_UNUSUAL_SIZE = "PEOPLE_OF_UNUSUAL_SIZE"
    STAMPS_JUMP = "STAMPS_JUMP"
    LENS_ASSUMED = "LENS_ASSUMED"
    POSES_LEFT_OUT = "POSES_LEFT_OUT"
    IDS_LINKED = "IDS_LINKED"
    SCORES_IN_PERCENT = "SCORES_IN_PERCENT"
    KEYPOINTS_NOT_OBSERVED = "KEYPOINTS_NOT_OBSERVED"
    IMAGES_REPEATED = "IMAGES_REPEATED"
    KEYPOINTS_SWAPPED = "KEYPOINTS_SWAPPED"
    LAYOUT_MISTAKEN = "LAYOUT_MISTAKEN"
    POSES_RESCALED = "POSES_RESCALED"
    POSES_NOT_METRIC = "POSES_NOT_METRIC"
    POSES_IN_OTHER_AXES = "POSES_IN_OTHER_AXES"
    POSES_IN_OTHER_ORDER = "POSES_IN_OTHER_ORDER"
    POSES_WITH_SIDES_EXCHANGED = "POSES_WITH_SIDES_EXCHANGED"
    POSES_DO_NOT_PROJECT = "POSES_DO_NOT_PROJECT"
    STAMPS_EVENED = "STAMPS_EVENED"
    IMAGES_LEFT_OUT = "IMAGES_LEFT_OUT"
    IMAGE_NOT_UPRIGHT = "IMAGE_NOT_UPRIGHT"
    LENS_DEVIATES = "LENS_DEVIATES"
    LENS_HELD = "LENS_HELD"
    LENS_FAR_FROM_GIVEN = "LENS_FAR_FROM_GIVEN"


@dataclass(frozen=True, slots=True)
class Remark:
    """What could be better about a calibration that can be used.

    Attributes
    ----------
    code : RemarkCode
    cameras : tuple of str
    values : mapping of str to float
        Units are in the names.
    detail : str
        A word of the sentence that is no number, such as the name of a layout.
    """

    code: RemarkCode
    cameras: tuple[str, ...] = ()
    values: Mapping[str, float] = field(default_factory=dict, hash=False)
    detail: str = ""
