"""What ``stcalib doctor`` prints: tables that fit into 80 columns, or one JSON object."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Any

from stcalib_ros.commands.terminal import table
from stcalib_ros.core.diagnosis.advice import advise
from stcalib_ros.core.diagnosis.examine import CameraFit, Diagnosis, PairFacts
from stcalib_ros.core.diagnosis.facts import CameraFacts
from stcalib_ros.core.model.gathered_text import as_sentence
from stcalib_ros.core.model.lens_knowledge import LensKnowledge
from stcalib_ros.core.model.rejection_text import labelled, left_out_sentences, whole_sentences
from stcalib_ros.io.reasons import plain_rejection, plain_remark
from stcalib_ros.wording import count

_WIDTH = 80
"""Columns of a terminal as it opens."""

_NAME = 20
"""Characters of a camera's name that a table shows."""

_MOST_PAIRS = 28
"""Rows, pairs of eight cameras. Of more cameras, the best pair of each is shown."""


def diagnosis_text(found: Diagnosis, source: str, warnings: Sequence[str] = ()) -> str:
    """Describe a recording, and what is expected of it, for a person to read.

    Parameters
    ----------
    found : Diagnosis
    source : str
        Where the recording is from.
    warnings : sequence of str
        What was odd when it was read.
    """
    lasts_s = max(c.end_s for c in found.cameras) - min(c.begin_s for c in found.cameras)
    n_images = sum(camera.n_images for camera in found.cameras)
    parts = [
        f"{source}: {count(len(found.cameras), 'camera')}, {lasts_s:.1f} s, {n_images} images",
        _images(found.cameras),
        _people(found.cameras),
    ]
    if found.pairs:
        parts.append(_pairs(found.pairs))
    parts += _list("Corrected or noticed:", [*warnings, *whole_sentences(found.remarks, ())])
    left_out = [(camera.name, camera.rejection) for camera in found.uncalibrated]
    parts += _list("Left out:", left_out_sentences(left_out, codes=True))
    parts += _list("In doubt:", [_doubt(name, found.fits[name]) for name in found.doubtful])
    parts += _list(
        "What would help:", [as_sentence(one.sentence, one.cameras) for one in advise(found)]
    )
    parts.append(_filled(verdict(found), ""))
    return "\n\n".join(parts)


def verdict(found: Diagnosis) -> str:
    """Say in a sentence what is expected."""
    if found.unusable:
        return f"Unusable: {found.unusable}"
    if not found.will_calibrate:
        why = "; ".join(f"{one.reason.value}: {labelled(one)}" for one in found.rejections)
        return f"Prediction: will NOT calibrate. {why}"
    n, n_all = len(found.calibrated), len(found.cameras)
    return (
        f"Prediction: will calibrate, {n} of {n_all} cameras ({', '.join(found.calibrated)}). "
        "This is a quick check: `stcalib calibrate` also finds what it cannot see, such as a "
        "camera that was moved, or a clock that was set, during the recording."
    )


def diagnosis_plain(found: Diagnosis, warnings: Sequence[str] = ()) -> dict[str, Any]:
    """Return a diagnosis as plain data; NaN where there is no number."""
    return {
        "will_calibrate": found.will_calibrate,
        "prediction": verdict(found),
        "calibrated": list(found.calibrated),
        "doubtful": list(found.doubtful),
        "reasons": [plain_rejection(one, labelled(one)) for one in found.rejections],
        "uncalibrated": {
            one.name: plain_rejection(one.rejection, one.reason) for one in found.uncalibrated
        },
        "unusable": found.unusable,
        "remarks": [plain_remark(one) for one in found.remarks],
        "warnings": list(warnings),
        "advice": [
            {"code": one.code.value, "message": one.sentence, "cameras": list(one.cameras)}
            for one in advise(found)
        ],
        "cameras": [{**asdict(one), "lens": one.lens.value} for one in found.cameras],
        "fits": {name: asdict(fit) for name, fit in found.fits.items()},
        "pairs": [asdict(one) for one in found.pairs],
    }


def _images(cameras: Sequence[CameraFacts]) -> str:
    """Images and clocks, a row for each camera."""
    first_s = min(camera.begin_s for camera in cameras)
    head = ("camera", "images", "Hz", "longest gap", "starts", "lasts", "with others", "lens")
    rows = [
        (
            camera.name[:_NAME],
            str(camera.n_images),
            f"{camera.rate_hz:.1f}",
            _number(camera.longest_gap_s, ".2f", " s"),
            f"{camera.begin_s - first_s:+.2f} s",
            f"{camera.end_s - camera.begin_s:.1f} s",
            f"{camera.common_fraction:.0%}",
            _lens(camera),
        )
        for camera in cameras
    ]
    return table([head, *rows])


def _lens(camera: CameraFacts) -> str:
    is_missing = camera.lens is LensKnowledge.GIVEN and not camera.has_intrinsics
    return "missing" if is_missing else camera.lens.value


def _people(cameras: Sequence[CameraFacts]) -> str:
    """People and their keypoints, a row for each camera."""
    head = ("camera", "layout", "people", "tracks", "ids kept", "covered", "keypoints", "2D/3D")
    rows = [
        (
            camera.name[:_NAME],
            camera.layout[:_NAME],
            f"{camera.persons:.1f}",
            str(camera.n_tracks),
            _number(camera.continued, ".0%"),
            f"{camera.coverage:.0%}",
            f"{camera.scored:.0%}",
            _number(camera.projection, ".2f"),
        )
        for camera in cameras
    ]
    return table([head, *rows])


def _pairs(pairs: Sequence[PairFacts]) -> str:
    """People that two cameras share, a row for each pair."""
    head = ("cameras", "tracks matched", "seen together", "clock difference", "mismatch")
    shown = pairs if len(pairs) <= _MOST_PAIRS else list(_best_of_each(pairs))
    rows = [
        (
            f"{pair.camera_a[:_NAME]} {pair.camera_b[:_NAME]}",
            str(pair.n_matches or "none"),
            f"{pair.shared_s:.1f} s" if pair.n_matches else "-",
            _number(pair.lag_s, "+.3f", " s"),
            _number(pair.epipolar_px, ".1f", " px"),
        )
        for pair in shown
    ]
    return table([head, *rows])


def _best_of_each(pairs: Sequence[PairFacts]) -> Iterator[PairFacts]:
    """Yield the pair of each camera that shares most, each pair once."""
    best: dict[str, PairFacts] = {}
    for pair in sorted(pairs, key=lambda pair: pair.shared_s):
        best[pair.camera_a] = best[pair.camera_b] = pair
    yield from (pair for pair in pairs if pair in best.values())


def _number(value: float, form: str, unit: str = "") -> str:
    return f"{value:{form}}{unit}" if math.isfinite(value) else "-"


def _doubt(name: str, fit: CameraFit) -> str:
    return (
        f"{name}: {fit.fitting:.0%} of its keypoints of people whom other cameras see fit those "
        f"cameras, and {fit.explained:.0%} of all its keypoints: it may see other people, or the "
        "camera was moved or its clock set during the recording"
    )


def _list(head: str, texts: Sequence[str]) -> list[str]:
    """Return a headed list as one part; nothing if there is none."""
    return ["\n".join([head, *(_filled(text, "- ") for text in texts)])] if texts else []


def _filled(text: str, mark: str) -> str:
    return textwrap.fill(
        text,
        _WIDTH,
        initial_indent=mark,
        subsequent_indent=" " * len(mark),
        break_long_words=False,
        break_on_hyphens=False,
    )
