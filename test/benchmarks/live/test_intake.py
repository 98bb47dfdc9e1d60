"""The benchmark of the live node: its arithmetic, and a run of some seconds."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.cost.process import Usage, usage
from benchmarks.live.figures import Observed, Sample, Solve, rows
from benchmarks.live.player import Sent, images_of, stamped
from stcalib_ros.core.synthetic import SceneOptions, simulate
from stcalib_ros.io.bag_writer import write_bag
from stcalib_ros.io.message_types import CAMERA_INFO, PERSON_POSES, decode
from stcalib_ros.io.messages import stamp_ns

ROOT = Path(__file__).parents[3]


def sample(at_s: float, **changes: object) -> Sample:
    load = {
        "delay_p50_ms": 1.0,
        "delay_p99_ms": 5.0,
        "delay_max_ms": 30.0,
        "hold_p99_ms": 0.5,
        "hold_max_ms": 30.0,
    }
    made = Sample(at_s, 20 <= at_s < 40, Usage(150.0, 160.0, 150.0, 0.2 * at_s), 1000, load)
    return replace(made, **changes)


SEEN = Observed(
    sent={"cam0": Sent(1000, 901, 0), "cam1": Sent(1000, 901, 2)},
    received={"cam0": 1000, "cam1": 1000},
    dropped={"cam0": 0, "cam1": 0},
    buffered={"cam0": 901, "cam1": 901},
    lost=0,
    solves=[Solve("a", "OK", 10.0, 0.1)],
    samples=[sample(float(t)) for t in range(300)],
    exit_status=0,
    stop_s=0.4,
)


def verdicts(seen: Observed) -> dict[str, bool | None]:
    return {row.figure: row.met for row in rows(seen)}


def text(seen: Observed, figure: str) -> str:
    return next(row.value for row in rows(seen) if row.figure == figure)


def test_a_node_that_keeps_up_meets_the_level():
    assert False not in verdicts(SEEN).values()
    assert text(SEEN, "CPU") == "20% idle, 20% with a solve"


@pytest.mark.parametrize(
    ("changes", "missed"),
    [
        ({"received": {"cam0": 999, "cam1": 1000}}, "not received"),
        ({"dropped": {"cam0": 0, "cam1": 1}}, "dropped"),
        ({"buffered": {"cam0": 900, "cam1": 901}}, "in the buffers"),
        ({"solves": [Solve("a", "OK", 10.0, 0.1), Solve("b", "DEGENERATE", 9.0, 0.1)]}, "solves"),
        ({"solves": [Solve("a", "OK", 10.0, 0.31)]}, "result s"),
        ({"solves": [Solve("a", "OK", 10.0, math.nan)]}, "result s"),
        ({"stop_s": 2.5}, "stop s"),
        ({"exit_status": 1}, "stop s"),
    ],
)
def test_what_is_missed_is_named(changes, missed):
    assert [f for f, met in verdicts(replace(SEEN, **changes)).items() if met is False] == [missed]


def test_without_a_solve_nothing_is_shown():
    missed = verdicts(replace(SEEN, solves=[]))
    assert (missed["solves"], missed["result s"]) == (False, False)


def test_the_worst_minute_counts():
    late = dict(SEEN.samples[0].load, delay_p99_ms=21.0)
    samples = [sample(float(t), load=late) if t == 200 else sample(float(t)) for t in range(300)]
    seen = replace(SEEN, samples=samples)
    assert verdicts(seen)["delay ms"] is False
    assert text(seen, "delay ms").startswith("p99 21.00 in the worst minute, 5.00 usual")


def test_memory_that_grows_between_solves_is_seen():
    samples = [sample(float(t), usage=Usage(150.0, 160.0, 150.0 + t / 30, 0.0)) for t in range(300)]
    assert verdicts(replace(SEEN, samples=samples))["growth MB/min"] is False
    assert text(replace(SEEN, samples=samples), "growth MB/min").startswith("+2.00 over 259 s")
    assert verdicts(replace(SEEN, samples=samples[:100]))["growth MB/min"] is None


def test_memory_is_that_of_all_processes():
    big = sample(30.0, usage=Usage(150.0, 160.0, 601.0, 6.0))
    samples = [big if s.at_s == 30.0 else s for s in SEEN.samples]
    assert verdicts(replace(SEEN, samples=samples))["memory MB"] is False


def test_usage_of_a_process_and_its_children():
    before = usage(os.getpid())
    with subprocess.Popen(
        [sys.executable, "-c", "x = bytes(50_000_000); print(1, flush=True); input()"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    ) as child:
        assert child.stdout is not None
        child.stdout.readline()
        during = usage(os.getpid())
        child.communicate(b"\n")
    assert before.own_mb > 10.0
    assert during.all_mb > before.all_mb + 4.0
    assert during.own_mb <= during.own_peak_mb
    assert usage(os.getpid()).cpu_s >= before.cpu_s


def test_the_player_restamps_and_nothing_else(tmp_path):
    path = tmp_path / "walk.mcap"
    scene = simulate(SceneOptions(n_cameras=3, n_people=1, n_frames=10, seed=1))
    write_bag(scene.recording, path)
    images, lenses = images_of(path, ["cam0", "cam2"])
    assert [image.camera for image in images[:2]] == ["cam0", "cam2"]
    assert len(images) == 20
    assert sorted(lenses) == ["cam0", "cam2"]
    new_ns = 1_800_000_000_123_456_789
    for kind, data in ((PERSON_POSES.name, images[5].poses), (CAMERA_INFO.name, lenses["cam0"])):
        before, after = decode(kind, bytes(data)), decode(kind, stamped(data, new_ns))
        assert stamp_ns(after) == new_ns
        assert after.header.frame_id == before.header.frame_id
        assert len(stamped(data, new_ns)) == len(data)


def test_a_short_run():
    pytest.importorskip("rclpy", reason="needs ROS 2: make env")
    options = ["--minutes", "0.2", "--cameras", "2", "--people", "2", "--players", "1"]
    run = subprocess.run(
        [sys.executable, "-m", "benchmarks.live.intake", *options, "--scene-s", "15", "--json"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert run.returncode in (0, 1), run.stderr  # how fast this machine is, is not tested here
    found = json.loads(run.stdout)
    met = {row["figure"]: row["met"] for row in found["rows"]}
    assert met["dropped"]
    assert found["observed"]["exit_status"] == 0
    sent = sum(s["images"] for s in found["observed"]["sent"].values())
    received = sum(found["observed"]["received"].values())
    assert sent > 600
    assert sent - received == found["observed"]["lost"]
    assert found["observed"]["solves"][0]["status"] == "OK"
    assert found["observed"]["samples"][-1]["load"]["delay_p99_ms"] > 0


def test_without_ros_it_says_what_to_do(monkeypatch, capsys):
    pytest.importorskip("rclpy", reason="needs ROS 2: make env")
    from benchmarks.live import intake as live

    monkeypatch.setenv("AMENT_PREFIX_PATH", "/nowhere")
    assert live.main([]) == 2
    assert "make env" in capsys.readouterr().err
