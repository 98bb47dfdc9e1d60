"""The sentences that people read, made from rejections and remarks: value, limit, next step."""

from __future__ import annotations

import math
from collections.abc import Sequence

from stcalib_ros.core.model.rejection import Rejection, RejectionReason, Remark
from stcalib_ros.core.model.remark_text import ADDITIONS, REMARKS

_R = RejectionReason
_SENTENCES = {
    _R.TOO_FEW_CAMERAS: (
        "{measured:.0f} of the cameras can be compared, {limit:.0f} are needed: record at least "
        "two that see the same people"
    ),
    _R.NO_PERSONS: (
        "no person with enough keypoints: check the pose estimator's output, and min_score"
    ),
    _R.KEYPOINTS_NORMALISED: (
        "its keypoints look normalised: they lie between {least:.2g} and {measured:.2g}, where "
        "pixels of an image of {width:.0f} x {height:.0f} are expected; multiply those of 0..1 by "
        "the image size (those of -1..1: add 1, and multiply by half of it)"
    ),
    _R.LENS_UNKNOWN: (
        "no lens is known, since K of CameraInfo is zero or there is none: set intrinsics to "
        "unknown (--intrinsics {detail}) to have it estimated from the people, or give "
        "field_of_view_deg of a data sheet; or calibrate the lens first"
    ),
    _R.FOCAL_LENGTH_ABSURD: (
        "its focal lengths of {fx:.4g} and {fy:.4g} px do not belong to an image of {width:.0f} x "
        "{height:.0f} px: it would show {fov_x:.3g} x {fov_y:.3g} degrees with pixels {ratio:.3g} "
        "times as wide as high; give K in pixels of this image"
    ),
    _R.PRINCIPAL_POINT_OFF_CENTRE: (
        "its principal point ({cx:.4g}, {cy:.4g}) is {measured:.0%} of the image size from the "
        "middle of an image of {width:.0f} x {height:.0f} px, {limit:.0%} are the limit: give cx "
        "and cy in this order and in pixels of this image, K and size of one mode and not binned "
        "twice, and the roi of an image that is a part of the sensor"
    ),
    _R.KEYPOINTS_OUTSIDE_IMAGE: (
        "{measured:.0%} of its poses are outside of the image of {width:.0f} x {height:.0f} px "
        "that its CameraInfo describes, {limit:.0%} are the limit; they reach to ({most_x:.0f}, "
        "{most_y:.0f}): they are those of a larger or turned image; bring keypoints and CameraInfo "
        "to one image"
    ),
    _R.KEYPOINTS_IN_CORNER: (
        "all its keypoints are within ({most_x:.0f}, {most_y:.0f}) of the top left corner of an "
        "image of {width:.0f} x {height:.0f} px, {measured:.0%} of its size: they look like those "
        "of a smaller image; bring keypoints and CameraInfo to one image, or let people walk "
        "through more of its view"
    ),
    _R.KEYPOINTS_COINCIDE: (
        "all keypoints of each person are at one place, within {measured:.2g} px: check the pose "
        "estimator's output"
    ),
    _R.SCORES_BELOW_LIMIT: (
        "no joint has a score above {limit:g} (min_score), the largest is {measured:.2g}: scores "
        "of 0..1 are expected; are these logits? Scale them, or lower min_score"
    ),
    _R.STREAM_FROZEN: (
        "its picture stands still: in {measured:.0%} of its images everybody is as in the image "
        "before, to the last bit, {limit:.0%} are the limit; check its driver or decoder"
    ),
    _R.IDS_ARE_NO_TRACKS: (
        "its track ids are no tracks, and its poses cannot be linked by their places: "
        "{measured:.0%} of them go on from the image before, {limit:.0%} are needed; switch "
        "tracking on in its pose estimator, or record more images a second"
    ),
    _R.STAMPS_IN_BUNCHES: (
        "its stamps come in bunches of up to {bunch:.0f}, {within_ms:.2g} ms apart where images "
        "are {period_ms:.3g} ms apart, and images are lost: {measured:.0%} of its intervals are "
        "too short, {limit:.0%} are the limit; stamp images when they are taken, not when they "
        "arrive from a buffer"
    ),
    _R.STAMPS_TOO_CLOSE: (
        "its images are {measured:.2g} s apart by their stamps, no camera takes them closer than "
        "{limit:.2g} s: stamp them when they are taken, in seconds"
    ),
    _R.CLOCK_EPOCH_DIFFERS: (
        "its clock does not overlap with the others: {begin_s:.1f}..{end_s:.1f} s against "
        "{others_begin_s:.1f}..{others_end_s:.1f} s, a gap of {measured:.1f} s where "
        "{limit:g} s can be bridged; set its clock, say how far it is off (--align), or widen "
        "offset_range_s"
    ),
    _R.NO_TEMPORAL_OVERLAP: (
        "at most {measured:.3g} images in common with the others, {limit:.0f} are needed: record "
        "longer"
    ),
    _R.NO_MOTION: (
        "nobody moves: keypoints move by {measured:.1%} of a body's height at most, {limit:.0%} "
        "are needed; have people walk through the scene"
    ),
    _R.NO_SHARED_MOTION: (
        "no two cameras see the same person move: check that their views overlap, that their "
        "clocks agree within {limit:g} s (offset_range_s), and record longer"
    ),
    _R.NO_PARALLAX: (
        "the cameras stand at one place: they are {measured:.1%} of the distance of the people "
        "apart at most, {limit:.0%} are needed; only their rotations could be found: move one "
        "aside, by a tenth of that distance and more"
    ),
    _R.NO_SHARED_OBSERVATIONS: (
        "people could not be matched across views: too few of their keypoints fit any two "
        "cameras; check the intrinsics, let views overlap more, and record longer"
    ),
    _R.DISCONNECTED: (
        "shares nobody's motion with {others}: move it to where the others see the same people, "
        "or calibrate the groups one by one"
    ),
    _R.UNMATCHED_OBSERVATIONS: (
        "hardly anything that it sees matches what is seen by {others}: check its intrinsics, and "
        "let people stay in view for longer"
    ),
    _R.IMAGE_RESIZED: (
        "its keypoints look like those of an image {scale_x:.2f} times as wide and {scale_y:.2f} "
        "times as high as in its CameraInfo ({width:.0f} x {height:.0f}), the corner of which is "
        "at ({corner_x:.0f}, {corner_y:.0f}): the pose estimator gets a resized, padded or cropped "
        "image, or K is that of another mode; bring keypoints and CameraInfo to one image, or set "
        "intrinsics to refine or unknown"
    ),
    _R.IMAGE_TURNED: (
        "its keypoints look like those of an image turned by a quarter or by half, or of a lens "
        "with cx and cy exchanged: the principal point is at ({cx:.0f}, {cy:.0f}), where its "
        "CameraInfo says ({given_cx:.0f}, {given_cy:.0f}); bring keypoints and CameraInfo to one "
        "image"
    ),
    _R.DISTORTION_DISAGREES: (
        "its keypoints are bent by {measured:.0%} at the edge of the image when its lens is taken "
        "for that of its CameraInfo, {limit:.0%} are the limit: check D, and whether the keypoints "
        "are those of the raw or of the rectified image (rectified), or set intrinsics to refine"
    ),
    _R.LENS_UNDETERMINED: (
        "people determine its focal length to {measured:.1%}, {limit:.1%} are needed: let them "
        "come near and walk from side to side, say which cameras have one lens (lens_group), or "
        "give the field of view of its data sheet (field_of_view_deg)"
    ),
    _R.LENS_NEEDS_PARALLAX: (
        "its focal length cannot be separated from people's distance: the cameras see them from "
        "nearly one direction: positions are {measured:.0f} times as uncertain along the view as "
        "across it, {limit:.1f} are the limit where lenses are unknown; move a camera aside, or "
        "give the field of view of its data sheet (field_of_view_deg)"
    ),
    _R.LENS_IMPLAUSIBLE: (
        "its focal length came out as {focal_px:.0f} px, a view of {measured:.0f} degrees where "
        "{limit:.0f} are the limit: people's motion does not determine it, or its image is cropped "
        "or stretched; give its intrinsics, or let people come near and walk from side to side"
    ),
    _R.CLOCK_NOT_STEADY: (
        "its clock is not steady: from {begin_s:.1f} to {end_s:.1f} s after its first image, its "
        "stamps are {measured_ms:.0f} ms off the rest of them, {limit_ms:.0f} are the limit"
        "{and_received}{or_others}; a clock that is set while it records does that, and so do lost "
        "images that are numbered as if none were lost: give the times of acquisition, or use a "
        "part of the recording"
    ),
    _R.POSE_CHANGED: (
        "it has moved: from {begin_s:.1f} to {end_s:.1f} s after its first image, it is turned "
        "{measured_deg:.1f} degrees from where it is otherwise, {limit_deg:.1f} are the limit"
        "{or_others}; fasten it, or use the part of the recording before or after"
    ),
    _R.PART_DISAGREES: (
        "from {begin_s:.1f} to {end_s:.1f} s after its first image, what it sees is {measured:.0f} "
        "px off what the others see of the same people, {limit:.0f} are the limit, though it fits "
        "otherwise{or_others}: it was moved, or its clock was set by more than can be followed; "
        "use the part of the recording before or after"
    ),
    _R.MIRRORED_VIEW: (
        "its image is mirrored: with {detail} exchanged, {measured:.0%} of its keypoints fit the "
        "people whom the others see, and hardly any of them as they are; switch off mirroring "
        "(selfie view) in its driver, or check the order of the coordinates"
    ),
    _R.TOO_FEW_INLIERS: (
        "only {measured:.0f} of its keypoints fit, {limit:.0f} are needed: have people walk where "
        "it and the others see them"
    ),
    _R.TOO_MANY_OUTLIERS: (
        "only {measured:.0%} of its keypoints fit, {limit:.0%} are needed: check its intrinsics, "
        "and that its keypoints belong to the image that CameraInfo describes"
    ),
    _R.TOO_LITTLE_EXPLAINED: (
        "only {measured:.0%} of all that it sees agrees with the others, {limit:.0%} are needed: "
        "it may show other people; let the same people walk where it and the others see them, and "
        "record longer"
    ),
    _R.TOO_LITTLE_SHARED_TIME: (
        "it shares only {measured:.1f} s of somebody's motion with the others, {limit:.1f} s are "
        "needed where only {explained_fraction:.0%} of all that it sees agrees with them: that may "
        "be chance; let people stay in view of two cameras for longer"
    ),
    _R.LOOKALIKES: (
        "everybody whom it sees moves like somebody else at another place, and it fits there as "
        "well: have people move differently from each other"
    ),
    _R.BONES_DISAGREE: (
        "the bones of its 3D poses disagree with its rotation by {measured_deg:.0f} degrees, "
        "{limit_deg:.0f} are the limit: persons may be mixed up; record a longer clip with people "
        "who move differently"
    ),
    _R.DISTANCES_DISAGREE: (
        "people would be {measured:.1f} times as far from it as their size says, between "
        "{least:.2f} and {limit:.1f} is the limit: persons may be mixed up; record a longer clip "
        "with people who move differently"
    ),
    _R.LIMBS_DISAGREE: (
        "limbs of people would vary in length by {measured:.0%}, {limit:.0%} are the limit: the "
        "keypoints fit, but not to bodies; let people walk across more of its view, and where "
        "other cameras see them from the side"
    ),
    _R.NOTHING_TO_VERIFY: (
        "no limb of anybody is seen by it and another camera for long enough to verify its pose: "
        "let people be in its view as a whole, and for longer"
    ),
    _R.ROTATION_UNCERTAIN: (
        "its rotation is uncertain by {measured_deg:.1f} degrees, {limit_deg:.1f} are the limit: "
        "it shares too little with the others; let people walk across more of its view"
    ),
    _R.POSITION_UNCERTAIN: (
        "its position is uncertain by {measured:.0%} of its distance from the people, {limit:.0%} "
        "are the limit: let them walk across more of its view"
    ),
    _R.OFFSET_AMBIGUOUS: (
        "its time offset is ambiguous: one that differs by {alternative_s:.2f} s fits as well "
        "(error {measured:.2f} times as large, {limit:.2f} needed); people have to move more, and "
        "not in the same rhythm all the time"
    ),
    _R.OFFSET_AMBIGUOUS_WITH_OUTLIERS: (
        "only {inlier_fraction:.0%} of its keypoints fit, and with another time offset all of them "
        "fit as well (error {measured:.2f} times as large, {limit:.2f} needed): people have to "
        "move more, and not in the same rhythm all the time"
    ),
    _R.OFFSET_UNCERTAIN: (
        "its time offset is uncertain by {measured:.1f} frames, {limit:.1f} are the limit: people "
        "have to move faster, or the clip has to be longer"
    ),
    _R.RIVAL_SOLUTION: (
        "two solutions fit about equally well; between them, poses differ, and time offsets by up "
        "to {frames:.1f} frames ({measured:.2f} s): motion is periodic, people move "
        "identically, or the true offset is outside of offset_range_s (+-{offset_range_s:g} s); "
        "set that to what is possible, or record more varied motion"
    ),
    _R.LARGE_RESIDUALS: (
        "reprojection errors are {measured:.1f} px (root mean square), {limit:.1f} are the limit "
        "where half of them are below {median_px:.1f} px: in a part of the recording something "
        "does not fit; check for clocks that are set and cameras that move while they record"
    ),
    _R.NOT_CONVERGED: (
        "the adjustment has not converged, {measured:.0f} cameras still moved in the last "
        "iteration: raise bundle.rounds"
    ),
    _R.INCONSISTENT_SCALE: "what was given for the scale is inconsistent: {detail}",
    _R.NO_VERTICAL: "world_frame: {detail}; leave it empty, or have people walk",
    _R.PERIODIC_MOTION: (
        "everybody's motion repeats itself with a period of {shortest_s:.2f} s (the longest is "
        "{longest_s:.2f} s), and time offsets that are wrong by that look right: let people turn, "
        "stop and start"
    ),
    _R.IDENTICAL_MOTION: (
        "persons {person_a:.0f} and {person_b:.0f} move identically: have people move differently "
        "from each other"
    ),
    _R.COLLINEAR_MOTION: "everybody stays on one line: let people walk across it, too",
    _R.CANCELLED: "{detail}",
    _R.INPUT_UNUSABLE: "{detail}",
    _R.SOLVER_FAILED: "{detail}",
    _R.UNSPECIFIED: "{detail}",
}


