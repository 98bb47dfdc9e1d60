"""README and docs: the commands that they print work, and the files and names in them exist."""

from __future__ import annotations

import argparse
import itertools
import re
import runpy
import shlex
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import stcalib_ros
from stcalib_ros.commands.parser import add_printing_arguments
from stcalib_ros.core.model.keypoint_layouts import LAYOUTS
from stcalib_ros.core.model.rejection import RejectionReason, RemarkCode
from stcalib_ros.ros.parameter_specs import all_specs

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"
LIVE = ROOT / "docs" / "live.md"
PAGES = (
    *(README, ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", ROOT / "benchmarks" / "README.md"),
    *sorted((ROOT / "docs").glob("*.md")),
    *sorted((ROOT / "stcalib_ros" / "data").glob("*/README.md")),
)
FOLDERS = (
    *("benchmarks", "bin", "config", "docs", "examples", "launch", "msg", "requirements"),
    *("scripts", "stcalib_ros", "test"),
)
"""Folders of the repository that pages name; `core/` is short for `stcalib_ros/core/`."""
PATH = re.compile(rf"(?<![\w./<$-])(?:core|{'|'.join(FOLDERS)})/[\w./-]*")
DOTTED = re.compile(r"(?<![\w./-])(?:stcalib_ros|benchmarks)(?:\.\w+)+")
SOURCES = "\n".join(p.read_text() for p in sorted((ROOT / "stcalib_ros").rglob("*.py")))


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", page.read_text(), re.MULTILINE | re.DOTALL)


def commands(page: Path) -> list[list[str]]:
    lines = [line for block in blocks(page, "bash") for line in block.splitlines()]
    return [words for line in lines if (words := shlex.split(line, comments=True))]


def indented_commands(page: Path) -> list[list[str]]:
    """Return the checkable commands of blocks that are indented instead of fenced."""
    text = page.read_text().replace("\\\n", " ")
    lines = re.findall(r"^    (\w.*)$", re.sub(r"^```.*?^```$", "", text, flags=re.M | re.S), re.M)
    return [shlex.split(line, comments=True) for line in lines if line.split()[0] in CHECKS]


def options_of(command: str) -> set[str]:
    parser = argparse.ArgumentParser()
    package = "ros" if command in ("replay", "publish") else "commands"
    import_module(f"stcalib_ros.{package}.{command}").add_arguments(parser)
    if package == "commands":
        add_printing_arguments(parser)
    actions = list(parser._actions)
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            actions += [own for part in action.choices.values() for own in part._actions]
    return {option for action in actions for option in action.option_strings}


def given_options(words: list[str]) -> set[str]:
    return {word.partition("=")[0] for word in words if word.startswith("-")}


def check_stcalib(words: list[str]) -> None:
    assert given_options(words) <= options_of(words[0])


def check_make(words: list[str]) -> None:
    for target in (word for word in words if "=" not in word):
        assert re.search(rf"^{target}:", (ROOT / "Makefile").read_text(), re.MULTILINE)


def check_ros2(words: list[str]) -> None:
    if words[0] == "security":
        assert (ROOT / "config" / "sros2" / words[words.index("-p") + 1]).is_file()
    elif words[:2] == ["interface", "show"]:
        check_interface(words[2])
    elif words[:2] in (["service", "call"], ["action", "send_goal"]):
        name, interface = [word for word in words[2:] if not word.startswith("-")][:2]
        assert f'"{name.replace("/calibrator", "~")}"' in SOURCES
        check_interface(interface)
    elif words[:2] == ["param", "set"]:
        assert words[2] == "/calibrator"
        assert words[3] in {spec.name for spec in all_specs(()) if not spec.fixed}
    elif words[0] == "launch":
        text = (ROOT / "launch" / words[2]).read_text()
        name = words[3].partition(":=")[0]
        assert re.search(rf'DeclareLaunchArgument\(\s*"{name}"', text)
    elif words[:2] == ["bag", "record"]:  # of rosbag2, which is not here
        assert given_options(words) <= {"-o", "-a"}
    elif words[2] in ("calibrator", "pose_estimator", "restamp"):
        assert words[1:] == [*words[1:3], "--ros-args", "--params-file", f"{words[2]}.yaml"]
    else:
        assert words[:2] == ["run", "stcalib_ros"]
        assert words[2] in ("replay", "publish")
        own = itertools.takewhile(lambda word: word != "--ros-args", words)
        assert given_options(list(own)) <= options_of(words[2])


def check_interface(words: str) -> None:
    package, kind, name = words.split("/")
    assert package in ("stcalib_ros", "std_srvs")
    assert package == "std_srvs" or (ROOT / kind / f"{name}.{kind}").is_file()


def check_pip(words: list[str]) -> None:
    assert words[0] == "install"
    named = {word for word in words[1:] if re.fullmatch(r"\w+", word)}
    if named:
        files = [ROOT / "requirements" / name for name in ("core.txt", "report.txt")]
        lists = "\n".join(path.read_text() for path in files)
        assert named <= set(re.findall(r"^\w+", lists, re.MULTILINE))
        return
    extras = re.fullmatch(r"\.(?:\[([\w,]+)\])?", words[1])
    assert extras
    for extra in extras[1].split(",") if extras[1] else ():
        assert f"optional-dependencies.{extra} " in (ROOT / "pyproject.toml").read_text()


def check_python(words: list[str]) -> None:
    assert words[0] == "-m"
    module = ROOT / words[1].replace(".", "/")
    text = (module / "__main__.py" if module.is_dir() else module.with_suffix(".py")).read_text()
    assert all(f'"{option}"' in text for option in given_options(words[2:]))


def check_elsewhere(words: list[str]) -> None:
    """Accept commands of other packages as they are."""


CHECKS = {
    "stcalib": check_stcalib,
    "make": check_make,
    "ros2": check_ros2,
    "pip": check_pip,
    "python": check_python,
    "rosdep": check_elsewhere,
    "colcon": check_elsewhere,
    "source": check_elsewhere,
    "export": check_elsewhere,
}


COMMANDS = [
    (page.name, words) for page in PAGES for words in commands(page) + indented_commands(page)
]


def test_there_are_commands_to_check() -> None:
    assert {words[0] for _, words in COMMANDS} == set(CHECKS)
    assert {name for name, _ in COMMANDS} >= {"README.md", "CONTRIBUTING.md", "bag.md"}


@pytest.mark.parametrize(("page", "words"), COMMANDS, ids=lambda v: v if isinstance(v, str) else "")
def test_commands_exist_with_their_options(page: str, words: list[str]) -> None:
    CHECKS[words[0]](words[1:])


def test_the_python_of_the_guide_makes_a_message() -> None:
    pytest.importorskip("stcalib_ros.msg", reason="the messages are not built: make env")
    header = import_module("std_msgs.msg").Header(frame_id="cam0_optical_frame")
    np = import_module("numpy")
    (code,) = blocks(ROOT / "docs" / "ros.md", "python")
    names: dict = {}
    exec(code, names)
    person = argparse.Namespace(
        track_id=3,
        score=0.5,
        uv=np.ones((17, 2)),
        joint_scores=np.ones(17),
    )
    message = names["poses_message"](header, [person])
    (sent,) = message.persons
    assert (len(sent.joints), len(sent.keypoints), len(sent.joint_scores)) == (0, 34, 17)


def test_the_python_of_its_page_runs() -> None:
    names: dict = {}
    for code in blocks(ROOT / "docs" / "python.md", "python"):
        exec(code, names)
    assert names["errors"].E_R < 0.02


def test_the_reference_has_every_public_name() -> None:
    page = (ROOT / "docs" / "reference.md").read_text()
    named = re.findall(r"^::: stcalib_ros\.(\w+)$", page, re.MULTILINE)
    assert sorted(named) == sorted(set(stcalib_ros.__all__) - {"__version__"})


def test_the_page_of_messages_is_that_of_their_definitions() -> None:
    made = runpy.run_path(str(ROOT / "docs" / "messages.py"))["page"]()
    assert (ROOT / "docs" / "messages.md").read_text() == made, "python docs/messages.py"


def test_every_page_is_in_the_navigation_and_in_the_index() -> None:
    pages = {page.name for page in (ROOT / "docs").glob("*.md")}
    assert pages == set(re.findall(r"[\w-]+\.md", (ROOT / "mkdocs.yml").read_text()))
    linked = set(re.findall(r"\]\(([\w-]+\.md)\)", (ROOT / "docs" / "index.md").read_text()))
    assert pages - linked <= {"index.md"}


@pytest.mark.slow
def test_the_pages_build(tmp_path: Path) -> None:
    """With the tool that `make docs` runs; links between pages and their anchors exist."""
    pytest.importorskip("mkdocs")
    command = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--site-dir", str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "quickstart.html").is_file()


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_links_and_pictures_are_there(page: Path) -> None:
    for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text()):
        if not target.startswith("https://"):
            assert (page.parent / target.partition("#")[0]).exists(), target


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_nothing_of_a_workshop_is_left(page: Path) -> None:
    text = page.read_text()
    assert not re.search(r"TODO|FIXME|XXX|TBD", text)
    assert not re.search(r"(?<![\w.<>])/(work|root|home|tmp|usr|opt)\b", text)


