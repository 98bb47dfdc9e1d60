"""The people of simulated scenes: bodies, motions, ways over the ground."""

import numpy as np
import pytest

from stcalib_ros.core.errors import InputError
from stcalib_ros.core.synthetic import MotionClip, PersonMotion, SceneOptions, simulate
from stcalib_ros.core.synthetic.clips import CyclicClip
from stcalib_ros.core.synthetic.people import make_people
from stcalib_ros.core.synthetic.skeleton import (
    LAYOUT,
    MIRROR,
    PARENTS,
    assemble,
    body_axes,
    bones_of,
    standard_lengths,
)
from stcalib_ros.io.mocap import read_clip, shipped_clips

CLIPS = shipped_clips()
SECONDS = np.arange(0, 10, 1 / 60)


def people_of(kind: str, n: int = 3, seed: int = 0) -> tuple[PersonMotion, ...]:
    return make_people(np.random.default_rng(seed), kind, n, (0.0, 10.0), 1.6, CLIPS)


def test_bones_and_joints_are_two_views_of_one_body():
    joints = CLIPS[0].joints
    directions, lengths = bones_of(joints)
    np.testing.assert_allclose(assemble(joints[:, 0], directions, lengths), joints, atol=1e-6)


def test_body_axes_of_a_person_who_faces_along_x():
    joints = np.zeros((17, 3))
    joints[LAYOUT.index("left_hip")] = [0, 0.1, 0]
    joints[LAYOUT.index("right_hip")] = [0, -0.1, 0]
    joints[LAYOUT.index("thorax")] = [0, 0, 0.5]
    np.testing.assert_allclose(body_axes(joints), np.eye(3), atol=1e-12)


def test_mirror_exchanges_left_and_right_and_is_its_own_inverse():
    names = np.array(LAYOUT.joint_names)
    assert names[MIRROR][LAYOUT.index("left_knee")] == "right_knee"
    assert names[MIRROR][LAYOUT.index("neck")] == "neck"
    assert (MIRROR[MIRROR] == np.arange(17)).all()


@pytest.mark.parametrize("clip", CLIPS, ids=[c.name for c in CLIPS])
def test_a_repeated_clip_has_no_seam(clip):
    cycle = CyclicClip(clip, np.random.default_rng(0))
    times = np.arange(0, 8, 1 / 240)
    joints = cycle.joints(times, times * cycle.speed, cycle.lengths)
    speed = np.linalg.norm(np.diff(joints, axis=0), axis=-1) * 240
    recorded = np.linalg.norm(np.diff(clip.joints, axis=0), axis=-1) * clip.fps
    assert speed.max() < 1.6 * recorded.max() + 1.0


@pytest.mark.parametrize("kind", ["mocap", "procedural", "gesturing", "standing", "alike"])
def test_bones_keep_their_length_and_feet_stay_near_the_floor(kind):
    for person in people_of(kind):
        joints = person(SECONDS)
        bones = np.linalg.norm(joints[:, 1:] - joints[:, PARENTS[1:]], axis=-1)
        np.testing.assert_allclose(bones, np.tile(person.lengths[1:], (len(bones), 1)), atol=0.01)
        ankles = joints[:, [LAYOUT.index("left_ankle"), LAYOUT.index("right_ankle")], 2]
        assert -0.05 < ankles.min() < 0.25


def test_people_differ_in_size():
    lengths = [person.lengths.sum() for person in people_of("procedural", 6)]
    assert np.ptp(lengths) > 0.05 * np.mean(lengths)


@pytest.mark.parametrize("kind", ["mocap", "procedural"])
@pytest.mark.parametrize("seed", range(4))
def test_people_do_not_walk_through_one_another(kind, seed):
    roots = np.stack([p(SECONDS)[:, 0, :2] for p in people_of(kind, 3, seed)])
    gap = np.linalg.norm(roots[:, None] - roots[None], axis=-1)[np.triu_indices(3, 1)]
    assert gap.min() > 0.3
    assert np.percentile(gap, 1) > 0.4


def test_walkers_cover_ground_and_face_where_they_go():
    for person in people_of("procedural"):
        joints = person(SECONDS)
        step = np.diff(joints[:, 0, :2], axis=0)
        speed = np.linalg.norm(step, axis=-1) * 60
        assert 0.2 < speed.mean() < 1.5
        ahead = body_axes(joints)[:-1, 0, :2]
        walking = speed > 0.5
        cosine = np.sum(ahead * step, axis=-1)[walking] / np.linalg.norm(step[walking], axis=-1)
        assert np.median(cosine) > 0.9


def test_standing_people_do_not_move_and_gesturing_ones_stay():
    for person in people_of("standing"):
        np.testing.assert_allclose(np.ptp(person(SECONDS), axis=0), 0, atol=1e-9)
    for person in people_of("gesturing"):
        joints = person(SECONDS)
        assert np.ptp(joints[:, 0, :2], axis=0).max() < 0.05
        assert np.ptp(joints[:, LAYOUT.index("left_wrist")], axis=0).max() > 0.2


def test_motion_is_smooth_between_samples():
    person = people_of("procedural")[0]
    fine = np.arange(1, 2, 1e-3)
    acceleration = np.linalg.norm(np.diff(person(fine), 2, axis=0), axis=-1) * 1e6
    assert acceleration.max() < 100


def test_without_clips_mocap_people_walk_procedurally():
    options = SceneOptions(n_frames=20)
    given = simulate(options).joints_world(np.zeros(1))
    procedural = simulate(SceneOptions(n_frames=20, people="procedural")).joints_world(np.zeros(1))
    np.testing.assert_array_equal(given, procedural)


def test_unusable_clips_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"shape \(F, 17, 3\), got \(50, 16, 3\)"):
        MotionClip("x", 30.0, np.zeros((50, 16, 3)), locomotion=True)
    with pytest.raises(InputError, match=r"shorter than 1\.0 s"):
        MotionClip("x", 30.0, np.zeros((20, 17, 3)), locomotion=False)
    with pytest.raises(InputError, match="finite"):
        MotionClip("x", 30.0, np.full((50, 17, 3), np.nan), locomotion=True)
    np.savez(tmp_path / "other.npz", x=1)
    whole = (tmp_path / "other.npz").read_bytes()
    for content in (b"", b"PK", whole[:100], whole):
        (tmp_path / "clip.npz").write_bytes(content)
        with pytest.raises(InputError, match="not a motion clip"):
            read_clip(tmp_path / "clip.npz")
    with pytest.raises(InputError, match="no such file"):
        read_clip(tmp_path / "absent.npz")


def test_standard_body_is_of_human_size():
    lengths = standard_lengths()
    leg = lengths[LAYOUT.index("left_knee")] + lengths[LAYOUT.index("left_ankle")]
    assert 0.75 < leg < 0.95


def test_people_who_are_alike_differ_by_where_they_are():
    times = np.linspace(0.0, 10.0, 50)
    one, other = people_of("alike")[:2]
    apart = other(times) - one(times)
    np.testing.assert_allclose(apart, np.broadcast_to(apart[0, 0], apart.shape), atol=1e-9)
    assert np.linalg.norm(apart[0, 0, :2]) > 0.1
    assert abs(apart[0, 0, 2]) < 1e-9
