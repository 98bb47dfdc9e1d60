"""Everything unusable gives one clear line and exit status 2."""

from __future__ import annotations

import gzip
import os
import random
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import bag_helpers as bags
import numpy as np
import pytest
from bag_helpers import CAMERA_INFO, POSES, schema_text

from stcalib_ros.cli import main
from stcalib_ros.core.errors import InputError
from stcalib_ros.io.bag import read_bag
from stcalib_ros.io.bag_writer import write_bag
from stcalib_ros.io.cdr import CdrWriter

Maker = Callable[[Path], Path]


def _no_such_file(folder: Path) -> Path:
    return folder / "missing.mcap"


def _pipe(folder: Path) -> Path:
    os.mkfifo(folder / "a.mcap")  # nobody writes: to open it would wait for ever
    return folder / "a.mcap"


def _no_bytes(folder: Path) -> Path:
    (folder / "a.mcap").touch()
    return folder / "a.mcap"


def _no_mcap(folder: Path) -> Path:
    (folder / "a.mcap").write_text("this is a text")
    return folder / "a.mcap"


def _damaged_sqlite(folder: Path) -> Path:
    (folder / "a.db3").write_bytes(b"SQLite format 3\0 and so on")
    return folder / "a.db3"


def _other_sqlite(folder: Path) -> Path:
    with closing(sqlite3.connect(folder / "a.db3")) as base:
        base.execute("CREATE TABLE topics (id INTEGER, name TEXT)")
    return folder / "a.db3"


def _ros1(folder: Path) -> Path:
    (folder / "a.bag").write_bytes(b"#ROSBAG V2.0\n")
    return folder / "a.bag"


def _folder_of_empty_files(folder: Path) -> Path:
    (folder / "a_0.mcap").touch()
    (folder / "a_1.mcap").touch()
    return folder


def _truncated(folder: Path) -> Path:
    path = bags.write_bag(folder / "a.mcap", bags.camera())
    path.write_bytes(path.read_bytes()[:-100])
    return path


def _damaged(folder: Path) -> Path:
    path = bags.write_bag(folder / "a.mcap", bags.camera())
    content = bytearray(path.read_bytes())
    content[400:420] = b"?" * 20
    path.write_bytes(content)
    return path


def _no_messages(folder: Path) -> Path:
    return bags.write_bag(folder / "a.mcap", [])


def _no_poses(folder: Path) -> Path:
    chatter = ("/chatter", "std_msgs/msg/String", {"data": "hello"}, bags.START_NS)
    return bags.write_bag(folder / "a.mcap", [chatter, bags.camera()[0]])


def _empty_folder(folder: Path) -> Path:
    (folder / "notes.txt").touch()
    return folder


def _folder_with_a_missing_file(folder: Path) -> Path:
    text = "rosbag2_bagfile_information: {storage_identifier: mcap, relative_file_paths: [a.mcap]}"
    (folder / "metadata.yaml").write_text(text)
    return folder


def _folder_with_other_metadata(folder: Path) -> Path:
    (folder / "metadata.yaml").write_text("hello: world")
    return folder


def _folder_with_broken_metadata(folder: Path) -> Path:
    (folder / "metadata.yaml").write_text("a: [1, 2")
    return folder


def _other_schema(folder: Path) -> Path:
    text = schema_text(POSES).replace("float32[] joints", "float64[] joints")
    return bags.write_bag(folder / "a.mcap", bags.camera(), schemas={POSES: text})


def _images(*images: dict[str, object]) -> Maker:
    return lambda folder: bags.write_bag(folder / "a.mcap", bags.camera(images=images))


def _infos(*infos: dict[str, object]) -> Maker:
    def make(folder: Path) -> Path:
        lenses = [("/cam0/camera_info", CAMERA_INFO, m, bags.START_NS) for m in infos]
        return bags.write_bag(folder / "a.mcap", [*lenses, *bags.camera()[1:]])

    return make


