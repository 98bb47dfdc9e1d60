from __future__ import annotations

import dataclasses
import shutil
from pathlib import Path

import bag_helpers as bags
import hypothesis.extra.numpy as hnp
import hypothesis.strategies as st
import numpy as np
import pytest
import yaml
from bag_helpers import POSES, schema_text
from hypothesis import HealthCheck, given, settings
from mcap.reader import make_reader
from mcap.records import Schema
from mcap.writer import CompressionType, IndexType, Writer
from mcap_ros2.decoder import DecoderFactory

from stcalib_ros.core.errors import Cancelled
from stcalib_ros.core.model.keypoint_layouts import layout_from_names
from stcalib_ros.core.model.recording import Recording, Track, keypoints_only
from stcalib_ros.io.bag import read_bag
from stcalib_ros.io.bag_writer import write_bag
from stcalib_ros.io.topics import CameraSelection, CameraTopics


@pytest.mark.parametrize("name", ["bag.mcap", "bag"])
@pytest.mark.parametrize("rectified", [False, True])
def test_what_is_written_is_read(tmp_path: Path, name: str, rectified: bool) -> None:
    recording = bags.small_recording(rectified=rectified)
    write_bag(recording, tmp_path / name)
    bags.assert_same(recording, read_bag(tmp_path / name))
    assert [p.name for p in tmp_path.iterdir()] == [name]


def test_custom_layout_and_images_without_people(tmp_path: Path) -> None:
    recording = bags.small_recording(1)
    camera = recording.cameras[0]
    layout = layout_from_names([f"j{i}" for i in range(17)], name="ours")
    camera = dataclasses.replace(camera, layout=layout, tracks=camera.tracks[1:])
    recording = Recording((camera,), recording.epoch_ns)
    write_bag(recording, tmp_path / "bag.mcap")
    bags.assert_same(recording, read_bag(tmp_path / "bag.mcap"))


def some_unknown(recording: Recording, unknown: np.ndarray) -> Recording:
    """Of every track, without the 3D poses of some frames."""
    joints = np.where(unknown[:, None, None], np.nan, 1.0)
    cameras = (
        dataclasses.replace(
            camera,
            tracks=tuple(
                dataclasses.replace(t, joints=t.joints * joints[t.frames]) for t in camera.tracks
            ),
        )
        for camera in recording.cameras
    )
    return Recording(tuple(cameras), recording.epoch_ns)


def joints_in(path: Path) -> list[int]:
    """Numbers in `joints` of every person, by a decoder that is not ours."""
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        messages = [m.decoded_message for m in reader.iter_decoded_messages()]
    images = [m for m in messages if hasattr(m, "persons")]
    return [len(person.joints) for image in images for person in image.persons]


def test_keypoints_alone_are_written_without_3d_poses_and_read(tmp_path: Path) -> None:
    recording = keypoints_only(bags.small_recording())
    write_bag(recording, tmp_path / "bag.mcap")
    warnings: list[str] = []
    read = read_bag(tmp_path / "bag.mcap", warn=warnings.append)
    bags.assert_same(recording, read)
    assert warnings == []
    assert set(joints_in(tmp_path / "bag.mcap")) == {0}
    unknown = [track.joints for camera in read.cameras for track in camera.tracks]
    assert all(joints.strides[0] == 0 for joints in unknown), "they take no memory"


