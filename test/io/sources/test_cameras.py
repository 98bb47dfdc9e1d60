"""Which file is of which camera and image."""

from __future__ import annotations

from pathlib import Path, PurePath

import pytest

from stcalib_ros.core.errors import InputError
from stcalib_ros.io.sources.cameras import by_camera_and_image, natural_order, plain_name
from stcalib_ros.io.sources.images import all_images

UNIX_NS = 1_760_000_000_500_000_000


def cameras(root: Path, *names: str) -> dict[str, list[int]]:
    groups = by_camera_and_image(root, [PurePath(root / name) for name in names])
    return {name: [file.image for file in group] for name, group in groups.items()}


@pytest.mark.parametrize(
    ("files", "expected"),
    [
        (["a/f_2.json", "a/f_1.json", "b/f_7.json"], {"a": [1, 2], "b": [7]}),
        (["a_json/v_01_keypoints.json", "b_json/v_01_keypoints.json"], {"a": [1], "b": [1]}),
        (["x/a/labels/1.txt", "x/b/labels/1.txt"], {"a": [1], "b": [1]}),
        (["cam-1_0001.json", "cam-2_0001.json"], {"cam_1": [1], "cam_2": [1]}),
        (["1/0.json", "2/0.json"], {"cam1": [0], "cam2": [0]}),
        (["s0/l/1.json", "s0/r/1.json", "s1/l/1.json"], {"s0_l": [1], "s0_r": [1], "s1_l": [1]}),
        (["left/1760000000.500.json", "right/1.json"], {"left": [UNIX_NS], "right": [1]}),
        (["a/1760000000500.json", "b/1760000000500000.json"], {"a": [UNIX_NS], "b": [UNIX_NS]}),
        (["a/1760000000_500000000.json"], {"a": [UNIX_NS]}),
        (["a/000000000012_keypoints.json"], {"a": [12]}),
    ],
)
def test_names(tmp_path: Path, files: list[str], expected: dict[str, list[int]]) -> None:
    assert cameras(tmp_path, *files) == expected


@pytest.mark.parametrize(
    ("files", "message"),
    [
        (["a/x.json"], "no number of an image, as in x_000001.json"),
        (["a/x_1.json", "a/x_01.json"], "are of the same image"),
        (["a b/1.json", "a-b/1.json"], "a b and a-b would both be called a_b: rename one"),
        (["a/1.json", "客/1.json"], "客 gives its camera no name: rename it; names of cameras"),
        ([f"{chr(300 + k)}_1.json" for k in range(300)], "begin in 300 different ways, too many"),
    ],
)
def test_names_that_say_nothing(tmp_path: Path, files: list[str], message: str) -> None:
    with pytest.raises(InputError, match=message):
        cameras(tmp_path, *files)


def test_plain_names() -> None:
    given = ["pose_cam01_json", "0", "GoPro 7", "results_left", "cam/2", "keypoints", "Küche"]
    assert [plain_name(n) for n in given] == [
        "cam01",
        "cam0",
        "GoPro_7",
        "left",
        "cam_2",
        "keypoints",
        "Kuche",
    ]
    assert sorted(["c10", "c2", "b"], key=natural_order) == ["b", "c2", "c10"]


def test_images_between() -> None:
    assert all_images([7, 3, 5, 11], Path("x")).tolist() == [3, 5, 7, 9, 11]
    assert all_images([4], Path("x")).tolist() == [4]
    with pytest.raises(InputError, match="images are too many"):
        all_images([0, 1, 10**9], Path("x"))
