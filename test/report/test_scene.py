"""What the 3D view is made of: the cameras and people of the calibration, small enough to send."""

from __future__ import annotations

import base64
import dataclasses
import json
from typing import Any

import numpy as np
import pytest

from stcalib_ros.report.content import ReportContent
from stcalib_ros.report.room import Room, make_room
from stcalib_ros.report.scene import enlargement, scene_data, scene_json


@pytest.fixture(scope="module")
def room(report_content: ReportContent) -> Room:
    return make_room(report_content.calibration, report_content.people, report_content.truth)


@pytest.fixture(scope="module")
def data(report_content: ReportContent, room: Room) -> dict[str, Any]:
    return scene_data(report_content, room)


def positions(data: dict[str, Any], person: dict[str, Any]) -> np.ndarray:
    values = np.frombuffer(base64.b64decode(person["data"]), "<i2").astype(float)
    values[values == -32768] = np.nan
    return values.reshape(-1, person["n_joints"], 3) * data["resolution"]


def test_cameras_stand_where_the_room_has_them(data: dict[str, Any], room: Room) -> None:
    assert [camera["name"] for camera in data["cameras"]] == ["cam0", "cam1", "cam2"]
    for drawn, camera in zip(data["cameras"], room.cameras, strict=True):
        assert drawn["centre"] == pytest.approx(camera.centre.tolist())
        middle = np.mean(drawn["corners"], axis=0) - camera.centre
        assert middle / np.linalg.norm(middle) @ camera.R_room_cam[:, 2] > 0.999
    assert len(data["true_cameras"]) == 3


def test_people_are_where_they_were_triangulated(
    data: dict[str, Any], report_content: ReportContent, room: Room
) -> None:
    begin = min(path.times_s[0] for path in report_content.people)
    for drawn, person, path in zip(data["people"], room.people, report_content.people, strict=True):
        shown = positions(data, drawn)
        at = begin + (drawn["first"] + np.arange(len(shown))) * data["step_s"]
        assert data["step_s"] <= 1 / 14
        row = np.rint((at - path.times_s[0]) / np.diff(path.times_s)[0]).astype(int)
        true = person.joints[row]
        known = np.isfinite(true) & np.isfinite(shown)
        assert known.mean() > 0.8
        assert np.abs(shown - true)[known].max() < 2e-3


def test_ellipsoids_have_the_size_of_the_standard_deviations(
    data: dict[str, Any], report_content: ReportContent
) -> None:
    reference, *others = zip(data["cameras"], report_content.calibration.cameras, strict=True)
    assert reference[0]["ellipsoid"] is None
    for drawn, camera in others:
        half = np.linalg.norm(drawn["ellipsoid"], axis=-1)
        stddev = np.sqrt(np.linalg.eigvalsh(camera.covariance[:3, :3]))
        assert np.sort(half) == pytest.approx(data["enlarged"] * stddev, rel=1e-3, abs=1e-6)


def test_small_ellipsoids_are_enlarged_by_a_round_factor(report_content: ReportContent) -> None:
    c = report_content.calibration
    largest = max(np.linalg.eigvalsh(one.covariance[:3, :3]).max() ** 0.5 for one in c.cameras)
    assert enlargement(c, extent=largest * 1e3 / 3.0) == 10
    assert enlargement(c, extent=largest) == 1
    bare = [dataclasses.replace(one, covariance=np.full((6, 6), np.nan)) for one in c.cameras]
    assert enlargement(dataclasses.replace(c, cameras=tuple(bare)), extent=1.0) == 1


def test_it_begins_when_people_are_there(data: dict[str, Any]) -> None:
    assert 0.0 <= data["start_s"] <= data["length_s"]
    for person in data["people"]:
        k = round(data["start_s"] / data["step_s"] - person["first"])
        assert np.isfinite(positions(data, person)[k]).all(-1).mean() > 0.5


def test_people_of_long_recordings_are_thinned(
    report_content: ReportContent, room: Room, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("stcalib_ros.report.scene._MOST_NUMBERS", 2000)
    thinned = scene_data(report_content, room)
    total = sum(len(person["data"]) for person in thinned["people"])
    assert total < 2000 * 2 * 1.5


def test_without_people(report_content: ReportContent) -> None:
    bare = dataclasses.replace(report_content, people=(), truth=None)
    alone = scene_data(bare, make_room(bare.calibration, ()))
    assert alone["people"] == []
    assert alone["true_cameras"] == []
    assert json.loads(scene_json(alone))["length_s"] == 0.0


def test_no_name_ends_the_script(data: dict[str, Any]) -> None:
    other = data | {"cameras": [data["cameras"][0] | {"name": "</script><b>\u2028"}]}
    text = scene_json(other)
    assert "<" not in text
    assert "\u2028" not in text
    assert json.loads(text)["cameras"][0]["name"] == "</script><b>\u2028"
