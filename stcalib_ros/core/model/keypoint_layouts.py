"""Joint layouts as data: names and parents; another layout comes in by its joint names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from stcalib_ros.core.errors import InputError

_BODY_PARENT = {
    "right_hip": "pelvis",
    "right_knee": "right_hip",
    "right_ankle": "right_knee",
    "left_hip": "pelvis",
    "left_knee": "left_hip",
    "left_ankle": "left_knee",
    "spine": "pelvis",
    "thorax": "spine",
    "neck": "thorax",
    "head": "neck",
    "head_top": "head",
    "left_shoulder": "thorax",
    "left_elbow": "left_shoulder",
    "left_wrist": "left_elbow",
    "right_shoulder": "thorax",
    "right_elbow": "right_shoulder",
    "right_wrist": "right_elbow",
    "left_hand": "left_wrist",
    "right_hand": "right_wrist",
    "left_foot": "left_ankle",
    "right_foot": "right_ankle",
    "left_heel": "left_ankle",
    "right_heel": "right_ankle",
    "left_big_toe": "left_ankle",
    "right_big_toe": "right_ankle",
    "left_small_toe": "left_big_toe",
    "right_small_toe": "right_big_toe",
    "left_foot_index": "left_heel",
    "right_foot_index": "right_heel",
    "left_pinky": "left_wrist",
    "right_pinky": "right_wrist",
    "left_index": "left_wrist",
    "right_index": "right_wrist",
    "left_thumb": "left_wrist",
    "right_thumb": "right_wrist",
    "nose": "neck",
    "left_eye": "nose",
    "right_eye": "nose",
    "left_eye_inner": "nose",
    "right_eye_inner": "nose",
    "left_eye_outer": "left_eye",
    "right_eye_outer": "right_eye",
    "left_ear": "left_eye",
    "right_ear": "right_eye",
    "mouth_left": "nose",
    "mouth_right": "nose",
    "spine1": "pelvis",
    "spine2": "spine1",
    "spine3": "spine2",
    "left_collar": "spine3",
    "right_collar": "spine3",
}
"""Usual parent of a joint, by name; where a layout lacks it, its own parent serves."""


TRUNK_JOINTS = ("left_hip", "right_hip", "left_shoulder", "right_shoulder")
"""Joints whose mean is the middle of the body."""

_N_FACE = 68
"""Landmarks of a face, count, as COCO-WholeBody and Halpe number them. Definition."""
_FINGERS = ("thumb", "forefinger", "middle_finger", "ring_finger", "pinky_finger")


def _hand(side: str) -> tuple[str, ...]:
    """Return the 21 keypoints of a hand in the order of COCO-WholeBody."""
    fingers = (f"{side}_{finger}{k}" for finger in _FINGERS for k in range(1, 5))
    return (f"{side}_hand_root", *fingers)


_FACE = tuple(f"face-{k}" for k in range(_N_FACE))
DETAILS = frozenset((*_FACE, *_hand("left"), *_hand("right")))
"""Keypoints of faces and hands in whole-body layouts, which are read but not used: all points of a
face move as the nose does, those of a hand as the wrist, within the noise of keypoints at the
distances of a calibration, and they would be five sixths of the cost."""


@dataclass(frozen=True, slots=True)
class Layout:
    """Names and parents of the joints of one pose format.

    Attributes
    ----------
    name : str
        As in ``PersonPose3DArray.layout``.
    joint_names : tuple of str
        J names, in the order of the arrays.
    parents : tuple of int
        J indices into `joint_names`; -1 for a joint without a parent.
    """

    name: str
    joint_names: tuple[str, ...]
    parents: tuple[int, ...]

    def __post_init__(self) -> None:
        if len(self.parents) != len(self.joint_names):
            raise ValueError(
                f"layout {self.name!r}: {len(self.joint_names)} joint names but "
                f"{len(self.parents)} parents"
            )
        if len(set(self.joint_names)) != len(self.joint_names):
            twice = sorted({n for n in self.joint_names if self.joint_names.count(n) > 1})
            raise InputError(f"layout {self.name!r}: joint names given twice: {', '.join(twice)}")
        if bad := [p for p in self.parents if not -1 <= p < len(self.parents)]:
            raise ValueError(f"layout {self.name!r}: no such parent index: {bad}")

    @property
    def n_joints(self) -> int:
        """Number of joints J."""
        return len(self.joint_names)

    def index(self, name: str) -> int:
        """Index of a joint.

        Raises
        ------
        KeyError
            The layout has no joint of that name.
        """
        try:
            return self.joint_names.index(name)
        except ValueError:
            raise KeyError(name) from None


def layout_from_names(
    joint_names: Sequence[str], *, name: str = "custom", parent_of: dict[str, str] | None = None
) -> Layout:
    """Layout of the given joints, with the parents that such names usually have.

    Parameters
    ----------
    joint_names : sequence of str
        In the order of the arrays. Names are those of the built-in layouts
        (``left_knee``, ``neck``, ...); an unknown name is a joint without a parent,
        which still serves as a keypoint.
    name : str
        The layout's own name.
    parent_of : dict, optional
        Parents by name that take precedence over the usual ones.

    Raises
    ------
    InputError
        A name is given twice.
    """
    table = _BODY_PARENT | (parent_of or {})
    index = {n: i for i, n in enumerate(joint_names)}

    def parent(joint: str) -> int:
        up = table.get(joint)
        while up is not None and up not in index:
            up = table.get(up)
        return -1 if up is None else index[up]

    return Layout(name, tuple(joint_names), tuple(parent(n) for n in joint_names))


_H36M_17 = (
    "pelvis right_hip right_knee right_ankle left_hip left_knee left_ankle spine thorax neck "
    "head left_shoulder left_elbow left_wrist right_shoulder right_elbow right_wrist"
).split()
_COCO_17 = (
    "nose left_eye right_eye left_ear right_ear left_shoulder right_shoulder left_elbow "
    "right_elbow left_wrist right_wrist left_hip right_hip left_knee right_knee left_ankle "
    "right_ankle"
).split()
_COCO_19 = (
    "neck nose pelvis left_shoulder left_elbow left_wrist left_hip left_knee left_ankle "
    "right_shoulder right_elbow right_wrist right_hip right_knee right_ankle left_eye left_ear "
    "right_eye right_ear"
).split()
_BODY_25 = (
    "nose neck right_shoulder right_elbow right_wrist left_shoulder left_elbow left_wrist "
    "pelvis right_hip right_knee right_ankle left_hip left_knee left_ankle right_eye left_eye "
    "right_ear left_ear left_big_toe left_small_toe left_heel right_big_toe right_small_toe "
    "right_heel"
).split()
_COCO_18 = (
    "nose neck right_shoulder right_elbow right_wrist left_shoulder left_elbow left_wrist "
    "right_hip right_knee right_ankle left_hip left_knee left_ankle right_eye left_eye right_ear "
    "left_ear"
).split()
_BODY_25B = (
    *_COCO_17,
    *("upper_neck", "head_top", "left_big_toe", "left_small_toe", "left_heel"),
    *("right_big_toe", "right_small_toe", "right_heel"),
)
_HALPE_26 = (
    *_COCO_17,
    *("head", "neck", "pelvis", "left_big_toe", "right_big_toe", "left_small_toe"),
    *("right_small_toe", "left_heel", "right_heel"),
)
_COCO_WHOLEBODY_133 = (
    *_COCO_17,
    *("left_big_toe", "left_small_toe", "left_heel"),
    *("right_big_toe", "right_small_toe", "right_heel"),
    *_FACE,
    *_hand("left"),
    *_hand("right"),
)
_BLAZEPOSE_33 = (
    "nose left_eye_inner left_eye left_eye_outer right_eye_inner right_eye right_eye_outer "
    "left_ear right_ear mouth_left mouth_right left_shoulder right_shoulder left_elbow "
    "right_elbow left_wrist right_wrist left_pinky right_pinky left_index right_index "
    "left_thumb right_thumb left_hip right_hip left_knee right_knee left_ankle right_ankle "
    "left_heel right_heel left_foot_index right_foot_index"
).split()
_SMPL_24 = (
    "pelvis left_hip right_hip spine1 left_knee right_knee spine2 left_ankle right_ankle spine3 "
    "left_foot right_foot neck left_collar right_collar head left_shoulder right_shoulder "
    "left_elbow right_elbow left_wrist right_wrist left_hand right_hand"
).split()
_BODY_38 = (
    "pelvis spine1 spine2 spine3 neck nose left_eye right_eye left_ear right_ear left_collar "
    "right_collar left_shoulder right_shoulder left_elbow right_elbow left_wrist right_wrist "
    "left_hip right_hip left_knee right_knee left_ankle right_ankle left_big_toe right_big_toe "
    "left_small_toe right_small_toe left_heel right_heel left_thumb right_thumb left_index "
    "right_index left_middle right_middle left_pinky right_pinky"
).split()

LAYOUTS: dict[str, Layout] = {
    "h36m_17": layout_from_names(_H36M_17, name="h36m_17"),
    "coco_17": layout_from_names(_COCO_17, name="coco_17"),
    "coco_18": layout_from_names(
        _COCO_18, name="coco_18", parent_of={"left_shoulder": "neck", "right_shoulder": "neck"}
    ),
    "coco_19": layout_from_names(_COCO_19, name="coco_19"),
    "coco_wholebody_133": layout_from_names(_COCO_WHOLEBODY_133, name="coco_wholebody_133"),
    "body_25": layout_from_names(_BODY_25, name="body_25"),
    "body_25b": layout_from_names(
        _BODY_25B, name="body_25b", parent_of={"nose": "upper_neck", "head_top": "upper_neck"}
    ),
    "halpe_26": layout_from_names(_HALPE_26, name="halpe_26"),
    "blazepose_33": layout_from_names(_BLAZEPOSE_33, name="blazepose_33"),
    "smpl_24": layout_from_names(
        _SMPL_24,
        name="smpl_24",
        parent_of={
            "neck": "spine3",
            "head": "neck",
            "left_shoulder": "left_collar",
            "right_shoulder": "right_collar",
        },
    ),
    "body_38": layout_from_names(
        _BODY_38,
        name="body_38",
        parent_of={
            "neck": "spine3",
            "left_shoulder": "left_collar",
            "right_shoulder": "right_collar",
            "left_middle": "left_wrist",
            "right_middle": "right_wrist",
        },
    ),
}
"""The layouts known by name (``PersonPose3DArray.layout``)."""


def find_layout(name: str, joint_names: Sequence[str] = ()) -> Layout:
    """Layout of a message: by its joint names where it carries them, else by its name.

    Raises
    ------
    InputError
        No layout of that name is known and no joint names are given.

    Examples
    --------
    >>> find_layout("coco_17").joint_names[:3]
    ('nose', 'left_eye', 'right_eye')
    >>> find_layout("", ["pelvis", "neck", "head"]).parents
    (-1, 0, 1)
    """
    if joint_names:
        known = LAYOUTS.get(name)
        if known is not None and known.joint_names == tuple(joint_names):
            return known
        return layout_from_names(joint_names, name=name or "custom")
    try:
        return LAYOUTS[name]
    except KeyError:
        raise InputError(
            f"unknown layout {name!r}: send its joint_names, or use one of {', '.join(LAYOUTS)}"
        ) from None
