"""Who is there: people keep their numbers, and their keypoints are found in the images."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from windows import images_of

from stcalib_ros.core.options import Options
from stcalib_ros.core.synthetic import SceneOptions, simulate
from stcalib_ros.io.messages import NS
from stcalib_ros.io.stamps import corrections_of
from stcalib_ros.ros.common_time import part_between
from stcalib_ros.ros.lookout import Lookout
from stcalib_ros.ros.sightings import SeenPerson, Sighting, look

NOTHING = Sighting(-math.inf, -math.inf)


@pytest.fixture(scope="module")
def scene():
    return simulate(SceneOptions(n_cameras=3, n_people=2, n_frames=40, fps=10.0, seed=5))


@pytest.fixture(scope="module")
def windows(scene):
    return [images_of(camera, scene.recording.epoch_ns) for camera in scene.recording.cameras]


def seen_between(scene, windows, start_s, end_s, before=NOTHING):
    clocks = corrections_of(scene.truth)
    epoch_s = scene.recording.epoch_ns / NS
    limits_s = (epoch_s + start_s, epoch_s + end_s)
    parts = [part_between(w, *limits_s, clocks[w.name]) for w in windows]
    return look(parts, scene.truth, clocks, Options(), limits_s=limits_s, before=before)


@pytest.fixture(scope="module")
def sightings(scene, windows):
    first = seen_between(scene, windows, 0.5, 2.0)
    return first, seen_between(scene, windows, 1.0, 2.5, first)


def test_people_keep_their_numbers(sightings):
    first, second = sightings
    assert sorted(p.number for p in first.people) == [0, 1]
    assert sorted(p.number for p in second.people) == [0, 1]
    time_s = 0.5 * (second.start_s + first.end_s)
    before = {p.number: p.at(time_s) for p in first.people}
    for person in second.people:
        apart = np.linalg.norm(person.at(time_s) - before[person.number], axis=-1)
        assert np.nanmedian(apart) < 0.05
    assert second.next_number == 2


def test_who_is_out_of_sight_for_a_while_keeps_the_number_by_the_cameras_tracks(
    scene, windows, sightings
):
    _, second = sightings
    nobody = replace(second, people=())
    back = seen_between(scene, windows, 2.0, 3.5, nobody)
    at_s = back.start_s + 0.2
    for person in back.people:
        known = next(p for p in second.people if p.number == person.number)
        apart = np.linalg.norm(person.at(at_s) - known.at(at_s), axis=-1)
        assert np.nanmedian(apart) < 0.05


def test_keypoints_agree_with_the_people_by_a_right_calibration_and_not_by_a_wrong_one(
    scene, windows, sightings
):
    names = [camera.name for camera in scene.truth.cameras]
    assert all(0.5 < sightings[0].residual_px(name) < 8.0 for name in names)
    first, *others = scene.truth.cameras
    moved = replace(first, t_ref_cam=first.t_ref_cam + np.array([0.0, 0.15, 0.0]))
    wrong = replace(scene, truth=replace(scene.truth, cameras=(moved, *others)))
    worse = seen_between(wrong, windows, 0.5, 2.0)
    assert max(worse.residual_px(n) for n in names) > 1.5 * sightings[0].residual_px(names[0])
    assert math.isnan(NOTHING.residual_px("cam0"))


def test_nobody_is_no_error(scene, windows):
    empty = [replace(w, images=[replace(i, keypoints=i.keypoints[:0], joints=None,
        track_ids=i.track_ids[:0], scores=i.scores[:0], joint_scores=i.joint_scores[:0])
        for i in w.images]) for w in windows]  # fmt: skip
    assert seen_between(scene, empty, 0.5, 2.0).people == ()
    assert seen_between(scene, windows[:1], 0.5, 2.0).people == ()
    assert seen_between(scene, [], 0.5, 2.0).images == {}


def test_joints_are_between_their_samples_and_unknown_beyond(sightings):
    layout = sightings[0].people[0].layout
    joints = np.zeros((2, layout.n_joints, 3))
    joints[1] = 1.0
    joints[1, 3] = np.nan
    person = SeenPerson(0, layout, np.array([10.0, 11.0]), joints)
    assert np.allclose(person.at(10.25)[0], 0.25)
    assert np.isnan(person.at(10.25)[3]).all()
    assert np.isfinite(person.at(10.0)[3]).all()
    assert np.isnan(person.at(11.01)).all()
    assert np.isnan(person.at(9.99)).all()
    assert np.allclose(person.shown_at(11.2)[0], 1.0), "held for a moment"
    assert np.allclose(person.shown_at(9.8)[0], 0.0)
    assert np.isnan(person.shown_at(11.6)).all()


class Played:
    """A lookout to whom a recording is played by a clock of our own."""

    def __init__(self, scene, windows) -> None:
        self.now_s, self.lines = 100.0, []
        self.scene, self.windows = scene, windows
        self.lookout = Lookout(self.lines.append, clock=lambda: self.now_s)
        self.lookout.begin(scene.truth)

    def look(self, end_s: float) -> Sighting:
        end_ns = self.scene.recording.epoch_ns + round(end_s * NS)
        there = [
            replace(w, images=[i for i in w.images if i.stamp_ns <= end_ns]) for w in self.windows
        ]
        arriving = {w.name: 0.0 for w in self.windows}
        self.lookout.look(there, arriving, Options())
        while not self.lookout.ready:
            pass
        self.lookout.look(there, arriving, Options())
        return self.lookout.sight


def test_time_passes_as_it_does_within_what_was_seen(scene, windows):
    played = Played(scene, windows)
    assert played.lookout.time_to_show_s() is None
    sight = played.look(2.5)
    assert len(sight.people) == 2
    first_s = played.lookout.time_to_show_s()
    assert first_s == pytest.approx(sight.start_s)
    played.now_s += 0.25
    assert played.lookout.time_to_show_s() == pytest.approx(first_s + 0.25)
    played.now_s += 60.0
    assert played.lookout.time_to_show_s() == pytest.approx(sight.end_s)
    assert played.lookout.time_to_show_s() is None, "nothing is new"
    assert played.look(2.6) is sight, "too little is new for another look"
    assert played.look(3.8).end_s > sight.end_s
    assert played.lines == []


def test_a_bag_that_begins_again_and_another_calibration_begin_anew(scene, windows):
    played = Played(scene, windows)
    late = played.look(3.5)
    assert played.look(2.0).end_s < late.end_s
    played.lookout.begin(None)
    assert played.lookout.sight.people == ()
    assert not played.lookout.ready
    assert played.lookout.time_to_show_s() is None
