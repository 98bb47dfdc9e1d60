"""Points of a scaled image are where they were in the original, to a fraction of a pixel."""

from __future__ import annotations

import numpy as np
import pytest

from stcalib_ros.estimation.letterbox import letterbox


@pytest.mark.parametrize(
    ("size", "longest"), [((480, 640), 256), ((1920, 1088), 512), ((90, 120), 256)]
)
def test_the_middle_of_a_mark_comes_back(size, longest):
    rng = np.random.default_rng(0)
    errors = []
    for _ in range(20):
        image = np.zeros((*size, 3), np.uint8)
        low = (rng.uniform(0.2, 0.7, 2) * size).astype(int)
        side = rng.integers(12, 25)
        image[low[0] : low[0] + side, low[1] : low[1] + side] = 255
        box = letterbox(image, longest, 32)
        rows, columns = np.mgrid[: box.image.shape[0], : box.image.shape[1]]
        weights = box.image[..., 0] / box.image[..., 0].sum()
        found = box.original(np.array([(columns * weights).sum(), (rows * weights).sum()]))
        errors.append(found - (low[::-1] + (side - 1) / 2.0))
    assert np.abs(np.mean(errors, axis=0)).max() < 0.05


def test_both_sides_are_multiples_and_the_rest_is_black():
    box = letterbox(np.full((1080, 1920, 3), 200, np.uint8), 256, 32)
    assert box.image.shape == (160, 256, 3)
    assert (box.image[:144] == 200).all()
    assert not box.image[144:].any()
