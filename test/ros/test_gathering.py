"""Persons who have a topic each make one image; without ROS."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from bag_helpers import START_NS, header, person

from stcalib_ros.io.message_types.pose_content import poses
from stcalib_ros.ros.gathering import Gatherer
from stcalib_ros.ros.limits import GATHER_S, MAX_GATHERED

STEP_S = 0.1


def message(k: float, *ids: int, frame: str = "optical"):
    stamp_ns = START_NS + round(k * STEP_S * 1e9)
    stamped = plain(header(stamp_ns, frame))
    return poses(stamped, [plain(person(i)) for i in ids], layout="coco_17")


def plain(fields):
    return SimpleNamespace(**{k: plain(v) if isinstance(v, dict) else v for k, v in fields.items()})


def given(gatherer: Gatherer, *messages) -> list[tuple[list[int], str]]:
    """Ids and frame of each image that was complete."""
    images = [image for one in messages for image in gatherer.add(one)]
    return [([p.track_id for p in image.persons], image.header.frame_id) for image in images]


def test_persons_of_one_stamp_are_one_image_in_the_order_of_stamps():
    gatherer, late = Gatherer(), GATHER_S / STEP_S
    sent = [message(0, 1), message(1, 2), message(0, 2), message(1, 1), message(late + 1, 1)]
    assert given(gatherer, *sent) == [([1, 2], "optical"), ([2, 1], "optical")]


def test_an_image_without_persons_has_the_frame_of_the_others():
    gatherer = Gatherer()
    assert given(gatherer, message(0, frame=""), message(20, 1), message(21, frame="")) == []
    assert given(gatherer, message(40, 1)) == [([1], "optical"), ([], "optical")]


def test_who_comes_too_late_is_left_out_and_a_clock_that_was_set_begins_anew():
    gatherer = Gatherer()
    given(gatherer, message(0, 1), message(1, 1), message(7, 1))
    with pytest.raises(ValueError, match=r"came more than 0\.5 s late"):
        gatherer.add(message(1, 2))
    assert given(gatherer, message(-600, 1), message(-590, 1)) == [([1], "optical")]


def test_what_waits_is_bounded():
    gatherer = Gatherer()
    images = given(gatherer, *(message(k / 1000, 1) for k in range(MAX_GATHERED + 7)))
    assert len(images) == 7
