"""The watch on what arrives, span by span; without ROS."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from windows import images_of

from stcalib_ros.core.monitoring.alarms import State, Thresholds, Verdict
from stcalib_ros.core.monitoring.limits import SPAN_S
from stcalib_ros.core.synthetic import CameraChange, Scene, SceneOptions, simulate
from stcalib_ros.io.assemble import CameraImages
from stcalib_ros.io.messages import NS
from stcalib_ros.ros.watcher import Watcher

CHANGED_S, END_S = 5.0, 14.0
OPTIONS = SceneOptions(n_cameras=3, n_frames=round(30 * END_S), seed=11)


class Live:
    """A watcher to which a recording is played, one second after the other."""

    def __init__(self, scene: Scene) -> None:
        self.lines: list[str] = []
        self.watcher = Watcher(self.lines.append)
        self.watcher.begin(scene.truth)
        self.all = tuple(
            images_of(camera, scene.recording.epoch_ns) for camera in scene.recording.cameras
        )
        self.epoch_ns = scene.recording.epoch_ns
        self.arriving = dict.fromkeys(scene.rig.names, 0.1)

    def until(self, now_s: float, lag_s: dict[str, float] | None = None) -> tuple[Verdict, ...]:
        """What is new at a time, with the images of the last twenty seconds."""

        def arrived(camera: CameraImages) -> CameraImages:
            last = self.epoch_ns + round((now_s - (lag_s or {}).get(camera.name, 0.0)) * NS)
            kept = [i for i in camera.images if last - 20 * NS < i.stamp_ns <= last]
            return replace(camera, images=kept)

        snapshot: Callable[[], Sequence[CameraImages]] = lambda: [  # noqa: E731
            c for c in map(arrived, self.all) if c.images
        ]
        self.watcher.look(snapshot, self.arriving, min_score=0.3)
        deadline = time.monotonic() + 30.0
        while self.watcher.busy and time.monotonic() < deadline:
            time.sleep(0.005)
        return self.watcher.news(Thresholds())

    def play(self, **given: dict[str, float]) -> list[Verdict]:
        return [v for now_s in np.arange(1.0, END_S, 1.0) for v in self.until(now_s, **given)]


@pytest.fixture(scope="module")
def quiet() -> Scene:
    return simulate(OPTIONS)


@pytest.fixture(scope="module")
def turned() -> Scene:
    turn = (0.0, np.radians(2.0), 0.0)
    return simulate(OPTIONS, changes=[CameraChange(1, CHANGED_S, turn_rad=turn)])


def alarms(verdicts: Sequence[Verdict]) -> list[tuple[str, State]]:
    return [(v.name, v.state) for v in verdicts if v.state.alarm]


def test_all_is_well(quiet):
    live = Live(quiet)
    said = live.play()
    assert {(v.name, v.state) for v in said} == {(n, State.OK) for n in quiet.rig.names}
    assert live.watcher.complaint == ""
    assert live.watcher.changed_s == -np.inf


def test_a_turned_camera_is_told_once_and_data_starts_after_it(turned):
    live = Live(turned)
    assert alarms(live.play()) == [("cam1", State.MOVED)]
    assert "cam1 has moved" in live.watcher.complaint
    changed_s = live.epoch_ns / NS + CHANGED_S
    assert changed_s <= live.watcher.changed_s <= changed_s + 2 * SPAN_S


def test_another_calibration_is_watched_from_its_beginning(turned):
    live = Live(turned)
    live.play()
    after_s = live.watcher.changed_s
    live.watcher.begin(turned.truth)
    assert live.watcher.complaint == ""
    assert {v.state for v in live.watcher.verdicts.values()} == {State.UNKNOWN}
    assert live.watcher.changed_s == after_s


@pytest.mark.parametrize("skew", [25e-6, 40e-6])
def test_a_clock_that_drifts_as_calibrated_is_no_alarm(quiet, skew):
    """After a day 25 ppm are 2.2 s, more than a span; 40 ppm are 3.5 s, enough for an alarm."""
    elapsed_s = 86_400.0
    drifting = tuple(
        replace(c, clock_skew=skew, time_offset_s=c.time_offset_s - skew * elapsed_s)
        if c.name == "cam1"
        else c
        for c in quiet.truth.cameras
    )
    live = Live(quiet)
    live.watcher.begin(
        replace(quiet.truth, cameras=drifting, epoch_s=quiet.truth.epoch_s - elapsed_s)
    )
    said = live.play()
    assert {(v.name, v.state) for v in said} == {(n, State.OK) for n in quiet.rig.names}
    assert live.watcher.complaint == ""


def test_a_clock_that_is_off_after_a_long_time_may_have_drifted(quiet):
    """The rate is not known: after an hour 40 ppm are 144 ms."""
    live, hour_s = Live(quiet), 3600.0
    late = tuple(
        replace(c, time_offset_s=c.time_offset_s + 40e-6 * hour_s) if c.name == "cam1" else c
        for c in quiet.truth.cameras
    )
    start_s, end_s = quiet.truth.window_s
    live.watcher.begin(
        replace(quiet.truth, cameras=late, window_s=(start_s - hour_s, end_s - hour_s))
    )
    assert alarms(live.play()) == [("cam1", State.CLOCK)]
    said = r"the clock of cam1 has jumped or drifted by \+14\d ms within 60 minutes"
    assert re.match(said, live.watcher.complaint)


def test_who_comes_late_is_waited_for(turned):
    said = Live(turned).play(lag_s={"cam0": 1.5})
    assert alarms(said) == [("cam1", State.MOVED)]


def test_who_has_stopped_is_not_waited_for(quiet):
    live = Live(quiet)
    live.arriving["cam2"] = 60.0
    live.play(lag_s={"cam2": 8.0})
    assert live.watcher.verdicts["cam0"].state is State.OK
    assert not live.watcher.verdicts["cam2"].state.alarm


def test_stamps_that_are_far_off_are_told(quiet):
    scene = simulate(OPTIONS, changes=[CameraChange(2, CHANGED_S, clock_s=100.0)])
    said = alarms(Live(scene).play(lag_s={"cam2": -100.0}))
    assert said == [("cam2", State.STAMPS_OFF)]


def test_time_that_starts_again_is_followed(turned):
    live = Live(turned)
    live.play()
    again = [v for now_s in np.arange(1.0, CHANGED_S, 1.0) for v in live.until(now_s)]
    again += [v for now_s in np.arange(1.0, CHANGED_S, 1.0) for v in live.until(now_s)]
    assert ("cam1", State.OK) in [(v.name, v.state) for v in again]


def test_images_that_cannot_be_read_are_no_alarm(quiet):
    live = Live(quiet)
    live.all = tuple(replace(c, info=c.info._replace(distortion_model="other")) for c in live.all)
    assert live.play() == []
    live.watcher.begin(None)
    assert live.play() == []


def test_drivers_that_have_lost_their_calibration_are_no_alarm(quiet):
    live = Live(quiet)
    live.all = tuple(replace(c, info=c.info._replace(k=(0.0,) * 9)) for c in live.all)
    assert {verdict.state for verdict in live.play()} == {State.OK}


def test_an_error_in_the_examination_is_said_and_the_watch_goes_on(quiet, monkeypatch):
    from stcalib_ros.ros import watcher as module

    live = Live(quiet)
    monkeypatch.setattr(module, "check_span", lambda *_, **__: 1 / 0)
    assert live.until(3.0) == ()
    assert live.lines == ["the watch could not look at the last images: division by zero"]
    monkeypatch.undo()
    assert live.play()