def _same_name(folder: Path) -> Path:
    second = [("/cam0/other", *message[1:]) for message in bags.camera()[1:]]
    return bags.write_bag(folder / "a.mcap", [*bags.camera(), *second])


def _undecodable(folder: Path) -> Path:
    half = b"\x00\x01\x00\x00\x01\x02"
    kinds = {"/cam0/camera_info": CAMERA_INFO, "/cam0/person_poses": POSES}
    return bags.write_raw(
        folder / "a.mcap", [(topic, kind, schema_text(kind), half) for topic, kind in kinds.items()]
    )


def _other_encoding(folder: Path) -> Path:
    kinds = {"/cam0/camera_info": CAMERA_INFO, "/cam0/person_poses": POSES}
    return bags.write_raw(
        folder / "a.mcap",
        [(topic, kind, "{}", b"{}") for topic, kind in kinds.items()],
        encodings=("json", "jsonschema"),
    )


def _another_type_without_definition(folder: Path) -> Path:
    """Text after a header that our definition takes for an image without persons."""
    info = ("/cam0/camera_info", CAMERA_INFO, schema_text(CAMERA_INFO), None)
    other = CdrWriter()
    for number in (1_760_000_000, 0):
        other.uint32(number)
    for text in ("cam0", "h36m_17"):
        other.string(text)
    for _ in range(8):
        other.uint32(0)
    return bags.write_raw(
        folder / "a.mcap", [info, ("/cam0/person_poses", POSES, "", other.data())]
    )


def _no_images(folder: Path) -> Path:
    kinds = {"/cam0/camera_info": CAMERA_INFO, "/cam0/person_poses": POSES}
    return bags.write_raw(
        folder / "a.mcap", [(topic, kind, schema_text(kind), None) for topic, kind in kinds.items()]
    )


def _folder_of_bags(folder: Path) -> Path:
    for name in ("walk_a", "walk_b"):
        (folder / name).mkdir()
        bags.write_bag(folder / name / "a.mcap", bags.camera())
    return folder


def _packed(folder: Path) -> Path:
    path = folder / "a.mcap.gz"
    path.write_bytes(gzip.compress(b"\x89MCAP0\r\n"))
    return path


