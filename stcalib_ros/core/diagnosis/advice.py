"""What would help a recording, or the next one, whether it calibrates or not."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum

from stcalib_ros.core.diagnosis.examine import Diagnosis, PairFacts
from stcalib_ros.core.diagnosis.facts import CameraFacts

MIN_COVERAGE = 0.15
"""Fraction of the image. Where people cover less of it, its lens and its pose rest on a small part.
Chosen: one person who crosses the image 30 m away covers 0.1, three who walk about a room 0.4."""

MIN_COMMON = 0.8
"""Fraction of the images of a camera. Where fewer were taken while another camera recorded, the
rest is of no use, or its clock is far off. Chosen."""

MAX_GAP_S = 1.0
"""Seconds without an image from which on it is mentioned: a step of a walking person. Chosen."""

MIN_RATE_HZ = 10.0
"""Images per second from which on steps and arms are followed well. Chosen: a leg swings in 0.4 s,
and has four images then."""

MIN_SHARED_S = 10.0
"""Seconds of people's motion, summed over persons, that a camera should share with another one.
Chosen: four times what a calibration asks for (`CheckThresholds.min_shared_s`)."""


class AdviceCode(str, Enum):
    """Code of an advice; the value is what ``--json`` carries."""

    NOBODY_IN_COMMON = "NOBODY_IN_COMMON"
    RECORD_LONGER = "RECORD_LONGER"
    ONE_PARTNER = "ONE_PARTNER"
    SHARE_MORE_MOTION = "SHARE_MORE_MOTION"
    COVER_MORE_IMAGE = "COVER_MORE_IMAGE"
    RECORD_TOGETHER = "RECORD_TOGETHER"
    IMAGES_MISSING = "IMAGES_MISSING"
    MORE_IMAGES = "MORE_IMAGES"


_SENTENCES = {
    AdviceCode.NOBODY_IN_COMMON: (
        "no person was recognised both in {camera} and in another camera: let people walk where "
        "both see them"
    ),
    AdviceCode.RECORD_LONGER: (
        "no two cameras see people together for more than {value:.1f} s: record longer, with "
        "people who walk about"
    ),
    AdviceCode.ONE_PARTNER: (
        "{camera} sees the same people as {partner}, but as no other camera: let people walk where "
        "more cameras see them"
    ),
    AdviceCode.SHARE_MORE_MOTION: (
        "{camera} sees people together with {partner} for {value:.1f} s, and with any other camera "
        "for less: let people walk longer where both see them"
    ),
    AdviceCode.COVER_MORE_IMAGE: (
        "people cover only {value:.0%} of the image of {camera}: let them come nearer, and walk "
        "from side to side"
    ),
    AdviceCode.RECORD_TOGETHER: (
        "by the timestamps, only {value:.0%} of the images of {camera} were taken while another "
        "camera recorded: start all cameras before people come in, and check its clock"
    ),
    AdviceCode.IMAGES_MISSING: "{camera} has no image for {value:.1f} s: check its driver",
    AdviceCode.MORE_IMAGES: (
        "{camera} takes only {value:.1f} images per second: raise its frame rate"
    ),
}


@dataclass(frozen=True, slots=True)
class Advice:
    """What would help one camera, or all.

    Attributes
    ----------
    code : AdviceCode
    cameras : tuple of str
        The camera, and the one that it is about beside it; empty: all of them.
    value : float
        The measured number, in the unit of the sentence; fractions are of 1.
    """

    code: AdviceCode
    cameras: tuple[str, ...]
    value: float = float("nan")

    @property
    def sentence(self) -> str:
        """The advice in words."""
        camera, partner = (*self.cameras, "", "")[:2]
        return _SENTENCES[self.code].format(camera=camera, partner=partner, value=self.value)


def advise(found: Diagnosis) -> tuple[Advice, ...]:
    """Return what would help, camera by camera.

    Parameters
    ----------
    found : Diagnosis
    """
    advice = [one for camera in found.cameras for one in _of_images(camera)]
    longest_s = max((pair.shared_s for pair in found.pairs), default=0.0)
    if 0.0 < longest_s < MIN_SHARED_S:
        return (*advice, Advice(AdviceCode.RECORD_LONGER, (), longest_s))
    for camera in found.cameras:
        own = [p for p in found.pairs if camera.name in (p.camera_a, p.camera_b)]
        advice += _of_pairs(camera.name, own)
    return tuple(advice)


def _of_images(camera: CameraFacts) -> Iterator[Advice]:
    """Yield what the images of a camera lack."""
    name = (camera.name,)
    if camera.common_fraction < MIN_COMMON:
        yield Advice(AdviceCode.RECORD_TOGETHER, name, camera.common_fraction)
    if camera.longest_gap_s > MAX_GAP_S:
        yield Advice(AdviceCode.IMAGES_MISSING, name, camera.longest_gap_s)
    if camera.rate_hz < MIN_RATE_HZ:
        yield Advice(AdviceCode.MORE_IMAGES, name, camera.rate_hz)
    if camera.n_tracks and camera.coverage < MIN_COVERAGE:
        yield Advice(AdviceCode.COVER_MORE_IMAGE, name, camera.coverage)


def _of_pairs(name: str, pairs: Sequence[PairFacts]) -> Iterator[Advice]:
    """Yield what a camera lacks in common with the others."""
    matched = [pair for pair in pairs if pair.n_matches]
    if not matched:
        if pairs:
            yield Advice(AdviceCode.NOBODY_IN_COMMON, (name,))
        return
    best = max(matched, key=lambda pair: pair.shared_s)
    partner = best.camera_b if best.camera_a == name else best.camera_a
    if best.shared_s < MIN_SHARED_S:
        yield Advice(AdviceCode.SHARE_MORE_MOTION, (name, partner), best.shared_s)
    elif len(matched) == 1 and len(pairs) > 1:
        yield Advice(AdviceCode.ONE_PARTNER, (name, partner))
