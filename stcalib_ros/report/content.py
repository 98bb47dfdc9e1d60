"""What a report is made from: a recording, its calibration, and the residuals of both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from stcalib_ros.core.capture.evidence import CaptureEvidence, evidence_of
from stcalib_ros.core.capture.people import find_evidence
from stcalib_ros.core.model.calibration import Calibration, PersonAssociation
from stcalib_ros.core.model.recording import Recording
from stcalib_ros.core.options import Options
from stcalib_ros.core.reconstruction.people import found_persons
from stcalib_ros.core.reconstruction.trajectories import PersonTrajectory
from stcalib_ros.core.stages import Stages


@dataclass(frozen=True, slots=True, eq=False)
class ReportContent:
    """A calibration with everything that a report shows of it.

    Attributes
    ----------
    recording : Recording
    calibration : Calibration
    evidence : CaptureEvidence or None
        None without camera poses, or where nobody is seen by two cameras at a time.
    people : tuple of PersonTrajectory
        Everybody's joints in 3D, numbered as the persons of the calibration.
    options : Options
        That it was made with, as far as known.
    truth : Calibration or None
        Shown beside the calibration.
    from_result : bool
        The evidence was gathered again from a finished result, without the corrections of single
        stamps and keypoints that the adjustment made.
    """

    recording: Recording
    calibration: Calibration
    evidence: CaptureEvidence | None
    people: tuple[PersonTrajectory, ...] = ()
    options: Options = field(default_factory=Options)
    truth: Calibration | None = None
    from_result: bool = False


def _numbers(evidence: CaptureEvidence, persons: Sequence[PersonAssociation]) -> list[int]:
    """Return for everybody found the number of the person with the most tracks in common."""
    found = [_tracks(person) for _, person in found_persons(evidence.lifted, evidence.last)]
    shared = np.array([[len(own & _tracks(one)) for one in persons] for own in found])
    shared = shared.reshape(len(found), len(persons))
    rows, columns = linear_sum_assignment(-shared)
    pairs = zip(rows.tolist(), columns.tolist(), strict=True)
    known = {i: persons[k].person_id for i, k in pairs if shared[i, k] > 0}
    spare = max([person.person_id for person in persons], default=-1) + 1
    return [known.get(i, spare + i) for i in range(len(found))]


def _tracks(person: PersonAssociation) -> set[tuple[str, int]]:
    return {(name, track) for name, ids in person.tracks.items() for track in ids}


def content_of_stages(
    recording: Recording,
    stages: Stages,
    options: Options | None = None,
    *,
    truth: Calibration | None = None,
) -> ReportContent:
    """Return the content of the report of a calibration that has just been made."""
    evidence = evidence_of(stages)
    people = evidence.trajectories() if evidence is not None else ()
    options = options or Options()
    return ReportContent(recording, stages.calibration, evidence, people, options, truth)


def content_of_result(
    recording: Recording, calibration: Calibration, options: Options | None = None
) -> ReportContent:
    """Return the content of the report of a finished result, good or refused.

    Raises
    ------
    InputError
        Fewer than two of the calibrated cameras see anybody in the recording.
    """
    options = options or Options()
    recording = _with_lenses(recording, calibration)
    evidence = find_evidence(recording, calibration, options) if calibration.cameras else None
    people: tuple[PersonTrajectory, ...] = ()
    if evidence is not None:
        numbers = _numbers(evidence, calibration.persons)
        pairs = zip(evidence.trajectories(), numbers, strict=True)
        people = tuple(replace(person, person_id=number) for person, number in pairs)
    return ReportContent(recording, calibration, evidence, people, options, from_result=True)


def _with_lenses(recording: Recording, calibration: Calibration) -> Recording:
    """Return a recording with the lenses of a calibration, which may have been given in files."""
    lenses = {camera.name: camera.intrinsics for camera in calibration.cameras}
    cameras = []
    for camera in recording.cameras:
        own, lens = camera.intrinsics, lenses.get(camera.name, camera.intrinsics)
        same_size = (own.width, own.height) == (lens.width, lens.height)
        cameras.append(replace(camera, intrinsics=lens) if same_size else camera)
    return replace(recording, cameras=tuple(cameras))