def test_the_picture_is_light_enough() -> None:
    assert 50_000 < (ROOT / "docs" / "images" / "demo.png").stat().st_size < 400_000


def test_every_topic_and_service_of_the_node_is_explained() -> None:
    names = set(re.findall(r'"(~/\w+|/diagnostics|/tf_static)"', SOURCES))
    assert len(names) >= 10
    for name in names:
        assert f"| `{name}` |" in LIVE.read_text()


def paths(page: Path) -> set[str]:
    """Paths of the repository that a page names, without the dot or slash at their end."""
    return {path.rstrip("./") for path in PATH.findall(page.read_text())}


def exists(path: str) -> bool:
    """Whether a path is a file, a folder, or an interface as ROS names it."""
    if (interface := re.fullmatch(r"stcalib_ros/(msg|srv|action)/(\w+)", path)) is not None:
        kind, name = interface.groups()
        return (ROOT / kind / f"{name}.{kind}").is_file()
    if (short := re.fullmatch(r"stcalib_ros/(\w+)", path)) is not None:  # within definitions
        return (ROOT / "msg" / f"{short[1]}.msg").is_file() or in_checkout(path).exists()
    return in_checkout(path).exists()


def in_checkout(path: str) -> Path:
    """Where a path that a page names is in the checkout."""
    return ROOT / "stcalib_ros" / path if path.partition("/")[0] == "core" else ROOT / path


