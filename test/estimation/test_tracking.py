"""Persons followed from image to image: ids that last, and sides that are mended."""

from __future__ import annotations

import numpy as np
import pytest

import stcalib_ros as st
from stcalib_ros.core.errors import InputError
from stcalib_ros.core.model.keypoint_layouts import LAYOUTS
from stcalib_ros.core.model.skeleton import mirrored_joints
from stcalib_ros.estimation.poses import ImagePoses
from stcalib_ros.estimation.sides import sided_parts
from stcalib_ros.estimation.tracking import PersonTracker, TrackingOptions

LAYOUT = LAYOUTS["h36m_17"]
MIRROR = mirrored_joints(LAYOUT)
STANDING = np.array(
    [
        *([0, 0], [-12, 0], [-13, 45], [-12, 88], [12, 0], [13, 45], [12, 88], [0, -25]),
        *([0, -50], [0, -58], [0, -72], [20, -50], [26, -20], [30, 6], [-20, -50], [-26, -20]),
        [-30, 6],
    ],
    dtype=float,
)
"""Somebody who faces the camera, px about the pelvis."""


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def found(*poses, scores=1.0):
    keypoints = np.array(poses, dtype=float).reshape(-1, 17, 2)
    n = len(keypoints)
    return ImagePoses(keypoints, np.full((n, 17), scores), np.full((n, 17, 3), np.nan))


def at(x, y=200.0, size=1.0):
    return STANDING * size + [x, y]


def walk(rng, rate=10.0, seconds=4.0, speed=60.0, turn=0.0):
    """Stamps and poses of one person who walks, and turns about the vertical, rad/s."""
    stamps = np.cumsum(rng.uniform(0.8, 1.2, int(seconds * rate)) / rate)
    for stamp_s in stamps:
        pose = STANDING.copy()
        pose[:, 0] *= np.cos(turn * stamp_s)
        pose += rng.standard_normal(pose.shape)
        yield stamp_s, pose + np.array([100 + speed * stamp_s, 200])


@pytest.mark.parametrize("rate", [5.0, 10.0, 30.0])
def test_two_who_cross_keep_their_ids(rng, rate):
    tracker, period = PersonTracker(LAYOUT), 1 / rate
    seen = []
    for stamp_s in np.arange(0, 4, period):
        poses = [at(100 + 100 * stamp_s), at(500 - 100 * stamp_s, 210, 0.8)]
        order = rng.permutation(2)
        _, ids = tracker.follow(stamp_s, found(*(poses[k] for k in order)))
        seen.append([int(ids[list(order).index(k)]) for k in (0, 1)])
    assert [list(row) for row in set(map(tuple, seen))] == [seen[0]]


def follow_two(places):
    """Ids at each of the times, for as many people as have a place then."""
    tracker = PersonTracker(LAYOUT)
    return [
        tracker.follow(0.1 * k, found(*(at(x) for x in xs)))[1].tolist()
        for k, xs in enumerate(places)
    ]


MEETING = [(100, 220), (110, 210), (120, 200), (130, 190), (140, 180)]


@pytest.mark.parametrize("after", [[(150, 170), (140, 180)], [(170, 150), (180, 140)]])
def test_who_was_seen_as_one_with_somebody_else_gets_a_new_id(after):
    """Whether they walk on or turn back is not to be seen in the pose between them."""
    ids = follow_two([*MEETING, (160,), (160,), *after])
    assert ids[: len(MEETING)] == [[0, 1]] * len(MEETING)
    for later in ids[5:]:
        assert not {0, 1} & set(later)
    assert ids[-1] == ids[-2]


def test_where_it_is_clear_who_is_seen_both_keep_their_ids():
    ids = follow_two([*((x, 190) for x in range(100, 160, 10)), (160,), (170, 190)])
    assert ids == [[0, 1]] * 6 + [[0], [0, 1]]


def test_people_who_cannot_be_told_apart_get_one_new_id_each_not_one_an_image():
    ids = follow_two([(100, 130)] * 3 + [(115,)] * 4)
    assert ids[2] == [0, 1]
    assert len({row[0] for row in ids[3:]}) == 1


def test_a_gap_shorter_than_the_memory_keeps_the_id_and_a_longer_one_does_not():
    tracker = PersonTracker(LAYOUT)
    ids = [tracker.follow(s, found(at(100 + 80 * s)))[1][0] for s in (0.0, 0.1, 0.2, 0.6, 0.7, 1.8)]
    assert ids == [0, 0, 0, 0, 0, 1]


def test_a_slow_camera_has_tracks_as_well():
    tracker = PersonTracker(LAYOUT)
    assert [tracker.follow(s, found(at(100)))[1][0] for s in (0.0, 1.0, 2.0, 4.0)] == [0] * 4


def test_somebody_elsewhere_begins_a_track():
    tracker = PersonTracker(LAYOUT)
    tracker.follow(0.0, found(at(100)))
    assert tracker.follow(0.1, found(at(400)))[1].tolist() == [1]


def test_time_that_goes_back_begins_anew():
    tracker = PersonTracker(LAYOUT)
    assert [tracker.follow(s, found(at(100)))[1][0] for s in (5.0, 5.1, 1.0, 1.1)] == [0, 0, 1, 1]


