from __future__ import annotations

import contextlib
import math
import random
from dataclasses import replace
from pathlib import Path

import bag_helpers as bags
import hypothesis.strategies as st
import numpy as np
import pytest
import yaml
from exclusion_helpers import left_out
from hypothesis import HealthCheck, given, settings
from scipy.spatial.transform import Rotation

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.calibration import (
    Calibration,
    CameraCalibration,
    PairResidual,
    PersonAssociation,
    Status,
    UncalibratedCamera,
)
from stcalib_ros.core.model.rejection import Rejection, RejectionReason, Remark, RemarkCode
from stcalib_ros.io.results import read_result, result_text, write_result

number = st.floats(-1e9, 1e9)
any_number = st.floats(allow_nan=True, allow_infinity=True)


SHORT = Rejection(
    RejectionReason.TOO_LITTLE_SHARED_TIME,
    ("cam3", "cam4"),
    1.3,
    2.5,
    "s",
    ("cam0", "cam1"),
    {"explained_fraction": 0.6},
    "süß",
)


def calibration(numbers: list[float], rotation: Rotation, margin: float = math.inf) -> Calibration:
    """A calibration of two cameras made of 70 numbers."""
    a = np.resize(np.array(numbers), 70)
    lenses = [c.intrinsics for c in bags.small_recording(rectified=True).cameras]
    cameras = tuple(
        CameraCalibration(
            name=f"cam{c}",
            frame_id=f"frame {c}",
            intrinsics=lens,
            R_ref_cam=rotation.as_matrix() if c else np.eye(3),
            t_ref_cam=1e-3 * c * a[:3],
            covariance=c * a[3:39].reshape(6, 6),
            time_offset_s=float(a[40]),
            time_offset_stddev_s=float(a[41]),
            clock_skew=1e-10 * float(a[42]),
            clock_skew_stddev=math.nan,
            line_time_s=c * float(a[67]),
            line_time_stddev_s=float(a[68]) if c and margin == math.inf else math.nan,
        )
        for c, lens in enumerate(lenses)
    )
    return Calibration(
        status=Status.OK,
        message="Two cameras: süß, # and all.",
        reference="cam0",
        metric=False,
        epoch_s=float(a[43]),
        window_s=(float(a[44]), float(a[45])),
        cameras=cameras,
        uncalibrated=(
            left_out("cam2", "nobody in common: 'x'"),
            UncalibratedCamera("cam3", SHORT),
        ),
        persons=(
            PersonAssociation(0, {"cam0": (3,), "cam1": (7, 12)}, 1.9, margin),
            PersonAssociation(1, {}, math.nan),
        ),
        pairs=(PairResidual("cam0", "cam1", 2, float(a[46]), math.nan),),
        reprojection_rms_px=float(a[47]),
        n_observations=100,
        n_inliers=90,
        joint_covariance=a[50:66].reshape(4, 4),
        parameter_order=("cam1.x", "cam1.y", "cam1.z", "cam1.time_offset_s"),
        frame_id="hall" if margin == math.inf else "",
        scale_stddev=float(a[66]) if margin == math.inf else math.nan,
        rejections=(Rejection(RejectionReason.COLLINEAR_MOTION),),
        remarks=(Remark(RemarkCode.LEAST_CONSTRAINED_CAMERA, ("cam1",), {"x_deg": float(a[69])}),),
    )


def assert_same(a: Calibration, b: Calibration) -> None:
    for name in a.__slots__:
        if name not in ("cameras", "joint_covariance"):
            assert repr(getattr(a, name)) == repr(getattr(b, name)), name
    np.testing.assert_array_equal(a.joint_covariance, b.joint_covariance)
    for x, y in zip(a.cameras, b.cameras, strict=True):
        for name in x.__slots__:
            if name == "R_ref_cam":
                np.testing.assert_allclose(x.R_ref_cam, y.R_ref_cam, atol=1e-15)
            elif name == "intrinsics":
                assert repr(x.intrinsics) == repr(y.intrinsics)
            else:
                np.testing.assert_array_equal(getattr(x, name), getattr(y, name))


