"""Clocks that differ by hours: what is added to stamps before offsets are searched."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import stcalib_ros as st
from stcalib_ros.core.lifting.clock_guess import AlignedClocks, with_aligned_clocks
from stcalib_ros.core.model.recording import Recording, excerpt
from stcalib_ros.core.model.rejection import RemarkCode

SCENE = st.simulate(st.SceneOptions(n_cameras=4, n_people=2, n_frames=120, seed=6))
BOOT_S = -1_759_900_000.0


def ahead(delays_s: dict[str, float], *, received: bool = False) -> Recording:
    """The scene with clocks that are ahead by so many seconds; or recorded, 50 ms later."""
    cameras = []
    for camera in SCENE.recording.cameras:
        times = camera.stamps + 0.05 if received else None
        stamps = camera.stamps + delays_s.get(camera.name, 0.0)
        cameras.append(replace(camera, stamps=stamps, received=times))
    return replace(SCENE.recording, cameras=tuple(cameras))


def aligned(recording: Recording, align: str = "auto", **options: object) -> AlignedClocks:
    return with_aligned_clocks(recording, replace(st.Options(align=align), **options))  # type: ignore[arg-type]


def test_overlapping_stamps_stay_as_they_are() -> None:
    for recording in (SCENE.recording, ahead({"cam1": 7.0})):
        found = aligned(recording)
        assert found.recording is recording
        assert (found.shifts_s, found.remarks) == ({}, ())


def test_a_camera_of_another_epoch_is_aligned_by_its_start() -> None:
    found = aligned(ahead({"cam1": BOOT_S}))
    starts = [camera.stamps[0] for camera in found.recording.cameras]
    assert starts[1] == pytest.approx(min(starts[0], *starts[2:]), abs=1e-6)
    assert found.shifts_s.keys() == {"cam1"}
    (remark,) = found.remarks
    assert (remark.code, remark.cameras) == (RemarkCode.CLOCKS_ALIGNED, ("cam1",))
    assert remark.values["seconds"] == found.shifts_s["cam1"]
    assert "started together" in remark.detail


def test_cameras_of_one_clock_stay_together() -> None:
    """Also if the reference is the only one of its clock."""
    found = aligned(ahead({"cam0": BOOT_S}))
    assert found.shifts_s.keys() == {"cam1", "cam2", "cam3"}
    assert len(set(found.shifts_s.values())) == 1
    of_last = aligned(ahead({"cam0": BOOT_S}), reference="cam3")
    assert of_last.shifts_s.keys() == {"cam0"}


def test_the_recorder_knows_better_than_the_starts() -> None:
    """A camera that began a second later."""
    recording = ahead({"cam1": BOOT_S}, received=True)
    begin_s = float(recording.cameras[1].stamps[30])
    cut = excerpt(recording, begin_s, np.inf).cameras[1]
    assert len(cut.stamps) == 90
    cameras = (recording.cameras[0], cut, *recording.cameras[2:])
    found = aligned(replace(recording, cameras=cameras))
    assert found.shifts_s["cam1"] == pytest.approx(-BOOT_S, abs=1e-6)
    assert "received" in found.remarks[0].detail


def test_what_was_recorded_at_another_time_is_not_aligned() -> None:
    recording = ahead({}, received=True)
    later = replace(
        recording.cameras[1],
        stamps=recording.cameras[1].stamps + 3600.0,
        received=recording.cameras[1].stamps + 3600.05,
    )
    cameras = (recording.cameras[0], later, *recording.cameras[2:])
    assert aligned(replace(recording, cameras=cameras)).shifts_s == {}


def test_times_of_receipt_that_are_copies_of_stamps_say_nothing() -> None:
    recording = ahead({"cam1": BOOT_S})
    copies = tuple(replace(c, received=c.stamps) for c in recording.cameras)
    assert aligned(replace(recording, cameras=copies)).shifts_s.keys() == {"cam1"}


def test_what_is_asked_for() -> None:
    recording = ahead({"cam1": BOOT_S, "cam2": 1.5})
    assert aligned(recording, "stamps").recording is recording
    assert aligned(recording, offset_range_s=0.0).recording is recording
    starts = aligned(recording, "starts", reference="cam2")
    begins = [camera.stamps[0] for camera in starts.recording.cameras]
    assert begins == pytest.approx([recording.cameras[2].stamps[0]] * 4, abs=1e-6)
    assert {remark.cameras for remark in starts.remarks} == {("cam0",), ("cam1",), ("cam3",)}
    others = aligned(recording, "-7")
    assert others.shifts_s == {"cam1": -7.0, "cam2": -7.0, "cam3": -7.0}
    assert others.remarks == ()
    assert aligned(recording, f"cam1={-BOOT_S}").shifts_s == {"cam1": -BOOT_S}
    with pytest.raises(st.InputError, match="align: no camera 'cam9' in the recording: there are"):
        aligned(recording, "cam9=1")


def test_offsets_of_the_result_are_the_full_ones() -> None:
    """The reference has time since boot, and so the others have all of the difference."""
    cameras = ahead({"cam0": BOOT_S}).cameras[:3]
    found = st.calibrate(replace(SCENE.recording, cameras=cameras), st.Options(offset_range_s=0.5))
    assert found.status is st.Status.OK, found.message
    assert RemarkCode.CLOCKS_ALIGNED in {remark.code for remark in found.remarks}
    assert found.epoch_s - SCENE.truth.epoch_s == pytest.approx(BOOT_S, abs=2.0)
    for camera, true in zip(found.cameras[1:], SCENE.truth.cameras[1:3], strict=True):
        assert camera.time_offset_s - true.time_offset_s == pytest.approx(BOOT_S, abs=0.01)
        assert camera.time_offset_stddev_s < 0.01
