"""The sentences that people read, made from rejections and remarks: value, limit, next step."""

from __future__ import annotations

import math
from collections.abc import Sequence

from stcalib_ros.core.model.gathered_text import after_names, as_sentence, gathered, uncertain
from stcalib_ros.core.model.rejection import Rejection, RejectionReason, Remark
from stcalib_ros.core.model.remark_text import ADDITIONS, REMARKS

_R = RejectionReason
_SENTENCES = {
    _R.TOO_FEW_CAMERAS: (
        "too few cameras can be used ({measured:.0f}, at least {limit:.0f} needed): record two or "
        "more that see the same people"
    ),
    _R.NO_PERSONS: (
        "nobody was detected with enough keypoints: check the output of the pose estimator, and "
        "the option min_score"
    ),
    _R.KEYPOINTS_NORMALISED: (
        "the keypoints look like fractions of the image, not like pixels: they range from "
        "{least:.2g} to {measured:.2g}, but the image has {width:.0f} x {height:.0f} px; multiply "
        "them by the image size (if they range from -1 to 1: add 1, then multiply by half the "
        "image size)"
    ),
    _R.LENS_UNKNOWN: (
        "the lens is unknown (K in CameraInfo is zero, or there is no CameraInfo): set intrinsics "
        "to unknown (--intrinsics {detail}) to have it estimated from the people, give the field "
        "of view from its data sheet (field_of_view_deg), or calibrate the lens first"
    ),
    _R.FOCAL_LENGTH_ABSURD: (
        "focal lengths of {fx:.4g} and {fy:.4g} px are impossible for an image of {width:.0f} x "
        "{height:.0f} px: it would show {fov_x:.3g} x {fov_y:.3g} degrees, with pixels {ratio:.3g} "
        "times as wide as high; give K in pixels of this image"
    ),
    _R.PRINCIPAL_POINT_OFF_CENTRE: (
        "the principal point ({cx:.4g}, {cy:.4g}) is {measured:.0%} of the image size away from "
        "the middle of the {width:.0f} x {height:.0f} px image (limit {limit:.0%}): check that cx "
        "and cy are in this order and in pixels of this image, that K and the image size are those "
        "of one video mode and not binned twice, and that roi is set if the image is a part of the "
        "sensor"
    ),
    _R.KEYPOINTS_OUTSIDE_IMAGE: (
        "{measured:.0%} of the poses are outside the {width:.0f} x {height:.0f} px image that "
        "CameraInfo describes (limit {limit:.0%}), and reach ({most_x:.0f}, {most_y:.0f}): they "
        "seem to come from a larger or rotated image; make CameraInfo describe the image in which "
        "keypoints are detected"
    ),
    _R.KEYPOINTS_IN_CORNER: (
        "all keypoints are between the top left corner and ({most_x:.0f}, {most_y:.0f}), in "
        "{measured:.0%} of the {width:.0f} x {height:.0f} px image: they seem to come from a "
        "smaller image; make CameraInfo describe the image in which keypoints are detected, or let "
        "people walk through more of the view"
    ),
    _R.KEYPOINTS_COINCIDE: (
        "all keypoints of each person are at the same place (within {measured:.2g} px): check the "
        "output of the pose estimator"
    ),
    _R.SCORES_BELOW_LIMIT: (
        "no joint has a score above {limit:g} (min_score), the highest is {measured:.2g}: scores "
        "from 0 to 1 are expected; scale them (they may be logits), or lower min_score"
    ),
    _R.STREAM_FROZEN: (
        "the image is frozen: in {measured:.0%} of the images, all keypoints are exactly those of "
        "the image before (limit {limit:.0%}); check the driver or decoder"
    ),
    _R.IDS_ARE_NO_TRACKS: (
        "track ids do not follow people, and people cannot be followed by their positions either: "
        "only {measured:.0%} of the poses continue one from the image before (at least {limit:.0%} "
        "needed); switch on tracking in the pose estimator, or record more images per second"
    ),
    _R.STAMPS_IN_BUNCHES: (
        "timestamps come in bunches of up to {bunch:.0f}, {within_ms:.2g} ms apart instead of "
        "{period_ms:.3g} ms, and images are missing: {measured:.0%} of the intervals are too short "
        "(limit {limit:.0%}); stamp images when they are taken, not when they arrive from a buffer"
    ),
    _R.STAMPS_TOO_CLOSE: (
        "timestamps are {measured:.2g} s apart, and no camera takes images that fast (at least "
        "{limit:.2g} s expected): stamp images with the time at which they are taken, in seconds"
    ),
    _R.CLOCK_EPOCH_DIFFERS: (
        "by the timestamps, this camera recorded at another time than the others "
        "({begin_s:.1f}..{end_s:.1f} s, the others {others_begin_s:.1f}..{others_end_s:.1f} s): "
        "the gap is {measured:.1f} s, and at most {limit:g} s are searched; set the clock, say how "
        "far it is off (--align), or raise offset_range_s"
    ),
    _R.NO_TEMPORAL_OVERLAP: (
        "at most {measured:.3g} images were taken at the same time as images of another camera (at "
        "least {limit:.0f} needed): record longer"
    ),
    _R.NO_MOTION: (
        "nobody moves: keypoints move by at most {measured:.1%} of a person's height (at least "
        "{limit:.0%} needed); have people walk through the scene"
    ),
    _R.NO_SHARED_MOTION: (
        "no two cameras see the same person move: check that their views overlap and that their "
        "clocks agree within {limit:g} s (offset_range_s), and record longer"
    ),
    _R.NO_PARALLAX: (
        "the cameras are too close together: at most {measured:.1%} of their distance to the "
        "people (at least {limit:.0%} needed), so that only their rotations can be found; move one "
        "aside, by a tenth of the distance to the people or more"
    ),
    _R.NO_SHARED_OBSERVATIONS: (
        "people could not be matched across views, since too few of their keypoints fit any two "
        "cameras: check the intrinsics, let views overlap more, and record longer"
    ),
    _R.DISCONNECTED: (
        "no person's motion was found both here and in {others}: make the views overlap where "
        "people walk, or calibrate the groups of cameras separately"
    ),
    _R.UNMATCHED_OBSERVATIONS: (
        "hardly any keypoints match those of {others}: check the intrinsics, and let people stay "
        "in view for longer"
    ),
    _R.IMAGE_RESIZED: (
        "the keypoints seem to come from an image {scale_x:.2f} times as wide and {scale_y:.2f} "
        "times as high as CameraInfo says ({width:.0f} x {height:.0f}), with its corner at "
        "({corner_x:.0f}, {corner_y:.0f}): the pose estimator may get a resized, padded or cropped "
        "image, or K may be that of another video mode; make CameraInfo describe the image in "
        "which keypoints are detected, or set intrinsics to refine or unknown"
    ),
    _R.IMAGE_TURNED: (
        "the keypoints seem to come from an image rotated by 90 or 180 degrees, or cx and cy are "
        "exchanged: the principal point appears to be at ({cx:.0f}, {cy:.0f}), but CameraInfo says "
        "({given_cx:.0f}, {given_cy:.0f}); make CameraInfo describe the image in which keypoints "
        "are detected"
    ),
    _R.DISTORTION_DISAGREES: (
        "the distortion in CameraInfo does not fit the keypoints: near the edge of the image, "
        "their distance from the optical axis is off by {measured:.0%} (limit {limit:.0%}); check "
        "D, and whether keypoints are those of the raw or the rectified image (rectified), or set "
        "intrinsics to refine"
    ),
    _R.LENS_UNDETERMINED: (
        "this recording determines the focal length only to {measured:.1%} ({limit:.1%} or better "
        "needed): let people come near and walk from side to side, say which cameras have the same "
        "lens (lens_group), or give the field of view from the data sheet (field_of_view_deg)"
    ),
    _R.LENS_NEEDS_PARALLAX: (
        "a longer lens and people further away would look the same, since all cameras see the "
        "people from nearly one direction: positions are {measured:.0f} times as uncertain along "
        "the view as across it (limit {limit:.1f} for unknown lenses); move a camera aside, or "
        "give the field of view from the data sheet (field_of_view_deg)"
    ),
    _R.LENS_IMPLAUSIBLE: (
        "the focal length was estimated as {focal_px:.0f} px, a field of view of {measured:.0f} "
        "degrees (limit {limit:.0f}): people's motion does not determine it, or the image is "
        "cropped or stretched; give the intrinsics, or let people come near and walk from side to "
        "side"
    ),
    _R.CLOCK_NOT_STEADY: (
        "the clock is not steady: from {begin_s:.1f} to {end_s:.1f} s after the first image, "
        "timestamps are {measured_ms:.0f} ms off compared with the rest (limit {limit_ms:.0f} "
        "ms){and_received}{or_others}; the clock may have been set while recording, or images were "
        "lost and numbered as if none were: stamp images when they are taken, or use another part "
        "of the recording"
    ),
    _R.POSE_CHANGED: (
        "the camera has moved: from {begin_s:.1f} to {end_s:.1f} s after the first image, it is "
        "turned by {measured_deg:.1f} degrees compared with the rest (limit "
        "{limit_deg:.1f}){or_others}; fasten it, or use only the part of the recording before or "
        "after"
    ),
    _R.PART_DISAGREES: (
        "from {begin_s:.1f} to {end_s:.1f} s after the first image, keypoints are {measured:.0f} "
        "px from where the other cameras see the same people (limit {limit:.0f}), although they "
        "fit in the rest of the recording{or_others}: the camera was moved, or its clock was set "
        "by too much to follow; use only the part of the recording before or after"
    ),
    _R.MIRRORED_VIEW: (
        "the image is mirrored: with {detail} exchanged, {measured:.0%} of the keypoints fit what "
        "the other cameras see, and hardly any of them as they are; switch off mirroring (selfie "
        "view) in the driver, or check the order of the coordinates"
    ),
    _R.TOO_FEW_INLIERS: (
        "only {measured:.0f} keypoints fit the other cameras (at least {limit:.0f} needed): have "
        "people walk where this camera and others see them"
    ),
    _R.TOO_MANY_OUTLIERS: (
        "only {measured:.0%} of the keypoints fit the other cameras (at least {limit:.0%} needed): "
        "check the intrinsics, and that CameraInfo describes the image in which keypoints are "
        "detected"
    ),
    _R.TOO_LITTLE_EXPLAINED: (
        "only {measured:.0%} of all that this camera sees agrees with the others (at least "
        "{limit:.0%} needed): it may see other people; let the same people walk where this camera "
        "and others see them, and record longer"
    ),
    _R.TOO_LITTLE_SHARED_TIME: (
        "only {measured:.1f} s of people's motion agree with the other cameras (at least "
        "{limit:.1f} s needed, as only {explained_fraction:.0%} of all that this camera sees fits "
        "them): that may be coincidence; let people stay in view of two cameras for longer"
    ),
    _R.LOOKALIKES: (
        "everybody in view moves like somebody else, so that the camera would fit at another place "
        "as well: have people move differently from each other"
    ),
    _R.BONES_DISAGREE: (
        "the 3D poses contradict the camera's rotation by {measured_deg:.0f} degrees (limit "
        "{limit_deg:.0f}): people may be mixed up; record longer, with people who move differently "
        "from each other"
    ),
    _R.DISTANCES_DISAGREE: (
        "people would be {measured:.1f} times as far away as their size in the image says (limits "
        "{least:.2f} and {limit:.1f}): people may be mixed up; record longer, with people who move "
        "differently from each other"
    ),
    _R.LIMBS_DISAGREE: (
        "people's limbs would vary in length by {measured:.0%} (limit {limit:.0%}): the keypoints "
        "fit, but not to human bodies; let people walk across more of the view, and where other "
        "cameras see them from the side"
    ),
    _R.NOTHING_TO_VERIFY: (
        "no arm or leg is seen by this camera and another one for long enough to check the result: "
        "keep people in view from head to feet, and for longer"
    ),
    _R.ROTATION_UNCERTAIN: (
        "the rotation is {uncertain_by_degrees}, since the camera sees too little of what the "
        "others see: let people walk across more of the view"
    ),
    _R.POSITION_UNCERTAIN: (
        "the position is {uncertain_by_share}: let people walk across more of the view"
    ),
    _R.OFFSET_AMBIGUOUS: (
        "the time offset is ambiguous: one that differs by {alternative_s:.2f} s fits nearly as "
        "well (its error is {measured:.2f} times as large, at least {limit:.2f} times needed); "
        "have people move more, and not always in the same rhythm"
    ),
    _R.OFFSET_AMBIGUOUS_WITH_OUTLIERS: (
        "only {inlier_fraction:.0%} of the keypoints fit, and all of them fit nearly as well with "
        "another time offset (its error is {measured:.2f} times as large, at least {limit:.2f} "
        "times needed): have people move more, and not always in the same rhythm"
    ),
    _R.OFFSET_UNCERTAIN: (
        "the time offset is {uncertain_by_frames}: have people move faster, or record longer"
    ),
    _R.RIVAL_SOLUTION: (
        "two different solutions fit about equally well, with time offsets that differ by up to "
        "{frames:.1f} frames ({measured:.2f} s): the motion may be periodic, people may move "
        "identically, or the true offset may be outside of offset_range_s (+-{offset_range_s:g} "
        "s); set that to what is possible, or record more varied motion"
    ),
    _R.LARGE_RESIDUALS: (
        "the reprojection error is {measured:.1f} px (root mean square, limit {limit:.1f} px), "
        "although half of the keypoints are within {median_px:.1f} px: a part of the recording "
        "does not fit; check for clocks that are set and cameras that move during the recording"
    ),
    _R.NOT_CONVERGED: (
        "the joint refinement did not converge (cameras that still moved in the last round: "
        "{measured:.0f}): raise bundle.rounds"
    ),
    _R.INCONSISTENT_SCALE: "what was given for the scale is inconsistent: {detail}",
    _R.NO_VERTICAL: (
        "world_frame cannot be found, since {detail}: leave it empty, or have people walk"
    ),
    _R.PERIODIC_MOTION: (
        "everybody's motion repeats after {shortest_s:.2f} s (for some, after {longest_s:.2f} s), "
        "so that a time offset wrong by that much looks right: let people turn, stop and start"
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
    size, limit = rejection.measured, rejection.limit
    return _SENTENCES[rejection.reason].format_map(
        _Values(
            rejection.values,
            measured=size,
            limit=limit,
            measured_deg=math.degrees(size),
            limit_deg=math.degrees(limit),
            measured_ms=1e3 * size,
            limit_ms=1e3 * limit,
            uncertain_by_degrees=uncertain(math.degrees(size), math.degrees(limit), ".1f degrees"),
            uncertain_by_share=uncertain(size, limit, ".0% of the distance to the people"),
            uncertain_by_frames=uncertain(size, limit, ".1f frames"),
            and_received=_as_received(rejection),
            or_others=f", unless {others} is the cause" if others else "",
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
    return after_names(rejection.cameras, sentence(rejection))


def camera_sentence(name: str, rejection: Rejection) -> str:
    """Return why one camera is left out; a group that it belongs to is named."""
    group = [other for other in rejection.cameras if other != name]
    tail = f"; it forms a separate group with {', '.join(group)}" if group else ""
    return sentence(rejection) + tail


def remark_sentence(remark: Remark) -> str:
    """Return the sentence of a remark, after the names of its cameras if it lacks them."""
    return after_names(*_remark_parts(remark))


def remark_sentences(remarks: Sequence[Remark]) -> list[str]:
    """Return remarks as sentences; what is remarked on several cameras is one of them."""
    return gathered([((one.code, one.detail), *_remark_parts(one)) for one in remarks])


def rejection_sentences(rejections: Sequence[Rejection]) -> list[str]:
    """Return rejections as sentences; the same reason of several cameras is one of them."""
    return gathered([(_kind(one), one.cameras, sentence(one)) for one in rejections])


def left_out_sentences(
    left_out: Sequence[tuple[str, Rejection]], *, codes: bool = False
) -> list[str]:
    """Return why cameras are left out; the same reason of several cameras is one sentence.

    Parameters
    ----------
    left_out : sequence of (str, Rejection)
        Names of cameras, each with its rejection, whose cameras are the group that it belongs to.
    codes : bool
        The code of each reason stands before its sentence.
    """
    return gathered(
        [
            (
                (_kind(why), why.cameras[1:] and why.cameras),
                (name,),
                (f"{why.reason.value}: " if codes else "") + sentence(why) + _apart(why),
            )
            for name, why in left_out
        ]
    )


def _kind(rejection: Rejection) -> tuple[object, ...]:
    """What rejections have in common that can be said at once; their numbers may differ."""
    of_one_camera = rejection.reason is _R.LENS_UNKNOWN  # Its detail is the option of the camera.
    return rejection.reason, rejection.others, "" if of_one_camera else rejection.detail


def _apart(rejection: Rejection) -> str:
    """Say that a rejection is about a group."""
    group = rejection.cameras
    return f"; {', '.join(group)} form a separate group" if group[1:] else ""


def _remark_parts(remark: Remark) -> tuple[tuple[str, ...], str]:
    """Names of cameras to put before the sentence of a remark, and the sentence."""
    camera, partner = (*remark.cameras, "", "")[:2]
    template = REMARKS[remark.code]
    additions = ADDITIONS.get(remark.code, {})
    ends = [end for name, end in additions.items() if name in remark.values]
    names = {
        "camera": camera,
        "partner": partner,
        "cameras": ", ".join(remark.cameras),
        "detail": remark.detail,
    }
    text = "".join([template, *ends]).format_map(_Values(remark.values, **names))
    return () if "{camera" in template else remark.cameras, text


def whole_sentences(remarks: Sequence[Remark], rejections: Sequence[Rejection]) -> list[str]:
    """Return remarks and rejections as sentences with capital and full stop."""
    texts = [*remark_sentences(remarks), *rejection_sentences(rejections)]
    about: list[Remark | Rejection] = [*remarks, *rejections]
    names = [name for one in about for name in one.cameras]
    names = [name for remark in remarks for name in remark.cameras]
    names += [name for rejection in rejections for name in rejection.cameras]
    return [as_sentence(text, names) for text in texts]