def test_one_person_found_twice_is_returned_once_the_better():
    poses = found(at(100), at(102), at(300))
    poses.scores[0] = 0.5
    kept, ids = PersonTracker(LAYOUT).follow(0.0, poses)
    assert len(set(ids.tolist())) == 2
    np.testing.assert_array_equal(kept.keypoints, poses.keypoints[[1, 2]])


def test_poses_of_too_few_joints_are_left_out():
    poses = found(at(100), at(300))
    poses.scores[0, 5:] = 0.1
    kept, ids = PersonTracker(LAYOUT).follow(0.0, poses)
    np.testing.assert_array_equal(kept.keypoints, poses.keypoints[1:])
    assert len(ids) == 1


def test_no_persons_are_no_persons():
    tracker = PersonTracker(LAYOUT)
    for stamp_s in (0.0, 0.1):
        kept, ids = tracker.follow(stamp_s, found())
        assert kept.keypoints.shape == (0, 17, 2)
        assert len(ids) == 0


@pytest.mark.parametrize("part", [0, 1, 2])
@pytest.mark.parametrize("rate", [10.0, 30.0])
def test_exchanged_sides_are_mended(rng, part, rate):
    """Of the body, the arms and the legs; 2D, 3D and scores."""
    tracker, order = PersonTracker(LAYOUT), sided_parts(LAYOUT)[part].order
    joints = rng.standard_normal((17, 3))
    scores = rng.uniform(0.5, 1.0, 17)
    for stamp_s, pose in walk(rng, rate, turn=0.0):
        wrong = 1.0 < stamp_s % 2 < 1.3
        given = order if wrong else np.arange(17)
        image = ImagePoses(pose[given][None], scores[given][None], joints[given][None])
        kept, _ = tracker.follow(stamp_s, image)
        np.testing.assert_array_equal(kept.keypoints[0], pose)
        np.testing.assert_array_equal(kept.joints[0], joints)
        np.testing.assert_array_equal(kept.scores[0], scores)


def test_the_estimator_is_believed_in_the_end(rng):
    tracker, agreed = PersonTracker(LAYOUT), []
    for stamp_s, pose in walk(rng, seconds=14.0, speed=20.0):
        given = pose[MIRROR] if stamp_s > 2 else pose
        agreed.append(np.array_equal(tracker.follow(stamp_s, found(given))[0].keypoints[0], given))
    assert not agreed[25]
    assert all(agreed[-20:])


@pytest.mark.parametrize(("rate", "turn"), [(10.0, 3.0), (15.0, 5.0), (30.0, 6.0)])
def test_who_turns_round_is_left_as_found(rng, rate, turn):
    tracker = PersonTracker(LAYOUT)
    for stamp_s, pose in walk(rng, rate, turn=turn):
        np.testing.assert_array_equal(
            tracker.follow(stamp_s, found(pose))[0].keypoints[0], pose, err_msg=f"{stamp_s}"
        )


def test_sides_are_left_alone_if_asked(rng):
    tracker = PersonTracker(LAYOUT, TrackingOptions(mend_sides=False))
    for k, (stamp_s, pose) in enumerate(walk(rng)):
        given = pose[MIRROR] if k % 7 == 3 else pose
        kept, ids = tracker.follow(stamp_s, found(given))
        np.testing.assert_array_equal(kept.keypoints[0], given)
        assert ids.tolist() == [0]


def test_simulated_walkers_are_followed_without_an_exchange():
    scene = st.simulate(
        st.SceneOptions(
            n_cameras=1, n_people=3, n_frames=150, fps=10.0, flip_rate=0.0, id_switches_per_10s=0.0,
            people="procedural", image_size=(640, 480), focal_px=500.0, sigma_px=2.0,
        )
    )  # fmt: skip
    (camera,) = scene.recording.cameras
    tracker = PersonTracker(camera.layout)
    owners, changes, exchanged = {}, 0, 0
    for frame, stamp_s in enumerate(camera.stamps):
        tracks = [(t, np.flatnonzero(t.frames == frame)) for t in camera.tracks]
        poses = {t.track_id: t.keypoints[row[0]] for t, row in tracks if len(row)}
        kept, ids = tracker.follow(float(stamp_s), found(*poses.values()))
        for pose, made in zip(kept.keypoints, ids, strict=True):
            away = {name: np.nansum(np.abs(pose - p)) for name, p in poses.items()}
            track = min(away, key=away.get)
            exchanged += away[track] > 0
            changes += owners.setdefault(int(made), track) != track
    assert changes == 0
    assert exchanged <= 10, "legs that pass each other, of 450 poses"


@pytest.mark.parametrize("wrong", [{"min_score": 2.0}, {"memory_s": -1.0}, {"memory_s": np.nan}])
def test_options_out_of_range_are_named(wrong):
    with pytest.raises(InputError, match=next(iter(wrong))):
        TrackingOptions(**wrong)


@pytest.mark.parametrize("name", sorted(LAYOUTS))
def test_every_layout_has_sides(name):
    body, arms, legs = sided_parts(LAYOUTS[name])
    assert len(body.compared) >= len(arms.compared) + len(legs.compared) > 0
    for part in (body, arms, legs):
        np.testing.assert_array_equal(part.order[part.order], np.arange(LAYOUTS[name].n_joints))