CASES: dict[str, tuple[Maker, str]] = {
    "folder of bags": (_folder_of_bags, r"is a folder of 2 bags: name one of walk_a, walk_b; if"),
    "packed": (_packed, r"a\.mcap\.gz is packed: unpack it, and name the bag in it"),
    "pipe": (_pipe, r"a\.mcap is neither a file nor a folder: name a bag"),
    "no such file": (_no_such_file, r"no such bag: .*missing\.mcap"),
    "empty file": (_no_bytes, r"a\.mcap is empty"),
    "no MCAP": (_no_mcap, r"is not a bag: it begins with b'this is "),
    "damaged sqlite": (_damaged_sqlite, r"is damaged \(.*`sqlite3 .*a\.db3 \.recover \| sqlite3 "),
    "other sqlite": (_other_sqlite, r"'topics' has no serialization_format, type"),
    "ROS 1": (_ros1, r"is a ROS 1 bag; `rosbags-convert --src .*a\.bag --dst a`"),
    "empty files": (_folder_of_empty_files, r"all 2 files are empty \(0 bytes\)"),
    "truncated": (_truncated, r"is truncated: .*`mcap recover "),
    "damaged": (_damaged, r"is damaged \(.*`mcap recover "),
    "no messages": (_no_messages, r"empty bag: it has no topics"),
    "no pose topics": (
        _no_poses,
        (
            r"no topic of type stcalib_ros/msg/PersonPose3DArray or .*; "
            r"the bag has /cam0/camera_info "
            r"\(sensor_msgs/msg/CameraInfo\), /chatter \(std_msgs/msg/String\)"
        ),
    ),
    "folder without bag": (_empty_folder, r"is not a bag: .* but notes\.txt"),
    "file of folder missing": (_folder_with_a_missing_file, r"files that are missing: a\.mcap"),
    "other metadata": (_folder_with_other_metadata, r"not rosbag2 metadata"),
    "broken metadata": (_folder_with_broken_metadata, r"not valid YAML"),
    "other schema": (
        _other_schema,
        (
            r"another definition of stcalib_ros/msg/PersonPose3DArray \(- bag, \+ ours\): "
            r"stcalib_ros/PersonPose3D: - float64\[\] joints; .*\+ float32\[\] joints"
        ),
    ),
    "other encoding": (_other_encoding, r"encoded as 'json' with a definition as 'jsonschema'"),
    "undecodable": (_undecodable, r"logged at 1760000000\.000000000 cannot be decoded as sensor_"),
    "unknown layout": (
        _images(bags.poses(0, layout="mine")),
        r"/cam0/person_poses: unknown layout 'mine'",
    ),
    "wrong length": (
        _images(bags.poses(0, [bags.person(5, joints=[0.0] * 50)])),
        (
            r"/cam0/person_poses, stamp 1760000000\.000000000, track 5: joints has 50 numbers, but "
            r"layout 'h36m_17' with 17 joints takes 51"
        ),
    ),
    "wrong length of keypoints": (
        _images(bags.poses(0, [bags.person(5, joints=[], keypoints=[0.0] * 51)])),
        r"track 5: keypoints has 51 numbers, but layout 'h36m_17' with 17 joints takes 34",
    ),
    "wrong length of scores": (
        _images(bags.poses(0, [bags.person(joint_scores=[0.0])])),
        r"joint_scores has 1 numbers, .* takes 17",
    ),
    "layout changes": (
        _images(
            bags.poses(0),
            bags.poses(1, [], layout="coco_17"),
        ),
        r"layout changes from 'h36m_17' with joints .* to 'coco_17'",
    ),
    "rectified changes": (
        _images(bags.poses(0), bags.poses(1, rectified=True)),
        r"rectified changes from False \(stamp 1760000000.0.*\) to True \(stamp 1760000000\.1",
    ),
    "metric changes": (
        _images(bags.poses(0), bags.poses(1, metric=False)),
        r"metric changes from True .* to False",
    ),
    "frame changes": (
        _images(bags.poses(0), bags.poses(1, header=bags.header(bags.START_NS + 1, "b"))),
        r"frame_id changes from 'cam0_optical_frame' .* to 'b' .*do two cameras publish",
    ),
    "stamp zero": (
        _images(bags.poses(0, header=bags.header(0))),
        r"/cam0/person_poses: header stamp is zero",
    ),
    "no CameraInfo": (
        lambda folder: bags.write_bag(folder / "a.mcap", bags.camera()[1:]),
        r"camera cam0: no CameraInfo on /cam0/camera_info: there is no such topic; the bag has no ",
    ),
    "CameraInfo elsewhere": (
        lambda folder: bags.write_bag(
            folder / "a.mcap",
            [
                *bags.camera()[1:],
                ("/lens", bags.CAMERA_INFO, bags.info(header=bags.header(1, "lens")), 1),
            ],
        ),
        r"the bag has sensor_msgs/msg/CameraInfo on /lens",
    ),
    "CameraInfo changes": (
        _infos(bags.info(), bags.info(width=320)),
        r"/cam0/camera_info: CameraInfo changes in the middle: width is 640 at .* and 320 at ",
    ),
    "absurd lens": (
        _infos(bags.info(k=[-1.0, *bags.info()["k"][1:]])),
        r"/cam0/camera_info: .*K is not a pinhole matrix",
    ),
    "no images": (_no_images, r"a\.mcap holds no person poses: no message on /cam0/person_poses"),
    "no definition": (
        _another_type_without_definition,
        r"cannot be decoded as .* bytes are left: it was written with another definition",
    ),
    "two cameras have the same name": (
        _same_name,
        r"two cameras have the same name, 'cam0': /cam0/other and /cam0/person_poses",
    ),
    "no finite keypoint": (
        _images(bags.poses(0, [bags.person(keypoints=[np.nan] * 34)])),
        r"all keypoints of all persons are NaN, infinite or \(0, 0\) in every camera \(cam0\)",
    ),
    "keypoints at zero": (
        _images(bags.poses(0, [bags.person(keypoints=[0.0] * 34)])),
        r"all keypoints of all persons are NaN",
    ),
    "frame that cannot be printed": (
        _images(bags.poses(0, header=bags.header(bags.START_NS, "a\x1b[31mb\n"))),
        r"/cam0/person_poses: frame_id: expected a name of 1 to 256 printable characters",
    ),
    "no keypoints": (
        _images(bags.poses(0, [bags.person(keypoints=[])])),
        r"all keypoints of all persons are NaN",
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_bad_bag(tmp_path: Path, case: str, capsys: pytest.CaptureFixture[str]) -> None:
    make, message = CASES[case]
    folder = tmp_path / "bag"
    folder.mkdir()
    path = make(folder)
    with pytest.raises(InputError, match=message) as caught:
        read_bag(path)
    assert "\n" not in str(caught.value)
    output = tmp_path / "out.yaml"
    assert main(["calibrate", str(path), "--output", str(output), "--quiet"]) == 2
    lines = [x for x in capsys.readouterr().err.splitlines() if "warning:" not in x]
    assert lines == [f"stcalib: {caught.value}"]
    assert [p.name for p in tmp_path.iterdir()] == ["bag"]


def test_one_blind_camera_is_only_a_warning(tmp_path: Path) -> None:
    blind = bags.camera("cam1", [bags.poses(0, [bags.person(keypoints=[np.nan] * 34)])])
    path = bags.write_bag(tmp_path / "a.mcap", [*bags.camera("cam0"), *blind])
    warnings: list[str] = []
    assert len(read_bag(path, warn=warnings.append).cameras) == 2
    assert "camera cam1: all keypoints of all persons are NaN, infinite or (0, 0)" in warnings


def test_comments_and_spaces_of_the_definition_do_not_matter(tmp_path: Path) -> None:
    lines = schema_text(POSES).splitlines()
    text = "\n".join(line.split("#")[0].replace(" ", "   ") for line in lines if line)
    text = text.replace("MSG:   ", "MSG: ").replace("std_msgs/Header\n", "std_msgs/Header\n# x\n")
    path = bags.write_bag(tmp_path / "a.mcap", bags.camera(), schemas={POSES: text})
    assert len(read_bag(path).cameras[0].stamps) == 3


def test_truncation_anywhere_is_reported(tmp_path: Path) -> None:
    write_bag(bags.small_recording(), tmp_path / "a.mcap")
    content = (tmp_path / "a.mcap").read_bytes()
    rng = random.Random(1)
    for length in [*range(12), *(rng.randrange(len(content)) for _ in range(50))]:
        (tmp_path / "b.mcap").write_bytes(content[:length])
        with pytest.raises(InputError, match=r"truncated|is empty"):
            read_bag(tmp_path / "b.mcap")


def test_changed_bytes_never_give_another_error(tmp_path: Path) -> None:
    write_bag(bags.small_recording(), tmp_path / "a.mcap")
    content = (tmp_path / "a.mcap").read_bytes()
    rng = random.Random(2)
    refused = 0
    for _ in range(150):
        changed = bytearray(content)
        for _ in range(3):
            changed[rng.randrange(8, len(content) - 8)] = rng.randrange(256)
        (tmp_path / "b.mcap").write_bytes(changed)
        try:
            read_bag(tmp_path / "b.mcap")
        except InputError:
            refused += 1
    assert refused > 75