@given(unknown=hnp.arrays(bool, 5), n_only=st.integers(0, 2))
@settings(max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_3d_poses_of_some_cameras_and_images(
    tmp_path: Path, unknown: np.ndarray, n_only: int
) -> None:
    whole = some_unknown(bags.small_recording(), unknown)
    without = keypoints_only(whole).cameras[:n_only]
    recording = Recording((*without, *whole.cameras[n_only:]), whole.epoch_ns)
    write_bag(recording, tmp_path / "bag.mcap")
    bags.assert_same(recording, read_bag(tmp_path / "bag.mcap"))
    given_3d = [
        n
        for camera in recording.cameras
        for t in camera.tracks
        for n in np.isfinite(t.joints).any((1, 2))
    ]
    assert sorted(joints_in(tmp_path / "bag.mcap")) == sorted(51 * n for n in given_3d)


def test_persons_of_one_image_with_and_without_3d_pose(tmp_path: Path) -> None:
    persons = [bags.person(1), bags.person(2, joints=[]), bags.person(3, joints=[np.nan] * 51)]
    path = bags.write_bag(tmp_path / "a.mcap", bags.camera(images=[bags.poses(0, persons)]))
    tracks = read_bag(path).cameras[0].tracks
    assert [bool(np.isfinite(t.joints).all()) for t in tracks] == [True, False, False]
    assert all(np.isfinite(t.keypoints).all() for t in tracks)


finite32 = st.floats(-1e6, 1e6, width=32)


@settings(
    max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    stamps=st.lists(st.integers(0, 10**12), min_size=1, max_size=6, unique=True).map(sorted),
    data=st.data(),
)
def test_round_trip_of_any_numbers(tmp_path: Path, stamps: list[int], data: st.DataObject) -> None:
    n = len(stamps)
    frames = np.array(sorted(data.draw(st.sets(st.integers(0, n - 1), min_size=1))))
    shape = (len(frames), bags.LAYOUT.n_joints)
    track = Track(
        data.draw(st.integers(0, 2**32 - 1)),
        frames,
        data.draw(hnp.arrays(np.float32, (*shape, 2), elements=finite32.filter(bool))).astype(
            float
        ),
        data.draw(hnp.arrays(np.float32, (*shape, 3), elements=finite32)).astype(float),
        data.draw(hnp.arrays(np.float32, shape, elements=st.floats(0, 1, width=32))).astype(float),
    )
    epoch_ns = bags.START_NS + stamps[0] // 10**9 * 10**9
    camera = dataclasses.replace(
        bags.small_recording(1).cameras[0],
        stamps=(bags.START_NS - epoch_ns + np.array(stamps)) / 1e9,
        tracks=(track,),
    )
    recording = Recording((camera,), epoch_ns)
    write_bag(recording, tmp_path / "bag.mcap")
    bags.assert_same(recording, read_bag(tmp_path / "bag.mcap"))


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize("chunk_size", [100, 1024 * 1024])
def test_compressed_chunks(tmp_path: Path, compression: CompressionType, chunk_size: int) -> None:
    plain = read_bag(bags.write_bag(tmp_path / "a.mcap", bags.camera()))
    path = bags.write_bag(
        tmp_path / "b.mcap", bags.camera(), compression=compression, chunk_size=chunk_size
    )
    bags.assert_same(plain, read_bag(path))


@pytest.mark.parametrize("chunked", [False, True])
def test_bag_without_index(tmp_path: Path, chunked: bool) -> None:
    recording = bags.small_recording()
    write_bag(recording, tmp_path / "a.mcap")
    with (tmp_path / "a.mcap").open("rb") as source, (tmp_path / "b.mcap").open("wb") as target:
        _copy_without_index(source, target, chunked)
    bags.assert_same(recording, read_bag(tmp_path / "b.mcap"))


def _copy_without_index(source: object, target: object, chunked: bool) -> None:
    writer = Writer(
        target,
        index_types=IndexType.NONE,
        use_chunking=chunked,
        repeat_channels=False,
        repeat_schemas=False,
        use_statistics=False,
        use_summary_offsets=False,
    )
    writer.start(profile="ros2", library="test")
    channels: dict[str, int] = {}
    for schema, channel, message in make_reader(source).iter_messages():
        if channel.topic not in channels:
            schema_id = writer.register_schema(schema.name, schema.encoding, schema.data)
            channels[channel.topic] = writer.register_channel(channel.topic, "cdr", schema_id)
        writer.add_message(
            channels[channel.topic], message.log_time, message.data, message.publish_time
        )
    writer.finish()


def test_order_in_the_bag_does_not_matter(tmp_path: Path) -> None:
    messages = bags.camera("cam0") + bags.camera("cam1")
    ordered = read_bag(bags.write_bag(tmp_path / "a.mcap", messages))
    shuffled = [messages[i] for i in np.random.default_rng(1).permutation(len(messages))]
    bags.assert_same(ordered, read_bag(bags.write_bag(tmp_path / "b.mcap", shuffled)))


def test_times_of_receipt_are_those_of_the_bag(tmp_path: Path) -> None:
    """`write_bag` logs the stamps; they are kept apart from these."""
    bag = tmp_path / "bag.mcap"
    write_bag(bags.small_recording(), bag)
    for camera in read_bag(bag).cameras:
        assert camera.received is not None
        np.testing.assert_allclose(camera.received, camera.stamps, atol=1e-6)


def test_other_topics_are_ignored(tmp_path: Path) -> None:
    chatter = ("/chatter", "std_msgs/msg/String", {"data": "hello"}, bags.START_NS)
    path = bags.write_bag(tmp_path / "a.mcap", [chatter, *bags.camera()])
    assert [c.name for c in read_bag(path).cameras] == ["cam0"]


@pytest.mark.parametrize("with_metadata", [False, True])
def test_folder_of_several_files(tmp_path: Path, with_metadata: bool) -> None:
    whole = bags.camera(images=[bags.poses(k) for k in range(12)])
    folder = tmp_path / "walk"
    folder.mkdir()
    names = [f"walk_{i}.mcap" for i in range(12)]
    for name, message in zip(names, whole[1:], strict=True):
        bags.write_bag(folder / name, [message])
    bags.write_bag(folder / "walk_12.mcap", whole[:1])
    if with_metadata:
        listing = {"storage_identifier": "mcap", "relative_file_paths": [*names, "walk_12.mcap"]}
        text = yaml.safe_dump({"rosbag2_bagfile_information": listing})
        (folder / "metadata.yaml").write_text(text)
    expected = read_bag(bags.write_bag(tmp_path / "whole.mcap", whole))
    bags.assert_same(expected, read_bag(folder))


def test_progress_rises_to_the_end(tmp_path: Path) -> None:
    images = [bags.poses(k) for k in range(700)]
    path = bags.write_bag(tmp_path / "a.mcap", bags.camera(images=images), chunk_size=10_000)
    seen: list[tuple[str, float]] = []
    read_bag(path, progress=lambda *args: seen.append(args))
    fractions = [f for _, f in seen]
    assert fractions == sorted(fractions)
    assert (fractions[0], fractions[-1]) == (0.0, 1.0)
    assert len(fractions) > 3


def test_reading_can_be_stopped_by_the_progress_callback(tmp_path: Path) -> None:
    path = bags.write_bag(tmp_path / "a.mcap", bags.camera())

    def stop(stage: str, fraction: float) -> None:
        raise Cancelled("stopped")

    with pytest.raises(Cancelled):
        read_bag(path, progress=stop)


def test_decoder_is_asked_for_every_message(tmp_path: Path) -> None:
    path = bags.write_bag(tmp_path / "a.mcap", bags.camera())
    asked = []

    def decoder(type_name: str, data: bytes) -> object:
        asked.append(type_name)
        schema = Schema(1, schema_text(type_name).encode(), "ros2msg", type_name)
        return DecoderFactory().decoder_for("cdr", schema)(data)

    bags.assert_same(read_bag(path), read_bag(path, decoder=decoder))
    assert len(asked) == 4


def test_cameras_are_ordered_by_number(tmp_path: Path) -> None:
    messages = [m for name in ("cam10", "cam2", "site/cam1") for m in bags.camera(name)]
    path = bags.write_bag(tmp_path / "a.mcap", messages)
    assert [c.name for c in read_bag(path).cameras] == ["cam2", "cam10", "site/cam1"]


def test_chosen_cameras_and_topics(tmp_path: Path) -> None:
    messages = bags.camera("cam0") + bags.camera("cam1") + bags.camera("left/pose")
    path = bags.write_bag(tmp_path / "a.mcap", messages)
    own = CameraTopics("/left/pose/person_poses", "/cam1/camera_info", "left_frame")
    selection = CameraSelection(("left", "cam0"), {"left": own})
    recording = read_bag(path, selection=selection)
    assert [c.name for c in recording.cameras] == ["left", "cam0"]
    assert recording.cameras[0].frame_id == "left_frame"
    everything = read_bag(path, selection=CameraSelection(None, {"left": own}))
    assert [c.name for c in everything.cameras] == ["cam0", "cam1", "left"]


def test_stamps_are_seconds_since_a_whole_second(tmp_path: Path) -> None:
    images = [
        bags.poses(0, header=bags.header(bags.START_NS + ns)) for ns in (1_500_000_001, 2 * 10**9)
    ]
    recording = read_bag(bags.write_bag(tmp_path / "a.mcap", bags.camera(images=images)))
    assert recording.epoch_ns == bags.START_NS + 10**9
    assert recording.cameras[0].stamps.tolist() == [0.500000001, 1.0]


def test_not_observed_is_nan(tmp_path: Path) -> None:
    J = bags.LAYOUT.n_joints
    odd = bags.person(
        keypoints=[np.nan, 1.0, np.inf, 2.0, 0.0, 0.0, 0.0, 7.0] + [5.0] * (2 * J - 8),
        joints=[1.0, 2.0, -np.inf, 1e30, 0.0, 0.0] + [1.0] * (3 * J - 6),
        joint_scores=[np.nan] + [0.25] * (J - 1),
    )
    warnings: list[str] = []
    path = bags.write_bag(tmp_path / "a.mcap", bags.camera(images=[bags.poses(0, [odd])]))
    (track,) = read_bag(path, warn=warnings.append).cameras[0].tracks
    assert np.isnan(track.keypoints[0, :3]).all(), "(0, 0) is no position either"
    assert np.isfinite(track.keypoints[0, 3:]).all()
    assert np.isnan(track.joints[0, :2]).all(), "1e30 is as good as infinite"
    assert np.isfinite(track.joints[0, 2:]).all()
    assert track.scores[0, :2].tolist() == [0.0, 0.25]
    assert warnings == ["/cam0/person_poses: 3 infinite values are taken as not observed"]


def test_empty_fields_are_not_given(tmp_path: Path) -> None:
    images = [bags.poses(0), bags.poses(1, [bags.person(joints=[], joint_scores=[])])]
    (track,) = (
        read_bag(bags.write_bag(tmp_path / "a.mcap", bags.camera(images=images))).cameras[0].tracks
    )
    assert np.isnan(track.joints[1]).all()
    assert (track.scores[1] == 1.0).all()


def test_of_duplicates_the_better_is_kept(tmp_path: Path) -> None:
    J = bags.LAYOUT.n_joints
    images = [
        bags.poses(0, [bags.person(1, score=0.4, joint_scores=[0.4] * J), bags.person(2)]),
        bags.poses(
            1, [bags.person(1, score=0.2), bags.person(1, score=0.9, joint_scores=[0.9] * J)]
        ),
        bags.poses(0, [bags.person(1, score=0.1)]),
    ]
    warnings: list[str] = []
    path = bags.write_bag(tmp_path / "a.mcap", bags.camera(images=images))
    first, second = read_bag(path, warn=warnings.append).cameras[0].tracks
    assert first.frames.tolist() == [0, 1]
    assert first.scores[:, 0] == pytest.approx([0.4, 0.9])
    assert second.frames.tolist() == [0]
    assert [w.split(":")[1].split()[0] for w in warnings] == ["1", "1"]


def test_silent_camera_is_left_out_with_a_warning(tmp_path: Path) -> None:
    folder = tmp_path / "walk"
    folder.mkdir()
    bags.write_bag(folder / "a.mcap", bags.camera("cam0"))
    shutil.copy(bags.write_bag(tmp_path / "b.mcap", bags.camera("cam1", [])), folder)
    bags.write_raw(folder / "c.mcap", [("/cam1/person_poses", POSES, schema_text(POSES), None)])
    warnings: list[str] = []
    recording = read_bag(folder, warn=warnings.append)
    assert [c.name for c in recording.cameras] == ["cam0"]
    assert warnings == ["camera cam1 is left out: no message on /cam1/person_poses"]


def test_shared_frame_is_reported(tmp_path: Path) -> None:
    warnings: list[str] = []
    path = bags.write_bag(tmp_path / "a.mcap", bags.camera("cam0") + bags.camera("cam1"))
    read_bag(path, warn=warnings.append)
    assert warnings == [
        "cameras cam0 and cam1 have one frame_id, 'cam0_optical_frame'; set camera.cam1.frame"
    ]
