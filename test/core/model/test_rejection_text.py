"""One sentence for every code, with value, limit and next step."""

from __future__ import annotations

import math
import re

import pytest

from stcalib_ros.core.model.calibration import UncalibratedCamera
from stcalib_ros.core.model.rejection import Rejection, RejectionReason, Remark, RemarkCode
from stcalib_ros.core.model.rejection_text import (
    labelled,
    remark_sentence,
    sentence,
    whole_sentences,
)

R = RejectionReason
BUNCHES = {"bunch": 3.0, "within_ms": 0.5, "period_ms": 33.3}
SPANS = {"begin_s": 3600.0, "end_s": 3602.0, "others_begin_s": 0.0, "others_end_s": 2.0}
PLACED = {"width": 1920.0, "height": 1080.0, "most_x": 640.0, "most_y": 360.0}
VIEW = {"fx": 0.7, "fy": 0.72, "fov_x": 179.9, "fov_y": 179.4, "ratio": 1.03}
SCALED = {"scale_x": 1 / 3, "scale_y": 0.336, "width": 640.0, "height": 363.0}
MOVED = {"corner_x": 0.1, "corner_y": 2.0, "cx": 540.0, "cy": 960.0}
AFFINE = {**SCALED, **MOVED, "given_cx": 960.0, "given_cy": 540.0}
REJECTIONS = (
    (Rejection(R.TOO_FEW_CAMERAS, (), 1.0, 2.0), "^1 of the cameras can be compared, 2 are needed"),
    (Rejection(R.NO_PERSONS), "no person with enough keypoints: check"),
    (
        Rejection(
            *(R.KEYPOINTS_NORMALISED, (), 1.04, 2.0, "px"),
            values={"least": 0.02, "width": 1280, "height": 720},
        ),
        "normalised: they lie between 0.02 and 1, .* 1280 x 720 .*; multiply those of 0..1 by",
    ),
    (
        Rejection(R.SCORES_BELOW_LIMIT, (), 0.12, 0.3),
        r"above 0.3 \(min_score\), .* is 0.12: .*Scale",
    ),
    (Rejection(R.STREAM_FROZEN, (), 0.97, 0.9), "in 97% of its images .*, 90% are .*; check its"),
    (Rejection(R.IDS_ARE_NO_TRACKS, (), 0.33, 0.7), "33% of them go on .*, 70% .* tracking on"),
    (
        Rejection(R.STAMPS_IN_BUNCHES, (), 0.5, 0.25, values=BUNCHES),
        "bunches of up to 3, 0.5 ms apart where images are 33.3 ms apart, .*: 50% .*, 25% are the",
    ),
    (Rejection(R.STAMPS_TOO_CLOSE, (), 1e-6, 1e-3, "s"), "are 1e-06 s apart .* than 0.001 s"),
    (
        Rejection(R.LENS_UNKNOWN, ("a",), detail="a=unknown"),
        r"K of CameraInfo is zero or there is none: set .* \(--intrinsics a=unknown\)",
    ),
    (
        Rejection(R.FOCAL_LENGTH_ABSURD, (), 179.9, 175.0, values={**PLACED, **VIEW}),
        "of 0.7 and 0.72 px .* of 1920 x 1080 px: .* 180 x 179 degrees .* 1.03 times as wide .*; g",
    ),
    (
        Rejection(R.PRINCIPAL_POINT_OFF_CENTRE, (), 0.25, 0.1, values={**PLACED, "cx": 240.5}),
        r"point \(240.5, nan\) is 25% of .* of 1920 x 1080 px, 10% are the limit: give cx and",
    ),
    (
        Rejection(R.KEYPOINTS_OUTSIDE_IMAGE, (), 0.6, 0.1, values=PLACED),
        r"60% of its poses .* 1920 x 1080 px .*, 10% .* reach to \(640, 360\): .*; bring",
    ),
    (
        Rejection(R.KEYPOINTS_IN_CORNER, (), 0.33, 0.52, values=PLACED),
        r"within \(640, 360\) of .* 1920 x 1080 px, 33% of its size: .*; bring",
    ),
    (Rejection(R.KEYPOINTS_COINCIDE, (), 0.5, 1.0, "px"), "at one place, within 0.5 px: check"),
    (
        Rejection(R.CLOCK_EPOCH_DIFFERS, (), 3598.0, 1.0, "s", (), SPANS),
        r"3600.0..3602.0 s against 0.0..2.0 s, a gap of 3598.0 s where 1 s can be bridged; set i",
    ),
    (Rejection(R.NO_TEMPORAL_OVERLAP, (), 11.0, 12.0), "at most 11 images .*, 12 are needed"),
    (Rejection(R.NO_MOTION, (), 0.012, 0.03), "by 1.2% of a body's height at most, 3% are needed"),
    (Rejection(R.NO_PARALLAX, (), 0.004, 0.03), "0.4% of the distance .* 3% are needed"),
    (Rejection(R.NO_SHARED_MOTION, limit=2.0), r"clocks agree within 2 s \(offset_range_s\)"),
    (Rejection(R.NO_SHARED_OBSERVATIONS), "could not be matched across views: .*; check the intri"),
    (Rejection(R.DISCONNECTED, others=("a", "b")), "shares nobody's motion with a, b: move it"),
    (Rejection(R.UNMATCHED_OBSERVATIONS, others=("a",)), "matches what is seen by a: check"),
    (
        Rejection(R.IMAGE_RESIZED, values=AFFINE),
        "0.33 times as wide and 0.34 .* .640 x 363., .* at .0, 2.: the",
    ),
    (
        Rejection(R.IMAGE_TURNED, values=AFFINE),
        "a quarter or by half, .* at .540, 960., .* says .960, 540.",
    ),
    (
        Rejection(R.LENS_UNDETERMINED, (), 0.016, 0.01),
        "determine its focal length to 1.6%, 1.0% are needed: let them come near",
    ),
    (
        Rejection(R.LENS_NEEDS_PARALLAX, (), 12.0, 5.5),
        "12 times as uncertain .*, 5.5 are the limit .*; move a camera aside, or",
    ),
    (
        Rejection(R.LENS_IMPLAUSIBLE, (), 151.0, 145.0, values={"focal_px": 248.0}),
        "as 248 px, a view of 151 degrees where 145 are the limit: .*; give its intrinsics",
    ),
    (Rejection(R.DISTORTION_DISAGREES, (), -0.07, 0.04), "bent by -7% .*, 4% are the limit: check"),
    (
        Rejection(R.MIRRORED_VIEW, (), 0.74, 0.5, detail="x and y"),
        "mirrored: with x and y exchanged, 74% of its keypoints fit .*; switch off",
    ),
    (Rejection(R.TOO_FEW_INLIERS, (), 150, 400), "only 150 of its keypoints fit, 400 are needed"),
    (Rejection(R.TOO_MANY_OUTLIERS, (), 0.3, 0.55), "only 30% of .*, 55% are needed: check its in"),
    (Rejection(R.TOO_LITTLE_EXPLAINED, (), 0.2, 0.5), "only 20% of all that it sees .*, 50% are"),
    (
        Rejection(R.TOO_LITTLE_SHARED_TIME, (), 1.3, 2.5, values={"explained_fraction": 0.6}),
        "only 1.3 s of somebody's motion .*, 2.5 s are needed where only 60% .* may be chance; let",
    ),
    (Rejection(R.LOOKALIKES), "moves like somebody else at another place, .*: have people move"),
    (Rejection(R.BONES_DISAGREE, (), 1.0, 0.3), "by 57 degrees, 17 are the limit: .*; record"),
    (
        Rejection(R.DISTANCES_DISAGREE, (), 1.7, 1.6, values={"least": 0.625}),
        "1.7 times as far .*, between 0.62 and 1.6 is the limit: .*; record",
    ),
    (Rejection(R.LIMBS_DISAGREE, (), 0.2, 0.1), "in length by 20%, 10% are the limit: .*; let"),
    (Rejection(R.NOTHING_TO_VERIFY), "no limb of anybody is seen by it .*: let people be in its"),
    (
        Rejection(R.ROTATION_UNCERTAIN, (), 0.05, 0.015),
        "by 2.9 degrees, 0.9 are the limit: .*; let",
    ),
    (
        Rejection(R.CLOCK_NOT_STEADY, (), 0.1, 0.015, "s", values={"begin_s": 15.0, "end_s": 30.0}),
        "from 15.0 to 30.0 s after its first .* 100 ms off the rest .*, 15 are the limit; a clock",
    ),
    (
        Rejection(
            *(R.POSE_CHANGED, (), 0.0873, 0.0087, "rad", ("b",)),
            values={"begin_s": 7.0, "end_s": 10.0},
        ),
        r"from 7.0 to 10.0 s .* turned 5.0 degrees .*, 0.5 are the limit \(or it is b\); fasten it",
    ),
    (
        Rejection(R.PART_DISAGREES, (), 60.0, 12.0, "px", values={"begin_s": 7.0, "end_s": 10.0}),
        "from 7.0 to 10.0 s .* is 60 px off .*, 12 are the limit, .* fits otherwise: it was moved",
    ),
    (Rejection(R.POSITION_UNCERTAIN, (), 0.2, 0.1), "by 20% of its distance .*, 10% are .*: let"),
    (
        Rejection(R.OFFSET_AMBIGUOUS, (), 1.05, 1.2, values={"alternative_s": 0.4}),
        r"differs by 0.40 s fits as well \(error 1.05 times as large, 1.20 needed\); people",
    ),
    (
        Rejection(
            R.OFFSET_AMBIGUOUS_WITH_OUTLIERS, (), 1.02, 1.1, values={"inlier_fraction": 0.75}
        ),
        "only 75% of .* all of them fit .* 1.02 times as large, 1.10 needed.: people have to",
    ),
    (Rejection(R.OFFSET_UNCERTAIN, (), 2.5, 1.0), "by 2.5 frames, 1.0 are the limit: people have"),
    (
        Rejection(R.RIVAL_SOLUTION, (), 0.5, values={"frames": 15.0, "offset_range_s": 2.0}),
        r"up to 15.0 frames \(0.50 s\): .* outside of offset_range_s \(\+-2 s\); set that to",
    ),
    (
        Rejection(R.LARGE_RESIDUALS, (), 84.0, 8.0, "px", values={"median_px": 1.9}),
        r"are 84.0 px \(.*\), 8.0 are the limit .* below 1.9 px: .*; check for clocks",
    ),
    (Rejection(R.NOT_CONVERGED, (), 2.0, 0.0), "2 cameras still moved .*: raise bundle.rounds"),
    (Rejection(R.INCONSISTENT_SCALE, detail="a and b"), "scale is inconsistent: a and b"),
    (Rejection(R.NO_VERTICAL, detail="nobody is seen"), "world_frame: nobody is seen; leave it"),
    (
        Rejection(R.PERIODIC_MOTION, values={"shortest_s": 0.8, "longest_s": 1.0}),
        "repeats itself with a period of 0.80 s .*1.00 s.*: let people turn",
    ),
    (
        Rejection(R.IDENTICAL_MOTION, values={"person_a": 0.0, "person_b": 1.0}),
        "persons 0 and 1 move identically: have people",
    ),
    (Rejection(R.COLLINEAR_MOTION), "stays on one line: let people walk across"),
    (Rejection(R.CANCELLED, detail="cancelled during lift"), "^cancelled during lift$"),
    (Rejection(R.INPUT_UNUSABLE, detail="no camera"), "^no camera$"),
    (Rejection(R.SOLVER_FAILED, detail="out of memory"), "^out of memory$"),
    (Rejection(R.UNSPECIFIED, detail="too dark"), "^too dark$"),
)
LEAST = {"rotation_stddev_deg": 0.1146, "position_stddev_percent": 5.0}
SHARED = {"shared_s": 2.0, "usual_s": 8.0, "common_s": 1.0}
SHIFTED_LENS = {"cx": 1010.0, "cy": 540.0, "given_cx": 960.0, "given_cy": 539.0, "bent": 0.021}
SKEWS = {"length_s": 3.0, "stddev_ppm": 80.0, "limit_ppm": 10.0, "enough_s": 12.0}
C = RemarkCode
PROJECTION = {"given": 0.21, "best": 0.99}
REMARKS = (
    (
        Remark(C.LEAST_CONSTRAINED_CAMERA, ("a",), LEAST),
        "is a: its rotation is known to 0.11 .* to 5 % of .*e$",
    ),
    (
        Remark(C.LEAST_CONSTRAINED_CAMERA, ("a",), {**LEAST, "offset_stddev_ms": 17.2}),
        ", its clock to 17 ms$",
    ),
    (
        Remark(C.SHARE_MORE_VIEW, ("a", "b"), SHARED),
        r"^a shares .* 2.0 s only, .*8.0 s: .*it and b .*\(so far 1.0 s",
    ),
    (
        Remark(C.LENS_ASSUMED, ("a", "b"), {"view_deg": 64.0}),
        "lenses of a, b were not known .* view of 64 degrees along the longer side .* distortion",
    ),
    (Remark(C.MOVE_FASTER, ("a",)), "^people who move faster"),
    (Remark(C.LEAVE_THE_LINE), "along one line: let people also walk across it"),
    (Remark(C.RECORD_LONGER), "a recording twice as long"),
    (
        Remark(C.STAMPS_JUMP, ("a",), {"begin_s": 15.0, "end_s": 30.0, "jump_ms": 100.0}),
        "^a: from 15 to 30 s after its first .* 100 ms off the times .*: check that nothing sets",
    ),
    (
        Remark(C.VERIFIED_BY_LIMBS_ALONE, ("a", "b"), {"limb_variation_percent": 3.21}),
        "^no 3D poses verify a, b: only the lengths .*, which vary by 3.2 %$",
    ),
    (
        Remark(C.STAMPS_EVENED, ("a",), BUNCHES),
        "^the stamps of a come in bunches of up to 3, 0.5 ms apart, .* taken 33.3 ms apart",
    ),
    (
        Remark(C.IMAGES_LEFT_OUT, ("a",), {"n_left_out": 12, "n_images": 300}),
        "^a: 12 of 300 images are left out",
    ),
    (
        Remark(C.CLOCKS_ALIGNED, ("a", "b"), {"seconds": -3600.5, "range_s": 2.0}, "of x"),
        "^-3600.500 s were added to the stamps of a, b, of x, before .* within 2 s: a guess, which",
    ),
    (
        Remark(C.PEOPLE_OF_UNUSUAL_SIZE, (), {"ratio": 1.22}),
        "^by scale.distances, people are 1.22 times as large as adults: check the distances",
    ),
    (
        Remark(C.LENS_HELD, ("a",), {"limit_percent": 1.0}),
        "^a: its lens stays as it was given: .* to 1.0 %; let people come near",
    ),
    (
        Remark(C.LENS_FAR_FROM_GIVEN, ("a",), {"times": 1.42, "deviations": 3.5}),
        "^a: its focal length is 1.420 times the one .*, 3.5 standard deviations .*: check",
    ),
    (
        Remark(C.IMAGE_NOT_UPRIGHT, ("a",), {"turned_deg": 180.0}),
        "^a: people are turned by 180 degrees in its image: it hangs that way, or its image is",
    ),
    (
        Remark(C.LENS_DEVIATES, ("a",), {"scale": 0.951}),
        "^a: .* another lens .* `intrinsics: refine` .*; its focal length is 0.951 times as long$",
    ),
    (
        Remark(C.LENS_DEVIATES, ("a",), SHIFTED_LENS),
        r"it; its principal point is at \(1010, 540\), not at \(960, 539\); at .* \+2.1% further",
    ),
    (
        Remark(C.POSES_LEFT_OUT, ("a",), {"n_left_out": 12, "n_poses": 300}),
        "^a: 12 of 300 poses are left out, .* at one place: check",
    ),
    (
        Remark(C.CLOCK_SKEW_NOT_OBSERVABLE, (), {"length_s": 3.0}),
        "3 s are too short to measure a difference",
    ),
    (
        Remark(C.CLOCK_SKEW_NOT_OBSERVABLE, (), SKEWS),
        "3 s are too short .*; about 12 s would be enough$",
    ),
    (
        Remark(C.IDS_LINKED, ("a",), {"continued": 0.4, "limit": 0.7, "n_tracks": 5}),
        r"^a: .* no tracks \(40% .*, 70% are needed\): .* to 5 tracks; a tracker",
    ),
    (Remark(C.SCORES_IN_PERCENT, ("a",), {"largest": 98.0}), "^a: scores go up to 98, .*: give"),
    (
        Remark(C.KEYPOINTS_NOT_OBSERVED, ("a",), {"n_points": 320, "x": -1.0, "y": -1.0}),
        r"^a: 320 keypoints .* exactly at \(-1, -1\), .*: let their",
    ),
    (
        Remark(C.IMAGES_REPEATED, ("a",), {"n_repeated": 5, "n_images": 90, "longest_s": 0.2}),
        r"^a: 5 of 90 images are left out, .* up to 0.2 s\), .*; check",
    ),
    (Remark(C.KEYPOINTS_SWAPPED, ("a",)), "^a: x and y of its keypoints are swapped, .*; give x"),
    (Remark(C.LAYOUT_MISTAKEN, ("a",), detail="coco_17"), "^a: .* those of coco_17, .*: correct"),
    (
        Remark(C.POSES_RESCALED, ("a",), {"height_m": 1720.0}, "millimetres"),
        "^a: people would be 1720 m tall .* taken as millimetres: convert",
    ),
    (
        Remark(C.POSES_NOT_METRIC, ("a",), {"height_m": 0.86}),
        "^a: people would be 0.86 m tall .*: give them in metres",
    ),
    (
        Remark(C.POSES_IN_OTHER_AXES, ("a",), PROJECTION, "x left, y up, z forward"),
        r"^a: .*\(correlation 0.21\) .*: they are x left, y up, z forward \(.* 0.99\); x r",
    ),
    (
        Remark(C.POSES_IN_OTHER_ORDER, ("a",), PROJECTION, "coco_17"),
        r"^a: .* in the order of coco_17 \(correlation 0.99\)",
    ),
    (
        Remark(C.POSES_WITH_SIDES_EXCHANGED, ("a",), PROJECTION),
        r"^a: .* left and right are exchanged between both \(correlation 0.99 .*; check",
    ),
    (
        Remark(C.POSES_DO_NOT_PROJECT, ("a",), PROJECTION),
        r"^a: its 3D poses do not project .*\(correlation 0.21\) .*: check that both",
    ),
)