def is_defined(dotted: str) -> bool:
    """Whether a dotted name is a module, a name in one, or a folder of interfaces."""
    package, first, *rest = dotted.split(".")
    if first in ("msg", "srv", "action"):
        return (ROOT / first).is_dir()
    place, left = ROOT / package, [first, *rest]
    while left and (place / left[0]).is_dir():
        place /= left.pop(0)
    module = place / "__init__.py"
    if left and (place / f"{left[0]}.py").is_file():
        module = place / f"{left.pop(0)}.py"
    return not left or has_name(module, left[0])


def has_name(module: Path, name: str) -> bool:
    """Whether a module defines or exports a name."""
    definition = rf'^(?:def|class) {name}\b|^{name}\b|"{name}"'
    return re.search(definition, module.read_text(), re.MULTILINE) is not None


def test_paths_and_names_are_recognised() -> None:
    assert exists("core/pipeline.py")
    assert exists("stcalib_ros/msg/TimeOffset")
    assert not exists("core/final/refine.py")
    assert not exists("stcalib_ros/msg/Nothing")
    assert is_defined("stcalib_ros.core.pipeline.calibrate")
    assert is_defined("benchmarks.paper")
    assert not is_defined("stcalib_ros.core.pipeline.nothing")
    assert not is_defined("benchmarks.level")
    assert len(set().union(*map(paths, PAGES))) > 50


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_every_path_on_a_page_exists(page: Path) -> None:
    assert [path for path in sorted(paths(page)) if not exists(path)] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_every_dotted_name_on_a_page_is_defined(page: Path) -> None:
    names = set(DOTTED.findall(page.read_text()))
    assert [name for name in sorted(names) if not is_defined(name)] == []


def test_every_function_that_implements_an_equation_is_where_the_page_says() -> None:
    row = re.compile(r"^\| [^|]+ \| `([\w/]+\.py)` \| `(\w+)` \|", re.MULTILINE)
    rows = row.findall((ROOT / "docs" / "paper.md").read_text())
    assert len(rows) >= 15
    for path, name in rows:
        assert has_name(in_checkout(path), name), (path, name)


def refusals() -> list[str]:
    page = (ROOT / "docs" / "troubleshooting.md").read_text()
    return re.findall(r"^### `(.+)`$", page, re.MULTILINE)


def test_every_code_is_explained_once() -> None:
    codes = [heading for heading in refusals() if heading == heading.upper()]
    assert sorted(codes) == sorted(reason.value for reason in RejectionReason)


def test_every_layout_is_listed_with_its_number_of_joints() -> None:
    page = (ROOT / "docs" / "bag.md").read_text()
    listed = re.findall(r"^\| `(\w+_\d+\w?)` \| (\d+) \|", page, re.MULTILINE)
    assert dict(listed) == {name: str(layout.n_joints) for name, layout in LAYOUTS.items()}
    message = (ROOT / "msg" / "PersonPose3DArray.msg").read_text()
    assert set(re.findall(r"\b[a-z]\w*_\d+b?\b", message)) == set(LAYOUTS)


def test_every_remark_is_explained_once() -> None:
    page = (ROOT / "docs" / "troubleshooting.md").read_text()
    assert re.findall(r"^\| `([A-Z_]+)` \|", page, re.MULTILINE) == [c.value for c in RemarkCode]


@pytest.mark.parametrize("words", refusals())
def test_explained_messages_are_those_of_the_code(words: str) -> None:
    assert words in SOURCES


@pytest.mark.parametrize("field", ["PersonPose3D", "PersonPose3DArray"])
def test_every_field_of_the_messages_is_explained(field: str) -> None:
    page = (ROOT / "docs" / "bag.md").read_text()
    text = re.sub(r"#.*", "", (ROOT / "msg" / f"{field}.msg").read_text())
    for name in re.findall(r"^\S+ (\w+)", text, re.MULTILINE):
        assert re.search(rf"^\| `{name}[`.]", page, re.MULTILINE), name