@settings(
    max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    numbers=st.lists(number, min_size=1, max_size=70),
    q=st.tuples(*[st.floats(0.1, 1)] * 4),
    margin=any_number,
)
def test_round_trip(tmp_path: Path, numbers: list[float], q: list[float], margin: float) -> None:
    written = calibration(numbers, Rotation.from_quat(q), margin)
    write_result(written, tmp_path / "out.yaml")
    assert_same(written, read_result(tmp_path / "out.yaml"))


def test_file_says_which_way_transforms_point() -> None:
    text = result_text(calibration([1.0], Rotation.identity()))
    assert "x_ref = R x_cam + translation" in text
    assert "t_ref = t_cam + time_offset_s + clock_skew * (t_cam - epoch_s)" in text


def test_line_times_are_written_where_there_are_some() -> None:
    cameras = yaml.safe_load(result_text(calibration([0.5], Rotation.identity())))["cameras"]
    assert cameras["cam1"]["line_time_s"] == 0.5
    assert "line_time_s" not in cameras["cam0"]


def test_form_of_the_interface() -> None:
    content = yaml.safe_load(result_text(calibration([0.5], Rotation.identity())))
    assert content["format"] == "stcalib/1"
    assert content["status"] == "OK"
    short = content["uncalibrated"]["cam3"]
    assert (short["code"], short["measured"], short["limit"], short["unit"]) == (
        "TOO_LITTLE_SHARED_TIME",
        1.3,
        2.5,
        "s",
    )
    assert short["message"].startswith("only 1.3 s of people's motion agree")
    (reason,) = content["reasons"]
    assert reason["code"] == "COLLINEAR_MOTION"
    assert "measured" not in reason
    assert content["remarks"][0]["code"] == "LEAST_CONSTRAINED_CAMERA"
    camera = content["cameras"]["cam1"]
    assert camera["rotation"] == [0.0, 0.0, 0.0, 1.0]
    assert (len(camera["translation"]), len(camera["covariance"])) == (3, 36)
    assert set(camera["intrinsics"]) == {"width", "height", "model", "k", "d", "r"}
    assert content["persons"][0]["tracks"] == {"cam0": [3], "cam1": [7, 12]}
    assert content["persons"][0]["margin"] == math.inf


MINIMAL = """\
format: stcalib/1
status: OK
reference: cam0
metric: true
epoch_s: 10
cameras:
  cam0:
    rotation: [0, 0, 0, 1]
    translation: [0, 0, 0]
    time_offset_s: 1e-3
    intrinsics: {width: 640, height: 480, model: plumb_bob, k: [1, 0, 2, 0, 1, 2, 0, 0, 1], d: []}
"""


def test_what_may_be_missing(tmp_path: Path) -> None:
    (tmp_path / "truth.yaml").write_text(MINIMAL)
    truth = read_result(tmp_path / "truth.yaml")
    (camera,) = truth.cameras
    assert camera.frame_id == "cam0_optical_frame"
    assert camera.time_offset_s == 0.001
    assert camera.clock_skew == 0.0
    assert np.isnan(camera.covariance).all()
    assert truth.window_s == (10.0, 10.0)
    assert (truth.persons, truth.pairs, truth.uncalibrated) == ((), (), ())
    assert (truth.rejections, truth.remarks) == ((), ())


def test_reasons_of_other_versions(tmp_path: Path) -> None:
    refused = MINIMAL.replace("status: OK", "status: DEGENERATE\nmessage: nobody moves")
    (tmp_path / "old.yaml").write_text(f"{refused}uncalibrated: {{cam7: saw nobody}}\n")
    old = read_result(tmp_path / "old.yaml")
    assert old.uncalibrated == (left_out("cam7", "saw nobody"),)
    assert old.uncalibrated[0].reason == "saw nobody"
    unspecified = RejectionReason.UNSPECIFIED
    assert [(r.reason, r.detail) for r in old.rejections] == [(unspecified, "nobody moves")]
    other = "[{code: NEW_CODE, message: too dark, measured: 3, cameras: [cam7]}]"
    remark = "[{code: NEW_REMARK}]"
    (tmp_path / "new.yaml").write_text(f"{refused}reasons: {other}\nremarks: {remark}\n")
    new = read_result(tmp_path / "new.yaml")
    assert new.rejections[0].reason is unspecified
    assert (new.rejections[0].detail, new.rejections[0].measured) == ("too dark", 3.0)
    assert new.rejections[0].cameras == ()


