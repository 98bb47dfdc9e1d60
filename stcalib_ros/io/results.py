"""The result file, ``format: stcalib/1``; truth files have the same form."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from stcalib_ros.core.errors import CalibrationError, InputError
from stcalib_ros.core.geometry.so3 import quaternion_from_matrix
from stcalib_ros.core.model.arrays import Float64Array
from stcalib_ros.core.model.calibration import (
    Calibration,
    CameraCalibration,
    PairResidual,
    PersonAssociation,
    Status,
)
from stcalib_ros.core.model.lens_knowledge import LensKnowledge, LensStddev, lens_knowledge
from stcalib_ros.core.model.recording import Intrinsics
from stcalib_ros.io.files import write_text
from stcalib_ros.io.json_files import json_text
from stcalib_ros.io.plausible import require_lens, require_name
from stcalib_ros.io.reasons import (
    plain_reasons,
    read_rejections,
    read_remarks,
    read_uncalibrated,
)
from stcalib_ros.io.yaml_entries import Entry
from stcalib_ros.io.yaml_files import read_yaml

FORMAT = "stcalib/1"

_HEAD = """\
# rotation (quaternion x, y, z, w) and translation are T_ref_cam, the pose of the camera's optical
# frame (x right, y down, z forward) in {frame}: x_ref = R x_cam + translation.
# Lengths: {unit}.
# Clocks: t_ref = t_cam + time_offset_s + clock_skew * (t_cam - epoch_s), seconds.
"""
_Dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)  # the same text in a fifth of the time
_UNITS = {True: "metres", False: "the distance between the first two cameras is 1"}
_FRAMES = {True: "frame_id, z up, floor at 0", False: "that of the reference camera"}


def write_result(calibration: Calibration, path: Path | str) -> None:
    """Write a calibration, whole or not at all.

    Parameters
    ----------
    calibration : Calibration
    path : Path or str
        An existing file is replaced.

    Raises
    ------
    InputError
        The file cannot be written.

    Examples
    --------
    >>> import stcalib_ros as st
    >>> st.write_result(st.simulate().truth, "truth.yaml")
    """
    write_text(Path(path), result_text(calibration))


def result_text(calibration: Calibration) -> str:
    """Text of the result file of a calibration."""
    body = yaml.dump(
        _plain(calibration),
        Dumper=_Dumper,
        sort_keys=False,
        default_flow_style=None,
        width=110,
        allow_unicode=True,
    )
    frame = _FRAMES[bool(calibration.frame_id)]
    return _HEAD.format(frame=frame, unit=_UNITS[calibration.metric]) + body


def result_json(calibration: Calibration) -> str:
    """Return a calibration as one JSON object in a line, with the entries of the result file."""
    return json_text(_plain(calibration))


def read_usable_result(path: Path) -> Calibration:
    """Read a result file, as `read_result`, to use it.

    Raises
    ------
    InputError
        As `read_result`.
    CalibrationError
        It is of a calibration that was refused.
    """
    calibration = read_result(path)
    if calibration.status is not Status.OK:
        raise CalibrationError(
            f"{path} is not to be used ({calibration.status.name}): {calibration.message}"
        )
    return calibration


def read_result(path: Path | str) -> Calibration:
    """Read a result or truth file.

    Of a camera, ``rotation``, ``translation``, ``time_offset_s`` and ``intrinsics`` must be there;
    what else is missing is NaN, empty or none, and ``window_s`` is ``epoch_s``.

    Parameters
    ----------
    path : Path or str

    Raises
    ------
    InputError
        The file cannot be read or an entry is missing or unusable; the message names it.

    Examples
    --------
    >>> import stcalib_ros as st
    >>> st.write_result(st.simulate().truth, "truth.yaml")
    >>> st.read_result("truth.yaml").reference
    'cam0'
    """
    if Path(path).suffix.lower() in (".mcap", ".db3"):
        raise InputError(
            f"{path} is a bag: name a result, the .yaml file that was calibrated from it"
        )
    top = Entry(read_yaml(Path(path)), str(path), ": ")
    version = top.get("format").value
    if version != FORMAT:
        raise InputError(f"{path}: format is {version!r}; this version reads {FORMAT}")
    epoch_s = top.get("epoch_s").time()
    status, message = top.get("status").status(), top.get("message", "").text()
    calibration = Calibration(
        status=status,
        message=message,
        reference=top.get("reference").text(),
        metric=top.get("metric").boolean(),
        epoch_s=epoch_s,
        window_s=_window(top.get("window_s", [epoch_s, epoch_s])),
        cameras=tuple(_camera(n, e) for n, e in top.get("cameras").items()),
        uncalibrated=read_uncalibrated(top),
        persons=tuple(_person(e) for e in top.get("persons", []).elements()),
        pairs=tuple(_pair(e) for e in top.get("pairs", []).elements()),
        reprojection_rms_px=top.get("reprojection_rms_px", np.nan).number(),
        n_observations=top.get("n_observations", 0).count(),
        n_inliers=top.get("n_inliers", 0).count(),
        joint_covariance=_square(top.get("joint_covariance", [])),
        parameter_order=tuple(e.text() for e in top.get("parameter_order", []).elements()),
        frame_id=_frame(top),
        scale_stddev=top.get("scale_stddev", np.nan).number(),
        rejections=read_rejections(top, status, message),
        remarks=read_remarks(top),
    )
    _require_consistent(calibration, path)
    return calibration


def _require_consistent(calibration: Calibration, path: Path | str) -> None:
    """Demand what holds between entries; what was refused may lack its reference."""
    names = [camera.name for camera in calibration.cameras]
    if calibration.status is Status.OK and calibration.reference not in names:
        raise InputError(
            f"{path}: reference: expected one of the cameras {', '.join(names) or '(none)'}, got "
            f"{calibration.reference!r}"
        )
    size, n_names = len(calibration.joint_covariance), len(calibration.parameter_order)
    if size != n_names:
        raise InputError(
            f"{path}: joint_covariance has {size} rows, parameter_order names {n_names}"
        )


def _plain(calibration: Calibration) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "status": calibration.status.name,
        "message": calibration.message,
        "reference": calibration.reference,
        **({"frame_id": calibration.frame_id} if calibration.frame_id else {}),
        "metric": bool(calibration.metric),
        **(
            {"scale_stddev": float(scale)} if np.isfinite(scale := calibration.scale_stddev) else {}
        ),
        "epoch_s": float(calibration.epoch_s),
        "window_s": [float(t) for t in calibration.window_s],
        "reprojection_rms_px": float(calibration.reprojection_rms_px),
        "n_observations": int(calibration.n_observations),
        "n_inliers": int(calibration.n_inliers),
        "cameras": {c.name: _plain_camera(c) for c in calibration.cameras},
        **plain_reasons(calibration),
        "persons": [_plain_person(p) for p in calibration.persons],
        "pairs": [
            {
                "cameras": [p.camera_a, p.camera_b],
                "n_matches": int(p.n_matches),
                "median_angle_rad": float(p.median_angle_rad),
                "epipolar_rms_px": float(p.epipolar_rms_px),
            }
            for p in calibration.pairs
        ],
        "parameter_order": list(calibration.parameter_order),
        "joint_covariance": calibration.joint_covariance.tolist(),
    }


def _plain_camera(camera: CameraCalibration) -> dict[str, Any]:
    return {
        "frame_id": camera.frame_id,
        "rotation": quaternion_from_matrix(camera.R_ref_cam).tolist(),
        "translation": camera.t_ref_cam.tolist(),
        "covariance": camera.covariance.ravel().tolist(),
        "time_offset_s": float(camera.time_offset_s),
        "time_offset_stddev_s": float(camera.time_offset_stddev_s),
        "clock_skew": float(camera.clock_skew),
        "clock_skew_stddev": float(camera.clock_skew_stddev),
        **_plain_shutter(camera),
        "intrinsics": _plain_lens(camera.intrinsics) | _plain_knowledge(camera),
    }


def _plain_shutter(camera: CameraCalibration) -> dict[str, float]:
    """Line time of a rolling shutter; nothing where all rows are taken at once."""
    if camera.line_time_s == 0.0 and np.isnan(camera.line_time_stddev_s):
        return {}
    return {
        "line_time_s": float(camera.line_time_s),
        "line_time_stddev_s": float(camera.line_time_stddev_s),
    }


def _plain_lens(lens: Intrinsics) -> dict[str, Any]:
    plain = {
        "width": int(lens.width),
        "height": int(lens.height),
        "model": lens.model.value,
        "k": lens.K.ravel().tolist(),
        "d": lens.D.tolist(),
    }
    if not np.array_equal(lens.R_rect_cam, np.eye(3)):
        plain["r"] = lens.R_rect_cam.ravel().tolist()
    return plain


def _plain_knowledge(camera: CameraCalibration) -> dict[str, Any]:
    """What estimated intrinsics were worth before, and how well they are known."""
    if camera.lens_knowledge is LensKnowledge.GIVEN:
        return {}
    plain: dict[str, Any] = {"knowledge": camera.lens_knowledge.value}
    if (stddev := camera.lens_stddev) is not None:
        plain["stddev"] = {
            "focal_px": float(stddev.focal_px),
            "cx_px": float(stddev.cx_px),
            "cy_px": float(stddev.cy_px),
            "radial": [float(value) for value in stddev.radial],
        }
    return plain


def _plain_person(person: PersonAssociation) -> dict[str, Any]:
    return {
        "id": int(person.person_id),
        "tracks": {name: [int(i) for i in ids] for name, ids in person.tracks.items()},
        "reprojection_rms_px": float(person.reprojection_rms_px),
        "margin": float(person.margin),
    }


def _camera(name: str, entry: Entry) -> CameraCalibration:
    lens = entry.get("intrinsics")
    knowledge = lens.get("knowledge", LensKnowledge.GIVEN.value)
    return CameraCalibration(
        name=require_name(name, f"{entry.path}: name"),
        frame_id=entry.get("frame_id", f"{name}_optical_frame").name(),
        intrinsics=_lens(lens),
        R_ref_cam=entry.get("rotation").rotation(),
        t_ref_cam=entry.get("translation").position(),
        covariance=entry.get("covariance", [np.nan] * 36).numbers(36, finite=False).reshape(6, 6),
        time_offset_s=entry.get("time_offset_s").time(),
        time_offset_stddev_s=entry.get("time_offset_stddev_s", np.nan).number(),
        clock_skew=entry.get("clock_skew", 0.0).skew(),
        clock_skew_stddev=entry.get("clock_skew_stddev", np.nan).number(),
        line_time_s=entry.get("line_time_s", 0.0).time(),
        line_time_stddev_s=entry.get("line_time_stddev_s", np.nan).number(),
        lens_knowledge=lens_knowledge(knowledge.text(), knowledge.path),
        lens_stddev=_lens_stddev(lens.get("stddev", {})),
    )


def _lens_stddev(entry: Entry) -> LensStddev | None:
    if not entry.items():
        return None
    return LensStddev(
        focal_px=entry.get("focal_px").number(),
        cx_px=entry.get("cx_px").number(),
        cy_px=entry.get("cy_px").number(),
        radial=tuple(entry.get("radial", []).numbers(finite=False).tolist()),
    )


def _lens(entry: Entry) -> Intrinsics:
    lens = Intrinsics(
        width=entry.get("width").count(),
        height=entry.get("height").count(),
        model=entry.get("model").lens_model(),
        K=entry.get("k").numbers(9).reshape(3, 3),
        D=entry.get("d").numbers(),
        R_rect_cam=entry.get("r", np.eye(3).ravel().tolist()).numbers(9).reshape(3, 3),
    )
    return require_lens(lens, entry.path)


def _person(entry: Entry) -> PersonAssociation:
    return PersonAssociation(
        person_id=entry.get("id").count(),
        tracks={
            name: tuple(e.count() for e in ids.elements())
            for name, ids in entry.get("tracks").items()
        },
        reprojection_rms_px=entry.get("reprojection_rms_px", np.nan).number(),
        margin=entry.get("margin", np.inf).number(),
    )


def _pair(entry: Entry) -> PairResidual:
    cameras = entry.get("cameras").elements()
    if len(cameras) != 2:
        raise InputError(f"{entry.path}.cameras: expected two names, got {len(cameras)}")
    return PairResidual(
        camera_a=cameras[0].text(),
        camera_b=cameras[1].text(),
        n_matches=entry.get("n_matches").count(),
        median_angle_rad=entry.get("median_angle_rad", np.nan).number(),
        epipolar_rms_px=entry.get("epipolar_rms_px", np.nan).number(),
    )


def _frame(top: Entry) -> str:
    entry = top.get("frame_id", "")
    return entry.name() if entry.text() else ""


def _window(entry: Entry) -> tuple[float, float]:
    first, last = entry.elements_of(2)
    return first.time(), last.time()


def _square(entry: Entry) -> Float64Array:
    rows = entry.elements()
    out = np.array([row.numbers(len(rows), finite=False) for row in rows], dtype=np.float64)
    return out.reshape(len(rows), len(rows))
