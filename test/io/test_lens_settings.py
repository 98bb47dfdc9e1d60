"""What a configuration says of lenses, and how it and CameraInfo go together."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bag_helpers as bags
import numpy as np
import pytest

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.lens_knowledge import LensKnowledge
from stcalib_ros.core.model.recording import CameraRecording
from stcalib_ros.io.bag import read_bag
from stcalib_ros.io.config import read_config
from stcalib_ros.io.lens_files import read_lens_fields
from stcalib_ros.io.lens_settings import LensFile, LensSettings
from stcalib_ros.io.topics import CameraSelection

NO_LENS = {"k": [0.0] * 9, "p": [0.0] * 12, "d": [], "distortion_model": ""}


def read(tmp_path: Path, text: str, **info: Any) -> CameraRecording:
    """The camera of a bag with such a CameraInfo, by such a configuration."""
    (tmp_path / "c.yaml").write_text(text)
    messages = [m for m in bags.camera() if m[1] != bags.CAMERA_INFO or info != {"none": True}]
    if info != {"none": True}:
        topic, kind, _, stamp = messages[0]
        messages[0] = (topic, kind, bags.info(**info), stamp)
    path = bags.write_bag(tmp_path / "a.mcap", messages)
    (camera,) = read_bag(path, selection=read_config(tmp_path / "c.yaml").selection).cameras
    return camera


def test_everything_of_a_lens(tmp_path: Path) -> None:
    (tmp_path / "c.yaml").write_text(
        """\
intrinsics: unknown
lens: {shared: true, radial_terms: 2}
camera:
  a: {intrinsics: refine, lens_group: gopro, field_of_view_deg: 90}
  b: {lens_group: gopro, image_size: [1920, 1080]}
"""
    )
    config = read_config(tmp_path / "c.yaml")
    assert (config.options.intrinsics, config.options.lens.radial_terms) == ("unknown", 2)
    assert config.options.lens.shared
    lenses = {name: topics.lens for name, topics in config.selection.camera.items()}
    assert lenses == {
        "a": LensSettings(LensKnowledge.REFINE, "gopro", 90.0),
        "b": LensSettings(None, "gopro", None, (1920, 1080)),
    }


@pytest.mark.parametrize(
    ("own", "message"),
    [
        ("intrinsics: guess", r"a\.intrinsics: expected given, refine or unknown, got 'guess'"),
        ("intrinsics: true", r"a\.intrinsics: expected given, refine or unknown, got True"),
        ("lens_group: gopro", "a is alone in the group 'gopro': name the group at every camera"),
        ("lens_group: ''", r"a\.lens_group: expected a name of 1 to"),
        ("field_of_view_deg: 4", "expected a horizontal field of view of 5 to 180 degrees, got 4"),
        ("field_of_view_deg: 181", "of 5 to 180 degrees, got 181"),
        ("field_of_view_deg: wide", "of 5 to 180 degrees, got 'wide'"),
        ("field_of_view_deg: .nan", "of 5 to 180 degrees, got nan"),
        (
            "field_of_view_deg: 90, intrinsics: given",
            "is a first guess for .* refine, not for given",
        ),
        ("image_size: 1920", r"a\.image_size: expected \[width, height\] .*, got 1920"),
        ("image_size: [1920, 0]", r"expected \[width, height\] of 1 to"),
        ("image_size: [1920, 1080, 3]", r"expected \[width, height\] of 1 to"),
        ("image_size: [true, true]", r"expected \[width, height\] of 1 to"),
    ],
)
def test_unusable(tmp_path: Path, own: str, message: str) -> None:
    (tmp_path / "c.yaml").write_text(f"camera: {{a: {{{own}}}}}")
    with pytest.raises(InputError, match=message) as caught:
        read_config(tmp_path / "c.yaml")
    assert "\n" not in str(caught.value)


def test_a_zero_matrix_is_read_as_a_lens_that_is_not_known(tmp_path: Path) -> None:
    camera = read(tmp_path, "", **NO_LENS)
    assert not camera.intrinsics.known
    assert (camera.intrinsics.width, camera.intrinsics.height) == (640, 480)
    assert (camera.lens_knowledge, camera.lens_group) == (None, "")


def test_a_field_of_view_is_a_guess_where_there_is_no_lens(tmp_path: Path) -> None:
    text = "camera: {cam0: {field_of_view_deg: 90}}"
    camera = read(tmp_path, text, **NO_LENS)
    assert camera.lens_knowledge is LensKnowledge.REFINE
    np.testing.assert_allclose(camera.intrinsics.K, [[320, 0, 319.5], [0, 320, 239.5], [0, 0, 1]])
    given = read(tmp_path, text)
    assert (given.lens_knowledge, given.intrinsics.K[0, 0]) == (None, 800.0)


@pytest.mark.parametrize("info", [{"none": True}, {"width": 0, "height": 0, **NO_LENS}])
def test_the_size_of_the_image_is_enough(tmp_path: Path, info: dict[str, Any]) -> None:
    text = "camera: {cam0: {intrinsics: unknown, image_size: [800, 600]}}"
    camera = read(tmp_path, text, **info)
    assert not camera.intrinsics.known
    assert (camera.intrinsics.width, camera.intrinsics.height) == (800, 600)
    assert camera.lens_knowledge is LensKnowledge.UNKNOWN


def with_file(tmp_path: Path, messages: list[Any]) -> CameraRecording:
    """The camera of a bag of such messages, with COLMAP's lenses given for all cameras."""
    (tmp_path / "cameras.txt").write_text("1 PINHOLE 640 480 700 701 320.5 240.5\n")
    path = bags.write_bag(tmp_path / "a.mcap", messages)
    file = LensFile("cameras.txt", read_lens_fields(tmp_path / "cameras.txt"))
    (camera,) = read_bag(path, selection=CameraSelection(lens_file=file)).cameras
    return camera


def test_a_file_takes_the_place_of_camera_info(tmp_path: Path) -> None:
    """Of one that has another lens, and of one that there is not."""
    for messages in (bags.camera(), [m for m in bags.camera() if m[1] != bags.CAMERA_INFO]):
        camera = with_file(tmp_path, messages)
        assert camera.lens_knowledge is LensKnowledge.GIVEN
        np.testing.assert_array_equal(
            camera.intrinsics.K, [[700, 0, 320], [0, 701, 240], [0, 0, 1]]
        )


def test_a_file_that_knows_no_rectified_image(tmp_path: Path) -> None:
    images = [bags.poses(k, rectified=True) for k in range(3)]
    with pytest.raises(
        InputError, match=r"cam0: its keypoints are of rectified images, .*camera_i"
    ):
        with_file(tmp_path, bags.camera(images=images))


def test_a_size_that_contradicts_camera_info(tmp_path: Path) -> None:
    text = "camera: {cam0: {image_size: [800, 600]}}"
    with pytest.raises(InputError, match=r"cam0: .* as 800 x 600 px, .* says 640 x 480; correct"):
        read(tmp_path, text)


def test_settings_of_a_camera_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="intrinsics of camera cam9: there are no person poses"):
        read(tmp_path, "camera: {cam9: {intrinsics: refine}}")