@pytest.mark.parametrize(("rejection", "says"), REJECTIONS, ids=[r.reason for r, _ in REJECTIONS])
def test_sentence_of_a_code(rejection: Rejection, says: str) -> None:
    text = sentence(rejection)
    assert re.search(says, text), text
    assert not {"\n", "nan", "{"} & {text, *text.split()}


@pytest.mark.parametrize(("remark", "says"), REMARKS)
def test_sentence_of_a_remark(remark: Remark, says: str) -> None:
    assert re.search(says, remark_sentence(remark)), remark_sentence(remark)


def test_every_code_has_its_test_and_its_own_name_as_value() -> None:
    assert {rejection.reason for rejection, _ in REJECTIONS} == set(RejectionReason)
    assert {remark.code for remark, _ in REMARKS} == set(RemarkCode)
    assert all(code.value == code.name for code in (*RejectionReason, *RemarkCode))


def test_numbers_that_a_file_lacks_are_unknown() -> None:
    assert "differs by nan s" in sentence(Rejection(R.OFFSET_AMBIGUOUS, (), 1.0, 1.2))


def test_cameras_come_first() -> None:
    assert labelled(Rejection(R.NO_PERSONS, ("cam1", "cam2"))).startswith("cam1, cam2: no person")
    alone = UncalibratedCamera("cam1", Rejection(R.DISCONNECTED, ("cam1",), others=("cam0",)))
    group = UncalibratedCamera(
        "cam1", Rejection(R.DISCONNECTED, ("cam1", "cam2"), others=("cam0",))
    )
    assert group.reason == f"{alone.reason}; it forms a separate group with cam2"


def test_whole_sentences() -> None:
    line = Rejection(R.COLLINEAR_MOTION)
    first, second = whole_sentences([Remark(C.RECORD_LONGER)], [line])
    assert first == ("A recording twice as long would reduce these uncertainties by about 30 %.")
    assert second == "Everybody stays on one line: let people walk across it, too."
    assert math.isnan(line.measured)
