"""One sentence for every code, with value, limit and next step."""

from __future__ import annotations

import math
import re

import pytest

from stcalib_ros.core.model.calibration import UncalibratedCamera
from stcalib_ros.core.model.rejection import Rejection, RejectionReason, Remark, RemarkCode
from stcalib_ros.core.model.rejection_text import (
    labelled,
    left_out_sentences,
    rejection_sentences,
    remark_sentence,
    remark_sentences,
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
    (Rejection(R.TOO_FEW_CAMERAS, (), 1.0, 2.0), r"can be used \(1, at least 2 needed\): record"),
    (Rejection(R.NO_PERSONS), "enough keypoints: check the output"),
    (
        Rejection(
            *(R.KEYPOINTS_NORMALISED, (), 1.04, 2.0, "px"),
            values={"least": 0.02, "width": 1280, "height": 720},
        ),
        "fractions .*: they range from 0.02 to 1, .* 1280 x 720 px; multiply them by",
    ),
    (
        Rejection(R.SCORES_BELOW_LIMIT, (), 0.12, 0.3),
        r"above 0.3 \(min_score\), .* is 0.12: .*; scale",
    ),
    (Rejection(R.STREAM_FROZEN, (), 0.97, 0.9), r"in 97% of the images, .* \(limit 90%\); check"),
    (
        Rejection(R.IDS_ARE_NO_TRACKS, (), 0.33, 0.7),
        r"only 33% .* \(at least 70% needed\); switch on tracking",
    ),
    (
        Rejection(R.STAMPS_IN_BUNCHES, (), 0.5, 0.25, values=BUNCHES),
        r"bunches of up to 3, 0.5 ms apart instead of 33.3 ms, .*: 50% .* \(limit 25%\); stamp",
    ),
    (
        Rejection(R.STAMPS_TOO_CLOSE, (), 1e-6, 1e-3, "s"),
        r"are 1e-06 s apart, .* \(at least 0.001 s expected\): stamp",
    ),
    (
        Rejection(R.LENS_UNKNOWN, ("a",), detail="a=unknown"),
        r"K in CameraInfo is zero, .*: set intrinsics .* \(--intrinsics a=unknown\)",
    ),
    (
        Rejection(R.FOCAL_LENGTH_ABSURD, (), 179.9, 175.0, values={**PLACED, **VIEW}),
        "of 0.7 and 0.72 px .* 1920 x 1080 px: .* 180 x 179 degrees, .* 1.03 times as wide .*; g",
    ),
    (
        Rejection(R.PRINCIPAL_POINT_OFF_CENTRE, (), 0.25, 0.1, values={**PLACED, "cx": 240.5}),
        r"point \(240.5, nan\) is 25% .* 1920 x 1080 px image \(limit 10%\): check that cx",
    ),
    (
        Rejection(R.KEYPOINTS_OUTSIDE_IMAGE, (), 0.6, 0.1, values=PLACED),
        r"60% of the poses .* 1920 x 1080 px .*\(limit 10%\), and reach \(640, 360\): .*; make",
    ),
    (
        Rejection(R.KEYPOINTS_IN_CORNER, (), 0.33, 0.52, values=PLACED),
        r"corner and \(640, 360\), in 33% of the 1920 x 1080 px image: .*; make",
    ),
    (
        Rejection(R.KEYPOINTS_COINCIDE, (), 0.5, 1.0, "px"),
        r"at the same place \(within 0.5 px\): check",
    ),
    (
        Rejection(R.CLOCK_EPOCH_DIFFERS, (), 3598.0, 1.0, "s", (), SPANS),
        r"3600.0..3602.0 s, the others 0.0..2.0 s\): the gap is 3598.0 s, and at most 1 s .*; set",
    ),
    (
        Rejection(R.NO_TEMPORAL_OVERLAP, (), 11.0, 12.0),
        r"at most 11 images .* \(at least 12 needed\): record",
    ),
    (
        Rejection(R.NO_MOTION, (), 0.012, 0.03),
        r"by at most 1.2% of .* \(at least 3% needed\); have",
    ),
    (
        Rejection(R.NO_PARALLAX, (), 0.004, 0.03),
        r"at most 0.4% of .* \(at least 3% needed\), .*; move one aside",
    ),
    (Rejection(R.NO_SHARED_MOTION, limit=2.0), r"clocks agree within 2 s \(offset_range_s\)"),
    (Rejection(R.NO_SHARED_OBSERVATIONS), "could not be matched across views, .*: check the intri"),
    (
        Rejection(R.DISCONNECTED, others=("a", "b")),
        "found both here and in a, b: make the views overlap",
    ),
    (Rejection(R.UNMATCHED_OBSERVATIONS, others=("a",)), "match those of a: check"),
    (
        Rejection(R.IMAGE_RESIZED, values=AFFINE),
        r"0.33 times as wide and 0.34 .* \(640 x 363\), .* at \(0, 2\): the",
    ),
    (
        Rejection(R.IMAGE_TURNED, values=AFFINE),
        r"90 or 180 degrees, .* at \(540, 960\), .* says \(960, 540\); make",
    ),
    (
        Rejection(R.LENS_UNDETERMINED, (), 0.016, 0.01),
        r"the focal length only to 1.6% \(1.0% or better needed\): let people come near",
    ),
    (
        Rejection(R.LENS_NEEDS_PARALLAX, (), 12.0, 5.5),
        r"12 times as uncertain .* \(limit 5.5 .*\); move a camera aside, or",
    ),
    (
        Rejection(R.LENS_IMPLAUSIBLE, (), 151.0, 145.0, values={"focal_px": 248.0}),
        r"as 248 px, a field of view of 151 degrees \(limit 145\): .*; give the intrinsics",
    ),
    (Rejection(R.DISTORTION_DISAGREES, (), -0.07, 0.04), r"is off by -7% \(limit 4%\); check"),
    (
        Rejection(R.MIRRORED_VIEW, (), 0.74, 0.5, detail="x and y"),
        "mirrored: with x and y exchanged, 74% of the keypoints fit .*; switch off",
    ),
    (
        Rejection(R.TOO_FEW_INLIERS, (), 150, 400),
        r"only 150 keypoints fit .* \(at least 400 needed\): have",
    ),
    (
        Rejection(R.TOO_MANY_OUTLIERS, (), 0.3, 0.55),
        r"only 30% of .* \(at least 55% needed\): check the in",
    ),
    (
        Rejection(R.TOO_LITTLE_EXPLAINED, (), 0.2, 0.5),
        r"only 20% of all .* \(at least 50% needed\): .*; let the same",
    ),
    (
        Rejection(R.TOO_LITTLE_SHARED_TIME, (), 1.3, 2.5, values={"explained_fraction": 0.6}),
        r"only 1.3 s .* \(at least 2.5 s needed, as only 60% .*\): that may be coincidence; let",
    ),
    (Rejection(R.LOOKALIKES), "moves like somebody else, .*: have people move"),
    (Rejection(R.BONES_DISAGREE, (), 1.0, 0.3), r"by 57 degrees \(limit 17\): .*; record"),
    (
        Rejection(R.DISTANCES_DISAGREE, (), 1.7, 1.6, values={"least": 0.625}),
        r"1.7 times as far .* \(limits 0.62 and 1.6\): .*; record",
    ),
    (Rejection(R.LIMBS_DISAGREE, (), 0.2, 0.1), r"in length by 20% \(limit 10%\): .*; let"),
    (Rejection(R.NOTHING_TO_VERIFY), "no arm or leg is seen .*: keep people in view"),
    (
        Rejection(R.ROTATION_UNCERTAIN, (), 0.05, 0.015),
        r"by 2.9 degrees \(limit 0.9\), .*: let",
    ),
    (
        Rejection(R.ROTATION_UNCERTAIN, (), math.inf, 0.015),
        r"the rotation is not determined, .*: let",
    ),
    (
        Rejection(R.OFFSET_UNCERTAIN, (), math.inf, 0.5),
        r"time offset is not determined: have people",
    ),
    (
        Rejection(R.CLOCK_NOT_STEADY, (), 0.1, 0.015, "s", values={"begin_s": 15.0, "end_s": 30.0}),
        r"from 15.0 to 30.0 s after the first .* 100 ms off .* \(limit 15 ms\); the .*: stamp",
    ),
    (
        Rejection(
            *(R.POSE_CHANGED, (), 0.0873, 0.0087, "rad", ("b",)),
            values={"begin_s": 7.0, "end_s": 10.0},
        ),
        r"from 7.0 to 10.0 s .* by 5.0 degrees .* \(limit 0.5\), unless b is the cause; fasten it",
    ),
    (
        Rejection(R.PART_DISAGREES, (), 60.0, 12.0, "px", values={"begin_s": 7.0, "end_s": 10.0}),
        r"from 7.0 to 10.0 s .* are 60 px from .* \(limit 12\), .* was moved, .*; use only",
    ),
    (
        Rejection(R.POSITION_UNCERTAIN, (), 0.2, 0.1),
        r"by 20% of the distance .* \(limit 10%\): let",
    ),
    (
        Rejection(R.OFFSET_AMBIGUOUS, (), 1.05, 1.2, values={"alternative_s": 0.4}),
        r"differs by 0.40 s fits .* \(its error is 1.05 times .* 1.20 times needed\); have",
    ),
    (
        Rejection(
            R.OFFSET_AMBIGUOUS_WITH_OUTLIERS, (), 1.02, 1.1, values={"inlier_fraction": 0.75}
        ),
        r"only 75% of .* all of them fit .* 1.02 times .*, at least 1.10 times needed\): have",
    ),
    (Rejection(R.OFFSET_UNCERTAIN, (), 2.5, 1.0), r"by 2.5 frames \(limit 1.0\): have"),
    (
        Rejection(R.RIVAL_SOLUTION, (), 0.5, values={"frames": 15.0, "offset_range_s": 2.0}),
        r"up to 15.0 frames \(0.50 s\): .* outside of offset_range_s \(\+-2 s\); set that to",
    ),
    (
        Rejection(R.LARGE_RESIDUALS, (), 84.0, 8.0, "px", values={"median_px": 1.9}),
        r"is 84.0 px \(.*, limit 8.0 px\), .* within 1.9 px: .*; check for clocks",
    ),
    (
        Rejection(R.NOT_CONVERGED, (), 2.0, 0.0),
        r"still moved in the last round: 2\): raise bundle.rounds",
    ),
    (Rejection(R.INCONSISTENT_SCALE, detail="a and b"), "scale is inconsistent: a and b"),
    (
        Rejection(R.NO_VERTICAL, detail="nobody is seen"),
        "world_frame cannot be found, since nobody is seen: leave it",
    ),
    (
        Rejection(R.PERIODIC_MOTION, values={"shortest_s": 0.8, "longest_s": 1.0}),
        "repeats after 0.80 s .*1.00 s.*: let people turn",
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
        "camera is a: its rotation is known to 0.11 degrees .* to 5 % of .*n$",
    ),
    (
        Remark(C.LEAST_CONSTRAINED_CAMERA, ("a",), {**LEAST, "offset_stddev_ms": 17.2}),
        ", its clock to 17 ms$",
    ),
    (
        Remark(C.SHARE_MORE_VIEW, ("a", "b"), SHARED),
        r"^a and .* for 2.0 s only, where 8.0 s are usual: .* both a and b .*\(1.0 s",
    ),
    (
        Remark(C.LENS_ASSUMED, ("a", "b"), {"view_deg": 64.0}),
        "lenses of a, b were not known .* view of 64 degrees along the longer side .* distortion$",
    ),
    (Remark(C.MOVE_FASTER, ("a",)), "^if people moved faster in view of a, its clock"),
    (Remark(C.LEAVE_THE_LINE), "one line: if people also walked across it"),
    (Remark(C.RECORD_LONGER), "^a recording twice as long"),
    (
        Remark(C.STAMPS_JUMP, ("a",), {"begin_s": 15.0, "end_s": 30.0, "jump_ms": 100.0}),
        "^a: from 15 to 30 s after the first .* 100 ms off .*: check that nothing sets",
    ),
    (
        Remark(C.VERIFIED_BY_LIMBS_ALONE, ("a", "b"), {"limb_variation_percent": 3.21}),
        "^without 3D poses, only the lengths .* confirm a, b; they vary by 3.2 %$",
    ),
    (
        Remark(C.STAMPS_EVENED, ("a",), BUNCHES),
        "^a: timestamps come in bunches of up to 3, 0.5 ms apart, .* every 33.3 ms: .*; stamp",
    ),
    (
        Remark(C.IMAGES_LEFT_OUT, ("a",), {"n_left_out": 12, "n_images": 300}),
        "^a: 12 of 300 images are ignored",
    ),
    (
        Remark(C.CLOCKS_ALIGNED, ("a", "b"), {"seconds": -3600.5, "range_s": 2.0}, "of x"),
        "^-3600.500 s were added to the timestamps of a, b, of x, before .* within 2 s: this guess",
    ),
    (
        Remark(C.PEOPLE_OF_UNUSUAL_SIZE, (), {"ratio": 1.22}),
        "^by scale.distances, people are 1.22 times as tall as adults: check .* are that tall$",
    ),
    (
        Remark(C.LENS_HELD, ("a",), {"limit_percent": 1.0}),
        "^a: the lens is kept as given, .* to 1.0 %: let people come near",
    ),
    (
        Remark(C.LENS_FAR_FROM_GIVEN, ("a",), {"times": 1.42, "deviations": 3.5}),
        "^a: .* focal length is 1.420 times the given one, 3.5 standard deviations .*: check",
    ),
    (
        Remark(C.IMAGE_NOT_UPRIGHT, ("a",), {"turned_deg": 180.0}),
        "^a: people appear turned by 180 degrees: either .* mounted that way, or its image is",
    ),
    (
        Remark(C.LENS_DEVIATES, ("a",), {"scale": 0.951}),
        "^a: .* do not quite fit .* `intrinsics: refine` .*; its focal .* 0.951 times as long$",
    ),
    (
        Remark(C.LENS_DEVIATES, ("a",), SHIFTED_LENS),
        r"; its principal point .* at \(1010, 540\), not at \(960, 539\); near .* off by \+2.1%$",
    ),
    (
        Remark(C.POSES_LEFT_OUT, ("a",), {"n_left_out": 12, "n_poses": 300}),
        "^a: 12 of 300 poses are ignored, .* at the same place: check",
    ),
    (
        Remark(C.CLOCK_SKEW_NOT_OBSERVABLE, (), {"length_s": 3.0}),
        "one rate: 3 s are too short to measure a difference .*w.$",
    ),
    (
        Remark(C.CLOCK_SKEW_NOT_OBSERVABLE, (), SKEWS),
        "3 s are too short .*; about 12 s would be enough$",
    ),
    (
        Remark(C.IDS_LINKED, ("a",), {"continued": 0.4, "limit": 0.7, "n_tracks": 5}),
        r"^a: .* \(only 40% .*, at least 70% needed\); .* gave 5 tracks: a tracker",
    ),
    (Remark(C.SCORES_IN_PERCENT, ("a",), {"largest": 98.0}), "^a: scores go up to 98 .*: give"),
    (
        Remark(C.KEYPOINTS_NOT_OBSERVED, ("a",), {"n_points": 320, "x": -1.0, "y": -1.0}),
        r"^a: 320 keypoints .* exactly at \(-1, -1\) .*: set their",
    ),
    (
        Remark(C.IMAGES_REPEATED, ("a",), {"n_repeated": 5, "n_images": 90, "longest_s": 0.2}),
        r"^a: 5 of 90 images are ignored, .* up to 0.2 s\) .*; check",
    ),
    (Remark(C.KEYPOINTS_SWAPPED, ("a",)), "^a: x and y of the keypoints are exchanged, .*: give x"),
    (Remark(C.LAYOUT_MISTAKEN, ("a",), detail="coco_17"), "^a: .* those of coco_17: correct"),
    (
        Remark(C.POSES_RESCALED, ("a",), {"height_m": 1720.0}, "millimetres"),
        "^a: .* people would be 1720 m tall, .* taken as millimetres: convert",
    ),
    (
        Remark(C.POSES_NOT_METRIC, ("a",), {"height_m": 0.86}),
        "^a: .* people would be 0.86 m tall, .*: give the poses in metres",
    ),
    (
        Remark(C.POSES_IN_OTHER_AXES, ("a",), PROJECTION, "x left, y up, z forward"),
        r"^a: .*\(correlation 0.21\) .* axes were x left, y up, z forward \(.* 0.99\): x r",
    ),
    (
        Remark(C.POSES_IN_OTHER_ORDER, ("a",), PROJECTION, "coco_17"),
        r"^a: .* in the order of coco_17 \(correlation 0.99\)",
    ),
    (
        Remark(C.POSES_WITH_SIDES_EXCHANGED, ("a",), PROJECTION),
        r"^a: .* left and right exchanged \(correlation 0.99\): check",
    ),
    (
        Remark(C.POSES_DO_NOT_PROJECT, ("a",), PROJECTION),
        r"^a: the 3D poses do not match .*\(correlation 0.21\) .*: check that both",
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
    assert labelled(Rejection(R.NO_PERSONS, ("cam1", "cam2"))).startswith(
        "cam1, cam2: nobody was detected"
    )
    alone = UncalibratedCamera("cam1", Rejection(R.DISCONNECTED, ("cam1",), others=("cam0",)))
    group = UncalibratedCamera(
        "cam1", Rejection(R.DISCONNECTED, ("cam1", "cam2"), others=("cam0",))
    )
    assert group.reason == f"{alone.reason}; it forms a separate group with cam2"


def test_the_same_reason_of_several_cameras_is_one_sentence() -> None:
    few, fewer = (Rejection(R.TOO_FEW_INLIERS, (n,), k, 400) for n, k in (("a", 150), ("b", 70)))
    nobody = [Rejection(R.NO_PERSONS, (name,)) for name in "cd"]
    first, second = rejection_sentences([few, nobody[0], fewer, nobody[1]])
    assert first == f"{labelled(few)}; the same applies to b"
    assert second == f"c, d: {sentence(nobody[0])}"
    odd = [Rejection(R.UNSPECIFIED, (name,), detail=f"odd {name}") for name in "ab"]
    assert rejection_sentences(odd) == ["a: odd a", "b: odd b"]
    lenses = [Rejection(R.LENS_UNKNOWN, (name,), detail=f"{name}=unknown") for name in "ab"]
    assert rejection_sentences(lenses) == [f"{labelled(lenses[0])}; the same applies to b"]
    pairs = [Rejection(R.IDENTICAL_MOTION, values={"person_a": k, "person_b": 9}) for k in (1, 2)]
    assert rejection_sentences(pairs) == [sentence(one) for one in pairs]


def test_the_same_remark_on_several_cameras_is_one_sentence() -> None:
    held = [Remark(C.LENS_HELD, (name,), {"limit_percent": 1.0}) for name in "ab"]
    slow = [Remark(C.MOVE_FASTER, (name,)) for name in "ab"]
    first, *others = remark_sentences([*held, *slow])
    assert first == remark_sentence(held[0]).replace("a: ", "a, b: ", 1)
    assert others == [remark_sentence(slow[0]), remark_sentence(slow[1])]


def test_cameras_that_are_left_out_together() -> None:
    pair, other = (Rejection(R.DISCONNECTED, names, others=("z",)) for names in (("a", "b"), "c"))
    alone = ("c", Rejection(R.DISCONNECTED, ("c",), others=("z",)))
    group, single = left_out_sentences([("a", pair), alone, ("b", pair)])
    assert group == f"a, b: {sentence(pair)}; a, b form a separate group"
    assert single == f"c: {sentence(other)}"
    assert left_out_sentences([alone], codes=True) == [f"c: DISCONNECTED: {sentence(other)}"]


def test_whole_sentences() -> None:
    line = Rejection(R.COLLINEAR_MOTION)
    first, second = whole_sentences([Remark(C.RECORD_LONGER)], [line])
    assert first == "A recording twice as long would reduce these uncertainties by about 30 %."
    assert second == "Everybody stays on one line: let people walk across it, too."
    assert math.isnan(line.measured)
    held = Remark(C.LENS_HELD, ("cam0",), {"limit_percent": 1.0})
    assert whole_sentences([held], ())[0].startswith("cam0: the lens is kept")
