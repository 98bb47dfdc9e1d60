"""Rejections and remarks as plain data, for result files and ``--json``; and back."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from stcalib_ros.core.model.calibration import Calibration, Status, UncalibratedCamera
from stcalib_ros.core.model.rejection import Rejection, RejectionReason, Remark, RemarkCode
from stcalib_ros.core.model.rejection_text import labelled, remark_sentence
from stcalib_ros.io.yaml_entries import Entry


def plain_reasons(calibration: Calibration) -> dict[str, Any]:
    """Return the entries ``uncalibrated``, ``reasons`` and ``remarks`` of a result file."""
    return {
        "uncalibrated": {
            camera.name: plain_rejection(camera.rejection, camera.reason)
            for camera in calibration.uncalibrated
        },
        "reasons": [plain_rejection(one, labelled(one)) for one in calibration.rejections],
        "remarks": [plain_remark(remark) for remark in calibration.remarks],
    }


def plain_remark(remark: Remark) -> dict[str, Any]:
    """Return a remark by code, sentence and numbers."""
    return {
        "code": remark.code.value,
        "message": remark_sentence(remark),
        "cameras": list(remark.cameras),
        "values": _plain_values(remark.values),
        **({"detail": remark.detail} if remark.detail else {}),
    }


def read_uncalibrated(top: Entry) -> tuple[UncalibratedCamera, ...]:
    """Read the entry ``uncalibrated`` of a result file; none if it is missing."""
    entries = top.get("uncalibrated", {}).items()
    return tuple(UncalibratedCamera(name, _rejection(entry)) for name, entry in entries)


def read_rejections(top: Entry, status: Status, message: str) -> tuple[Rejection, ...]:
    """Read the entry ``reasons``; where there is none, the message of a failure is the reason."""
    missing = [] if status is Status.OK else [message]
    return tuple(_rejection(entry) for entry in top.get("reasons", missing).elements())


def read_remarks(top: Entry) -> tuple[Remark, ...]:
    """Read the entry ``remarks``, without those whose code only another version knows."""
    return tuple(
        Remark(
            RemarkCode(code),
            _names(entry.get("cameras", [])),
            _values(entry),
            entry.get("detail", "").text(),
        )
        for entry in top.get("remarks", []).elements()
        if (code := entry.get("code").text()) in RemarkCode.__members__
    )


def plain_rejection(rejection: Rejection, message: str) -> dict[str, Any]:
    """Return a rejection by code and numbers; what is empty is left out."""
    numbers = {"measured": float(rejection.measured), "limit": float(rejection.limit)}
    optional = {
        "unit": rejection.unit,
        "cameras": list(rejection.cameras),
        "others": list(rejection.others),
        "values": _plain_values(rejection.values),
        "detail": rejection.detail,
    }
    return {
        "code": rejection.reason.value,
        "message": message,
        **{name: value for name, value in numbers.items() if not math.isnan(value)},
        **{name: value for name, value in optional.items() if value},
    }


def _plain_values(values: Mapping[str, float]) -> dict[str, float]:
    return {name: float(value) for name, value in values.items()}


def _rejection(entry: Entry) -> Rejection:
    """Read a rejection; of a version with other codes, its sentence is what is left of it.

    That sentence names its cameras already.
    """
    if isinstance(entry.value, str):  # files of before there were codes
        return Rejection(RejectionReason.UNSPECIFIED, detail=entry.value)
    code = entry.get("code").text()
    known = code in RejectionReason.__members__
    return Rejection(
        reason=RejectionReason(code) if known else RejectionReason.UNSPECIFIED,
        cameras=_names(entry.get("cameras", [])) if known else (),
        measured=entry.get("measured", math.nan).number(),
        limit=entry.get("limit", math.nan).number(),
        unit=entry.get("unit", "").text(),
        others=_names(entry.get("others", [])) if known else (),
        values=_values(entry),
        detail=entry.get("detail" if known else "message", "").text(),
    )


def _names(entry: Entry) -> tuple[str, ...]:
    return tuple(e.text() for e in entry.elements())


def _values(entry: Entry) -> dict[str, float]:
    return {name: value.number() for name, value in entry.get("values", {}).items()}