def test_a_rejection_without_numbers_is_equal_to_itself_read_back(tmp_path: Path) -> None:
    still = Rejection(RejectionReason.IDENTICAL_MOTION, values={"person_a": 0.0, "person_b": 1.0})
    refused = MINIMAL.replace("status: OK", "status: DEGENERATE\nmessage: alike")
    (tmp_path / "a.yaml").write_text(refused)
    read = read_result(tmp_path / "a.yaml")
    write_result(replace(read, rejections=(still,)), tmp_path / "b.yaml")
    assert read_result(tmp_path / "b.yaml").rejections == (still,)
    assert len({still, still}) == 1


def test_remarks_of_other_versions_are_left_out(tmp_path: Path) -> None:
    (tmp_path / "new.yaml").write_text(f"{MINIMAL}remarks: [{{code: NEW_REMARK}}]\n")
    new = read_result(tmp_path / "new.yaml")
    assert new.remarks == ()


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ("stcalib/1", "stcalib/9", r"format is 'stcalib/9'; this version reads stcalib/1"),
        ("format: stcalib/1\n", "", r"out\.yaml: format is missing"),
        ("status: OK", "status: FINE", r"status: expected one of OK, DEGENERATE, .*got 'FINE'"),
        ("metric: true", "metric: 1", r"metric: expected true or false, got 1"),
        ("epoch_s: 10", "epoch_s: soon", r"epoch_s: expected a number, got 'soon'"),
        ("reference: cam0", "reference: [a]", r"reference: expected text"),
        ("[0, 0, 0, 1]", "[0, 0, 0]", r"cameras\.cam0\.rotation: expected 4 numbers"),
        ("[0, 0, 0, 1]", "[0, 0, 0, 2]", r"rotation: expected a unit quaternion x, y, z, w"),
        ("translation: [0, 0, 0]", "translation: 3", r"translation: expected a list"),
        (
            "translation: [0, 0, 0]",
            "translation: [0, .nan, 0]",
            r"translation\[1\]: expected a finite number",
        ),
        ("    time_offset_s: 1e-3\n", "", r"cam0\.time_offset_s is missing"),
        ("plumb_bob", "fisheye", r"model: expected one of plumb_bob, "),
        ("width: 640", "width: wide", r"width: expected a whole number"),
        ("cameras:", "cameras: 3\nx:", r"cameras: expected a mapping, got 3"),
        ("metric: true", "metric: true\nmetric: true", r"'metric' is given twice"),
        ("metric: true", "pairs: [{cameras: [a]}]\nmetric: true", r"expected two names, got 1"),
        (
            "metric: true",
            "persons: [{id: 1.5}]\nmetric: true",
            r"persons\[0\]\.id: expected a",
        ),
        ("metric: true", "metric: [1, 2", r"not valid YAML"),
        (
            "metric: true",
            "reasons: [{measured: 1}]\nmetric: true",
            r"reasons\[0\]\.code is missing",
        ),
        ("metric: true", "joint_covariance: [[1, 2]]\nmetric: true", r"expected 1 numbers"),
        *(
            ("epoch_s: 10", f"epoch_s: {value}", r"epoch_s: expected a finite number between -2147")
            for value in ("1.0e+20", ".nan", "-1.0e+12", "3e9")
        ),
        ("epoch_s: 10", f"epoch_s: 1{'0' * 400}", r"epoch_s: expected a finite number"),
        ("metric: true", "window_s: [0, 1.0e+20]\nmetric: true", r"window_s\[1\]: expected a fin"),
        ("metric: true", "window_s: [0]\nmetric: true", r"window_s: expected 2 numbers"),
        ("metric: true", "n_inliers: -1\nmetric: true", r"n_inliers: expected a whole number from"),
        ("metric: true", "n_observations: 1099511627776\nmetric: true", r"0 to 4294967295"),
        ("metric: true", "persons: [{id: -5}]\nmetric: true", r"id: expected a whole number from"),
        (
            "metric: true",
            "persons: [{id: 0, tracks: {cam0: [1099511627776]}}]\nmetric: true",
            r"tracks\.cam0\[0\]: expected a whole number from",
        ),
        ("metric: true", "metric: !!bool x", r"'x' with the tag 'tag:yaml\.org,2002:bool'"),
        *(
            ("time_offset_s: 1e-3", f"time_offset_s: {value}", r"time_offset_s: expected a finite")
            for value in (".nan", ".inf", "1.0e+300", "3e9")
        ),
        ("time_offset_s: 1e-3", "time_offset_s: 0\n    clock_skew: 2", r"clock skew between -1"),
        ("time_offset_s: 1e-3", "time_offset_s: 0\n    clock_skew: .nan", r"clock skew between"),
        ("translation: [0, 0, 0]", "translation: [1.0e+308, 0, 0]", r"expected a finite number"),
        ("k: [1, 0, 2, 0, 1, 2, 0, 0, 1]", f"k: {[0] * 9}", r"intrinsics: K is not a pinhole"),
        ("width: 640", "width: 0", r"expected an image of 1 to 100000 px, got 0 x 480"),
        ("width: 640", "width: -5", r"width: expected a whole number from 0"),
        ("d: []", "d: [0.1, 0.1, 0.1]", r"0 or 4 or 5 finite coefficients of plumb_bob"),
        ("d: []", f"d: [], r: {[0] * 9}", r"intrinsics: r is no rotation"),
        ("reference: cam0", "reference: nobody", r"one of the cameras cam0, got 'nobody'"),
        ("reference: cam0", 'frame_id: "a\\nb"\nreference: cam0', r"256 printable characters"),
        ("    rotation:", '    frame_id: "a\\eb"\n    rotation:', r"256 printable characters"),
        ("    rotation:", f"    frame_id: {'x' * 300}\n    rotation:", r"256 printable char"),
        ("metric: true", f"message: {'x' * 100_001}\nmetric: true", r"at most 100000 characters"),
        ("metric: true", "parameter_order: [a]\nmetric: true", r"has 0 rows, .* names 1"),
        ("metric: true", "metric: true\nx: &x [*x]", r"no anchor 'x' to repeat"),
    ],
)
def test_unusable_file(tmp_path: Path, before: str, after: str, message: str) -> None:
    assert before in MINIMAL
    (tmp_path / "out.yaml").write_text(MINIMAL.replace(before, after))
    with pytest.raises(InputError, match=message) as caught:
        read_result(tmp_path / "out.yaml")
    assert "\n" not in str(caught.value)
    assert "out.yaml" in str(caught.value)


