"""The templates of the sentences of remarks; `rejection_text` fills them in."""

from __future__ import annotations

from stcalib_ros.core.model.rejection import RemarkCode

REMARKS = {
    RemarkCode.LEAST_CONSTRAINED_CAMERA: (
        "the least certain camera is {camera}: its rotation is known to {rotation_stddev_deg:.2g} "
        "degrees, its position to {position_stddev_percent:.2g} % of its distance from the people"
    ),
    RemarkCode.SHARE_MORE_VIEW: (
        "{camera} shares people with other cameras for {shared_s:.1f} s only, the others for "
        "{usual_s:.1f} s: let people walk where both it and {partner} see them (so far "
        "{common_s:.1f} s)"
    ),
    RemarkCode.MOVE_FASTER: "people who move faster in its view would determine its clock better",
    RemarkCode.LEAVE_THE_LINE: ("everybody walks along one line: let people also walk across it"),
    RemarkCode.RECORD_LONGER: (
        "a recording twice as long would reduce these uncertainties by about 30 %"
    ),
    RemarkCode.PEOPLE_OF_UNUSUAL_SIZE: (
        "by scale.distances, people are {ratio:.2f} times as large as adults: check the distances "
        "if they are not"
    ),
    RemarkCode.LENS_ASSUMED: (
        "the lenses of {cameras} were not known and are estimated; to start from, a view of "
        "{view_deg:.0f} degrees along the longer side of the image, a principal point in its "
        "middle and no distortion were assumed"
    ),
    RemarkCode.POSES_LEFT_OUT: (
        "{camera}: {n_left_out:.0f} of {n_poses:.0f} poses are left out, since all of their "
        "keypoints are at one place: check the pose estimator's output"
    ),
    RemarkCode.IDS_LINKED: (
        "{camera}: its track ids are no tracks ({continued:.0%} of its poses go on from the image "
        "before under the same id, {limit:.0%} are needed): people were linked from image to image "
        "by their keypoints, to {n_tracks:.0f} tracks; a tracker in its pose estimator does better"
    ),
    RemarkCode.SCORES_IN_PERCENT: (
        "{camera}: scores go up to {largest:.0f}, and are taken as percent: give them in 0..1"
    ),
    RemarkCode.KEYPOINTS_NOT_OBSERVED: (
        "{camera}: {n_points:.0f} keypoints with scores above min_score are exactly at ({x:g}, "
        "{y:g}), and are taken as not observed: let their scores be 0, or the keypoints NaN"
    ),
    RemarkCode.IMAGES_REPEATED: (
        "{camera}: {n_repeated:.0f} of {n_images:.0f} images are left out, since everybody in them "
        "is as in the image before, to the last bit: its stream freezes (for up to {longest_s:.1f} "
        "s), or repeats images; check its driver or decoder"
    ),
    RemarkCode.KEYPOINTS_SWAPPED: (
        "{camera}: x and y of its keypoints are swapped, and were exchanged back: people lie as "
        "they are; give x, to the right, before y"
    ),
    RemarkCode.LAYOUT_MISTAKEN: (
        "{camera}: its joints are taken as those of {detail}, since limbs have no proportions of "
        "people by the layout that it names: correct its layout"
    ),
    RemarkCode.POSES_RESCALED: (
        "{camera}: people would be {height_m:.0f} m tall by its 3D poses, which are taken as "
        "{detail}: convert them, or set metric to false"
    ),
    RemarkCode.POSES_NOT_METRIC: (
        "{camera}: people would be {height_m:.2g} m tall by its 3D poses, which are not used as "
        "metric: give them in metres, or set metric to false"
    ),
    RemarkCode.POSES_IN_OTHER_AXES: (
        "{camera}: its 3D poses do not project onto its keypoints (correlation {given:.2f}) and "
        "are not used: they are {detail} (correlation {best:.2f}); x right, y down, z forward are "
        "expected"
    ),
    RemarkCode.POSES_IN_OTHER_ORDER: (
        "{camera}: its 3D poses do not project onto its keypoints (correlation {given:.2f}) and "
        "are not used: their joints are in the order of {detail} (correlation {best:.2f}); that "
        "of its layout is expected"
    ),
    RemarkCode.POSES_WITH_SIDES_EXCHANGED: (
        "{camera}: its 3D poses do not project onto its keypoints (correlation {given:.2f}) and "
        "are not used: left and right are exchanged between both (correlation {best:.2f} if that "
        "is undone); check the names of its joints, and whether its image is mirrored"
    ),
    RemarkCode.POSES_DO_NOT_PROJECT: (
        "{camera}: its 3D poses do not project onto its keypoints (correlation {given:.2f}) and "
        "are not used; no other axes or order of joints fit: check that both are of the same "
        "person and image"
    ),
    RemarkCode.STAMPS_EVENED: (
        "the stamps of {camera} come in bunches of up to {bunch:.0f}, {within_ms:.2g} ms apart, "
        "although its images were taken {period_ms:.3g} ms apart, as the motion in them shows: "
        "even times are taken instead, and its time offset is that of its stamps on average; stamp "
        "images when they are taken, not when they arrive"
    ),
    RemarkCode.IMAGES_LEFT_OUT: (
        "{camera}: {n_left_out:.0f} of {n_images:.0f} images are left out: no other camera has "
        "images near their stamps, or others are far away in time; its clock may have been set "
        "in between"
    ),
    RemarkCode.CLOCKS_ALIGNED: (
        "{seconds:.3f} s were added to the stamps of {cameras}, {detail}, before offsets were "
        "searched within {range_s:g} s: a guess, which time offsets contain; --align gives another"
    ),
    RemarkCode.IMAGE_NOT_UPRIGHT: (
        "{camera}: people are turned by {turned_deg:.0f} degrees in its image: it hangs that way, "
        "or its image is turned, as its CameraInfo has to be, too; its pose is that of the image"
    ),
    RemarkCode.LENS_HELD: (
        "{camera}: its lens stays as it was given: people's motion does not determine its focal "
        "length to {limit_percent:.1f} %; let people come near and walk from side to side"
    ),
    RemarkCode.LENS_FAR_FROM_GIVEN: (
        "{camera}: its focal length is {times:.3f} times the one that was given, {deviations:.1f} "
        "standard deviations (lens.focal_stddev) away: check the image size and its data sheet, or "
        "set intrinsics to unknown"
    ),
    RemarkCode.LENS_DEVIATES: (
        "{camera}: its keypoints are those of another lens than its CameraInfo describes, to which "
        "`intrinsics: refine` would adapt it"
    ),
    RemarkCode.CLOCK_SKEW_NOT_OBSERVABLE: (
        "clocks are taken to run at one rate: {length_s:.0f} s are too short to measure a "
        "difference (clock skew)"
    ),
    RemarkCode.STAMPS_JUMP: (
        "{camera}: from {begin_s:.0f} to {end_s:.0f} s after its first image, its stamps are "
        "{jump_ms:.0f} ms off the times at which a recorder received them, against what they are "
        "else, though people's motion does not show it: check that nothing sets its clock"
    ),
    RemarkCode.VERIFIED_BY_LIMBS_ALONE: (
        "no 3D poses verify {cameras}: only the lengths of people's limbs do, which vary by "
        "{limb_variation_percent:.1f} %"
    ),
}
"""Templates of the sentences of remarks, by code."""
ADDITIONS = {
    "offset_stddev_ms": ", its clock to {offset_stddev_ms:.2g} ms",
    "scale": "; its focal length is {scale:.3f} times as long",
    "ratio": "; fx / fy is {ratio:.3f} times as large",
    "given_cx": (
        "; its principal point is at ({cx:.0f}, {cy:.0f}), not at ({given_cx:.0f}, {given_cy:.0f})"
    ),
    "bent": "; at the edge of what it sees, keypoints are {bent:+.1%} further from the axis",
    "enough_s": "; about {enough_s:.0f} s would be enough",
}
"""Ends of remarks that have a value of that name."""