class _Values(dict[str, object]):
    """Values of a template; a number that a file of another version lacks is NaN."""

    def __missing__(self, _: str) -> float:
        return math.nan


def sentence(rejection: Rejection) -> str:
    """Return the sentence of a rejection, without the names of the cameras that it is about."""
    others = ", ".join(rejection.others)
    return _SENTENCES[rejection.reason].format_map(
        _Values(
            rejection.values,
            measured=rejection.measured,
            limit=rejection.limit,
            measured_deg=math.degrees(rejection.measured),
            limit_deg=math.degrees(rejection.limit),
            measured_ms=1e3 * rejection.measured,
            limit_ms=1e3 * rejection.limit,
            and_received=_as_received(rejection),
            or_others=f" (or it is {others})" if others else "",
            others=others,
            detail=rejection.detail,
        )
    )


def _as_received(rejection: Rejection) -> str:
    """What times of receipt say to it, where they say something."""
    off_s = rejection.values.get("received_s", math.nan)
    return "" if math.isnan(off_s) else f", and {1e3 * off_s:.0f} ms off when they were received"


def labelled(rejection: Rejection) -> str:
    """Return the sentence of a rejection after the names of the cameras that it is about."""
    return ": ".join(filter(None, [", ".join(rejection.cameras), sentence(rejection)]))


def camera_sentence(name: str, rejection: Rejection) -> str:
    """Return why one camera is left out; a group that it belongs to is named."""
    group = [other for other in rejection.cameras if other != name]
    tail = f"; it forms a separate group with {', '.join(group)}" if group else ""
    return sentence(rejection) + tail


def remark_sentence(remark: Remark) -> str:
    """Return the sentence of a remark."""
    camera, partner = (*remark.cameras, "", "")[:2]
    ends = [end for name, end in ADDITIONS.items() if name in remark.values]
    text = "".join([REMARKS[remark.code], *ends])
    names = {
        "camera": camera,
        "partner": partner,
        "cameras": ", ".join(remark.cameras),
        "detail": remark.detail,
    }
    return text.format_map(_Values(remark.values, **names))


def whole_sentences(remarks: Sequence[Remark], rejections: Sequence[Rejection]) -> list[str]:
    """Return remarks and rejections as sentences with capital and full stop."""
    texts = [*map(remark_sentence, remarks), *map(labelled, rejections)]
    return [f"{text[:1].upper()}{text[1:]}." for text in texts]