def test_no_such_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        read_result(tmp_path / "out.yaml")
    with pytest.raises(InputError, match="cannot read"):
        read_result(tmp_path)
    with pytest.raises(InputError, match=r"walk\.mcap is a bag: name a result, the \.yaml file"):
        read_result(tmp_path / "walk.mcap")
    (tmp_path / "binary").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="is not a text file"):
        read_result(tmp_path / "binary")


def test_unwritable(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot write"):
        write_result(calibration([1.0], Rotation.identity()), tmp_path / "none" / "out.yaml")


def test_changed_bytes_never_give_another_error(tmp_path: Path) -> None:
    content = result_text(calibration([0.25, 1.5], Rotation.identity())).encode()
    rng = random.Random(3)
    for _ in range(60):
        changed = bytearray(content)
        for _ in range(3):
            changed[rng.randrange(len(content))] = rng.choice(b"\x00\xff:[]{}- \n'\"&*!%@`#0aZ.")
        (tmp_path / "out.yaml").write_bytes(changed)
        with contextlib.suppress(InputError):
            read_result(tmp_path / "out.yaml")


@pytest.mark.parametrize(
    "text", ["", "3", "- 1", "a: &a [*a]", "? [1]\n: 2", "2020-01-01", "&a {x: *a}"]
)
def test_other_yaml(tmp_path: Path, text: str) -> None:
    (tmp_path / "out.yaml").write_text(text)
    with pytest.raises(InputError):
        read_result(tmp_path / "out.yaml")
