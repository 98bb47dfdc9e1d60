"""Every command of README and docs is run, page by page, as a reader would type it."""

from __future__ import annotations

import re
import shlex
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from pose_files import seen_by
from pose_writers import openpose_person, write_openpose_image

import stcalib_ros as st
from stcalib_ros.cli import main
from stcalib_ros.io.camera_info_yaml import camera_info_text

ROOT = Path(__file__).parents[1]
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
SCENE = st.SceneOptions(n_cameras=4, n_people=3, n_frames=240, drop_rate=0.0, seed=2)
ELSEWHERE = {
    "160906_pizza1": "a data set of several GB",
    "pizza.mcap": "made of that data set",
    "pizza.yaml": "made of that data set",
    "SOURCE": "run by test/io/sources, for each program",
    "RESULT": "stands for any result",
    "models": "fetches weights from registries",
    "cam0.mp4": "needs weights: test/estimation",
}
"""Words of commands that are not run here, and why."""


def commands_of(page: Path) -> list[str]:
    """Commands in fenced and indented blocks, and those between backticks in tables."""
    text = page.read_text()
    fenced = re.findall(r"^```bash\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    lines = [line.strip() for block in fenced for line in block.splitlines()]
    lines += re.findall(r"^    (stcalib .*)$", text, re.MULTILINE)
    rows = re.findall(r"^\|.*$", text, re.MULTILINE)
    lines += [cell for row in rows for cell in re.findall(r"`(.*?)`", row)]
    return [line for line in lines if len(line.split()) > 2 and line.startswith("stcalib ")]


def to_run(page: Path) -> list[list[str]]:
    commands = [shlex.split(line, comments=True)[1:] for line in commands_of(page)]
    if page.name == "formats.md":  # of each program, by test/io/sources
        commands = [words for words in commands if words[0] != "calibrate"]
    once = list(dict.fromkeys(map(tuple, commands)))
    return [list(words) for words in once if not ELSEWHERE.keys() & set(words)]


RUN = {page.name: commands for page in PAGES if (commands := to_run(page))}


@pytest.fixture(scope="module")
def kitchen(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """All files that pages name as given."""
    folder = tmp_path_factory.mktemp("kitchen")
    scene = st.simulate(SCENE)
    st.write_bag(scene.recording, folder / "walk.mcap")
    st.write_bag(scene.recording, folder / "walk")
    st.write_result(scene.truth, folder / "walk_truth.yaml")
    st.write_result(st.calibrate(scene.recording), folder / "walk.yaml")
    st.export_calibration(scene.truth, folder / "camchain.yaml", "kalibr")
    lens = replace(scene.truth.cameras[0], name="narrow_stereo")
    (folder / "ost.yaml").write_text(camera_info_text(lens))
    shutil.copy(ROOT / "config" / "calibrate.yaml", folder / "config.yaml")
    recorded = ROOT / "benchmarks" / "data" / "pose2sim_balance" / "balance_openpose.npz"
    shutil.copy(recorded, folder / "scene.npz")
    for camera in scene.recording.cameras:
        for k, people in enumerate(seen_by(camera, "body_25", SCENE.n_frames)):
            name = f"walk_{k:012d}_keypoints.json"
            persons = [openpose_person(one) for one in people]
            write_openpose_image(folder / "poses" / camera.name / name, persons)
    shutil.copytree(folder / "poses", folder / "openpose_output")
    refused = (folder / "walk.yaml").read_text().replace("status: OK", "status: DEGENERATE")
    (folder / "walk.rejected.yaml").write_text(refused)
    return folder


def test_most_pages_have_commands() -> None:
    assert {"README.md", "quickstart.md", "formats.md", "lenses.md", "people.md"} <= RUN.keys()


@pytest.mark.parametrize("page", RUN)
def test_commands_run(
    page: str, kitchen: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "reader"
    shutil.copytree(kitchen, folder)
    monkeypatch.chdir(folder)
    for words in RUN[page]:
        assert main(words) == 0, words
