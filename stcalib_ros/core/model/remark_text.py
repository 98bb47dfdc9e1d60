"""The templates of the sentences of remarks; `rejection_text` fills them in."""

from __future__ import annotations

from stcalib_ros.core.model.rejection import RemarkCode

REMARKS = {
    RemarkCode.LEAST_CONSTRAINED_CAMERA: (
        "the least certain camera is {camera}: its rotation is known to {rotation_stddev_deg:.2g} "
        "degrees about any axis, its position to {position_stddev_percent:.2g} % of the distance "
        "to the people in any direction"
    ),
    RemarkCode.SHARE_MORE_VIEW: (
        "{camera} and the other cameras see people together for {shared_s:.1f} s only, where "
        "{usual_s:.1f} s are usual: let people walk where both {camera} and {partner} see them "
        "({common_s:.1f} s so far)"
    ),
    RemarkCode.MOVE_FASTER: (
        "if people moved faster in view of {camera}, its clock would be known better"
    ),
    RemarkCode.LEAVE_THE_LINE: (
        "everybody stays on one line: if people also walked across it, positions would be known "
        "better"
    ),
    RemarkCode.RECORD_LONGER: (
        "a recording twice as long would reduce these uncertainties by about 30 %"
    ),
    RemarkCode.PEOPLE_OF_UNUSUAL_SIZE: (
        "by scale.distances, people are {ratio:.2f} times as tall as adults: check these "
        "distances, unless people are that tall"
    ),
    RemarkCode.LENS_ASSUMED: (
        "the lenses of {cameras} were not known and are estimated, starting from a field of view "
        "of {view_deg:.0f} degrees along the longer side of the image, a principal point in its "
        "middle and no distortion"
    ),
    RemarkCode.POSES_LEFT_OUT: (
        "{n_left_out:.0f} of {n_poses:.0f} poses are ignored, since all of their keypoints are at "
        "the same place: check the output of the pose estimator"
    ),
    RemarkCode.IDS_LINKED: (
        "track ids do not follow people (only {continued:.0%} of the poses continue one from the "
        "image before with the same id, at least {limit:.0%} needed); people were followed by "
        "their keypoints instead, which gave {n_tracks:.0f} tracks: a tracker in the pose "
        "estimator works better"
    ),
    RemarkCode.SCORES_IN_PERCENT: (
        "scores go up to {largest:.0f} and are taken as percent: give them from 0 to 1"
    ),
    RemarkCode.KEYPOINTS_NOT_OBSERVED: (
        "{n_points:.0f} keypoints with scores above min_score are exactly at ({x:g}, {y:g}) and "
        "are taken as not detected: set their scores to 0, or the keypoints to NaN"
    ),
    RemarkCode.IMAGES_REPEATED: (
        "{n_repeated:.0f} of {n_images:.0f} images are ignored, since all keypoints in them are "
        "exactly those of the image before: the stream freezes (for up to {longest_s:.1f} s) or "
        "repeats images; check the driver or decoder"
    ),
    RemarkCode.KEYPOINTS_SWAPPED: (
        "x and y of the keypoints are exchanged, so that people would be lying down, and were "
        "swapped back: give x, to the right, before y"
    ),
    RemarkCode.LAYOUT_MISTAKEN: (
        "limbs do not have human proportions with the given layout, so the joints are taken as "
        "those of {detail}: correct the layout"
    ),
    RemarkCode.POSES_RESCALED: (
        "by the 3D poses, people would be {height_m:.0f} m tall, so the poses are taken as "
        "{detail}: convert them to metres, or set metric to false"
    ),
    RemarkCode.POSES_NOT_METRIC: (
        "by the 3D poses, people would be {height_m:.2g} m tall, so their size is not used: give "
        "the poses in metres, or set metric to false"
    ),
    RemarkCode.POSES_IN_OTHER_AXES: (
        "the 3D poses do not match the keypoints (correlation {given:.2f}) and are not used; they "
        "would match if their axes were {detail} (correlation {best:.2f}): x right, y down, z "
        "forward is expected"
    ),
    RemarkCode.POSES_IN_OTHER_ORDER: (
        "the 3D poses do not match the keypoints (correlation {given:.2f}) and are not used; they "
        "would match if their joints were in the order of {detail} (correlation {best:.2f}): the "
        "order of the given layout is expected"
    ),
    RemarkCode.POSES_WITH_SIDES_EXCHANGED: (
        "the 3D poses do not match the keypoints (correlation {given:.2f}) and are not used; they "
        "would match with left and right exchanged (correlation {best:.2f}): check the names of "
        "the joints, and whether the image is mirrored"
    ),
    RemarkCode.POSES_DO_NOT_PROJECT: (
        "the 3D poses do not match the keypoints (correlation {given:.2f}) and are not used; "
        "neither do they with other axes or another order of joints: check that both are of the "
        "same person and image"
    ),
    RemarkCode.STAMPS_EVENED: (
        "timestamps come in bunches of up to {bunch:.0f}, {within_ms:.2g} ms apart, although "
        "people's motion shows that images were taken every {period_ms:.3g} ms: evenly spaced "
        "times are used instead, and the time offset is that of the timestamps on average; stamp "
        "images when they are taken, not when they arrive"
    ),
    RemarkCode.IMAGES_LEFT_OUT: (
        "{n_left_out:.0f} of {n_images:.0f} images are ignored, since they are far in time from "
        "the rest or from all images of the other cameras: the clock may have been set in between"
    ),
    RemarkCode.CLOCKS_ALIGNED: (
        "{seconds:.3f} s were added to the timestamps of {cameras}, {detail}, before time offsets "
        "were searched within {range_s:g} s: this guess is part of the time offsets in the result; "
        "--align gives another"
    ),
    RemarkCode.IMAGE_NOT_UPRIGHT: (
        "people appear turned by {turned_deg:.0f} degrees: either the camera is mounted that way, "
        "or its image is rotated, and CameraInfo has to be rotated, too; the pose of the camera is "
        "that of the image as it is"
    ),
    RemarkCode.LENS_HELD: (
        "the lens is kept as given, since people's motion does not determine its focal length to "
        "{limit_percent:.1f} %: let people come near and walk from side to side"
    ),
    RemarkCode.LENS_FAR_FROM_GIVEN: (
        "the estimated focal length is {times:.3f} times the given one, {deviations:.1f} standard "
        "deviations (lens.focal_stddev) away: check the image size and the data sheet, or set "
        "intrinsics to unknown"
    ),
    RemarkCode.LENS_DEVIATES: (
        "the keypoints do not quite fit the lens in CameraInfo, which `intrinsics: refine` would "
        "correct"
    ),
    RemarkCode.CLOCK_SKEW_NOT_OBSERVABLE: (
        "clocks are taken to run at one rate: {length_s:.0f} s are too short to measure a "
        "difference (clock skew)"
    ),
    RemarkCode.STAMPS_JUMP: (
        "from {begin_s:.0f} to {end_s:.0f} s after the first image, timestamps are {jump_ms:.0f} "
        "ms off compared with the times at which the recorder received the images, although "
        "people's motion does not show it: check that nothing sets the clock"
    ),
    RemarkCode.VERIFIED_BY_LIMBS_ALONE: (
        "without 3D poses, only the lengths of people's limbs confirm {cameras}; they vary by "
        "{limb_variation_percent:.1f} %"
    ),
}
"""Templates of the sentences of remarks, by code.

Where one does not say which cameras it is about, their names are put before it.
"""
ADDITIONS = {
    RemarkCode.LEAST_CONSTRAINED_CAMERA: {
        "offset_stddev_ms": ", its clock to {offset_stddev_ms:.2g} ms",
    },
    RemarkCode.LENS_DEVIATES: {
        "scale": "; its focal length appears to be {scale:.3f} times as long",
        "ratio": "; fx / fy appears to be {ratio:.3f} times as large",
        "given_cx": (
            "; its principal point appears to be at ({cx:.0f}, {cy:.0f}), not at ({given_cx:.0f}, "
            "{given_cy:.0f})"
        ),
        "bent": (
            "; near the edge of the image, the distance of keypoints from the optical axis is off "
            "by {bent:+.1%}"
        ),
    },
    RemarkCode.CLOCK_SKEW_NOT_OBSERVABLE: {
        "enough_s": "; about {enough_s:.0f} s would be enough",
    },
}
"""Ends of remarks that have a value of that name, by code."""
