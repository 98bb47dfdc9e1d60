"""Lenses that are not known: what is assumed, and what is said where they should be known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.geometry.lens import bearings
from stcalib_ros.core.lifting.assumed_lenses import lens_by_view, with_assumed_lenses
from stcalib_ros.core.lifting.input_screening import screen_input
from stcalib_ros.core.model.lens_knowledge import LensKnowledge
from stcalib_ros.core.model.recording import (
    Intrinsics,
    LensModel,
    Recording,
    unknown_intrinsics,
)
from stcalib_ros.core.model.rejection import RejectionReason, RemarkCode
from stcalib_ros.core.options import LensOptions, Options, RegistrationOptions
from stcalib_ros.core.synthetic import SceneOptions, simulate

RECORDING = simulate(SceneOptions(n_cameras=3, n_frames=60)).recording
UNKNOWN = unknown_intrinsics(1920, 1080)


def with_lenses(lenses: dict[int, Intrinsics], recording: Recording = RECORDING) -> Recording:
    cameras = enumerate(recording.cameras)
    return replace(
        recording,
        cameras=tuple(replace(c, intrinsics=lenses.get(k, c.intrinsics)) for k, c in cameras),
    )


def test_given_lenses_stay_as_they_are() -> None:
    found = with_assumed_lenses(RECORDING, Options())
    assert (found.faults, found.remarks) == ({}, ())
    for ours, given in zip(found.recording.cameras, RECORDING.cameras, strict=True):
        assert ours.intrinsics is given.intrinsics
        assert ours.lens_knowledge is LensKnowledge.GIVEN


@pytest.mark.parametrize("lens", [UNKNOWN, RECORDING.cameras[0].intrinsics])
def test_of_an_unknown_lens_only_the_size_of_the_image_is_used(lens: Intrinsics) -> None:
    found = with_assumed_lenses(with_lenses({0: lens}), Options(intrinsics="unknown"))
    first = found.recording.cameras[0].intrinsics
    np.testing.assert_allclose(first.K, [[1536, 0, 959.5], [0, 1536, 539.5], [0, 0, 1]])
    (remark,) = found.remarks
    assert (remark.code, remark.cameras) == (RemarkCode.LENS_ASSUMED, ("cam0", "cam1", "cam2"))
    assert remark.values["view_deg"] == pytest.approx(64.0, abs=0.1)


def test_a_camera_on_its_side_has_the_same_lens() -> None:
    upright = with_assumed_lenses(
        with_lenses({0: unknown_intrinsics(1080, 1920)}), Options(intrinsics="unknown")
    )
    K = upright.recording.cameras[0].intrinsics.K
    np.testing.assert_allclose(K, [[1536, 0, 539.5], [0, 1536, 959.5], [0, 0, 1]])


def test_a_part_of_a_sensor_looks_through_the_middle_of_the_sensor() -> None:
    part = replace(unknown_intrinsics(400, 300), sensor=(-200.0, -100.0, 1000.0, 600.0))
    found = with_assumed_lenses(with_lenses({0: part}), Options(intrinsics="unknown"))
    K = found.recording.cameras[0].intrinsics.K
    np.testing.assert_allclose(K, [[800, 0, 299.5], [0, 800, 199.5], [0, 0, 1]])


@pytest.mark.parametrize("view_deg", [5.0, 60.0, 109.0, 111.0, 180.0])
def test_a_field_of_view_is_the_angle_between_the_edges(view_deg: float) -> None:
    lens = lens_by_view(UNKNOWN, view_deg)
    wide = view_deg > 110.0
    assert lens.model is (LensModel.EQUIDISTANT if wide else LensModel.PLUMB_BOB)
    half = 0.5 * np.radians(view_deg)
    edge = lens.K[0, 2] + 960.0
    if view_deg < 175.0:
        x, _ = bearings(np.array([[edge, lens.K[1, 2]]]), lens)
        np.testing.assert_allclose(np.arctan(x[0]), [half, 0.0], atol=1e-9)
    else:
        assert (edge - lens.K[0, 2]) / lens.K[0, 0] == pytest.approx(half)


@pytest.mark.parametrize("intrinsics", ["given", "refine"])
def test_a_lens_that_should_be_known_is_the_fault_of_its_camera(intrinsics: str) -> None:
    screened = screen_input(with_lenses({1: UNKNOWN}), Options(intrinsics=intrinsics))
    assert {n: why.reason for n, why in screened.faults.items()} == {
        "cam1": RejectionReason.LENS_UNKNOWN
    }
    assert screened.recording.cameras[1].tracks == ()
    assert np.isfinite(screened.recording.cameras[1].intrinsics.K).all()


def test_where_no_lens_is_known_the_input_is_unusable() -> None:
    with pytest.raises(
        InputError, match=r"^cam0, cam1, cam2: the lens .* \(--intrinsics unknown\)"
    ):
        screen_input(with_lenses(dict.fromkeys(range(3), UNKNOWN)), Options())


def test_one_camera_is_worth_something_else_than_the_others() -> None:
    cameras = list(with_lenses({1: UNKNOWN}).cameras)
    cameras[1] = replace(cameras[1], lens_knowledge=LensKnowledge.UNKNOWN)
    screened = screen_input(Recording(tuple(cameras), RECORDING.epoch_ns), Options())
    assert screened.faults == {}
    worth = [c.lens_knowledge for c in screened.recording.cameras]
    assert worth == [LensKnowledge.GIVEN, LensKnowledge.UNKNOWN, LensKnowledge.GIVEN]
    assert [r.cameras for r in screened.remarks if r.code is RemarkCode.LENS_ASSUMED] == [("cam1",)]


def grouped(*groups: str, **changes: object) -> Recording:
    cameras = [replace(c, lens_group=g) for c, g in zip(RECORDING.cameras, groups, strict=True)]
    cameras[1] = replace(cameras[1], **changes)  # type: ignore[arg-type]
    return Recording(tuple(cameras), RECORDING.epoch_ns)


def test_cameras_with_one_lens() -> None:
    shared = Options(intrinsics="unknown", lens=LensOptions(shared=True))
    assert (
        len({c.lens_group for c in with_assumed_lenses(RECORDING, shared).recording.cameras}) == 1
    )
    own = with_assumed_lenses(grouped("a", "a", ""), Options()).recording
    assert [c.lens_group for c in own.cameras] == ["a", "a", ""]
    small = grouped("a", "a", "", intrinsics=unknown_intrinsics(640, 480))
    with pytest.raises(InputError, match=r"cam0 and cam1 .*\(a\), .*1920 x 1080 and 640 x 480 px"):
        with_assumed_lenses(small, Options(intrinsics="unknown"))
    with pytest.raises(InputError, match=r"cam0 and cam1 .*, but .* are given and refine"):
        with_assumed_lenses(grouped("a", "a", "", lens_knowledge=LensKnowledge.REFINE), Options())


def test_the_method_of_the_paper_takes_lenses_as_they_are() -> None:
    options = Options(registration=RegistrationOptions(method="vmf"))
    with pytest.raises(InputError, match=r"intrinsics of cam1 are not given: registration.method"):
        with_assumed_lenses(grouped("", "", "", lens_knowledge=LensKnowledge.UNKNOWN), options)
