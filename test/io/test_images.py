"""Pixels of image messages."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from stcalib_ros.core.errors import InputError
from stcalib_ros.io.images import compressed_pixels, image_pixels

FLAT = np.full((8, 10, 3), (40, 120, 200), dtype=np.uint8)
"""Blue, green, red."""


def read(pixels, encoding, step=0, size=(8, 10)):
    rows = np.ascontiguousarray(pixels).reshape(size[0], -1)
    step = step or rows.shape[1]
    padded = np.pad(rows, ((0, 0), (0, step - rows.shape[1])))
    return image_pixels(
        encoding=encoding, height=size[0], width=size[1], step=step, data=padded.tobytes()
    )


@pytest.mark.parametrize(
    ("encoding", "order"),
    [("bgr8", [0, 1, 2]), ("rgb8", [2, 1, 0]), ("bgra8", [0, 1, 2, 0]), ("rgba8", [2, 1, 0, 0])],
)
def test_colours_in_any_order_with_padded_rows(encoding, order):
    np.testing.assert_array_equal(read(FLAT[..., order], encoding, step=64), FLAT)


def test_grey_is_the_same_in_all_three():
    grey = np.arange(80, dtype=np.uint8).reshape(8, 10)
    np.testing.assert_array_equal(read(grey, "mono8"), np.repeat(grey[..., None], 3, axis=2))


@pytest.mark.parametrize(
    ("encoding", "luma"), [("yuv422", 1), ("uyvy", 1), ("yuv422_yuy2", 0), ("yuyv", 0)]
)
def test_luma_and_chroma_are_where_the_encoding_has_them(encoding, luma):
    y, u, v = cv2.cvtColor(FLAT, cv2.COLOR_BGR2YUV)[0, 0]
    packed = np.empty((8, 10, 2), dtype=np.uint8)
    packed[..., luma] = y
    packed[:, ::2, 1 - luma], packed[:, 1::2, 1 - luma] = u, v
    assert (
        np.abs(read(packed, encoding).astype(int) - FLAT).max() < 35
    )  # Rec. 601 in a narrower range


@pytest.mark.parametrize("pattern", ["rggb", "bggr", "gbrg", "grbg"])
def test_colours_of_bayer_patterns(pattern):
    mosaic = np.empty((8, 10), dtype=np.uint8)
    for k, colour in enumerate(pattern):
        mosaic[k // 2 :: 2, k % 2 :: 2] = FLAT[0, 0, "bgr".index(colour)]
    np.testing.assert_array_equal(read(mosaic, f"bayer_{pattern}8")[2:-2, 2:-2], FLAT[2:-2, 2:-2])


def test_a_compressed_image_is_as_it_was():
    png = cv2.imencode(".png", FLAT)[1].tobytes()
    np.testing.assert_array_equal(compressed_pixels(png), FLAT)


@pytest.mark.parametrize("data", [b"", b"no image", b"\x89PNG\r\n\x1a\n"])
def test_what_is_no_compressed_image_is_said(data):
    with pytest.raises(InputError, match=f"{len(data)} bytes are no JPEG or PNG"):
        compressed_pixels(data)


@pytest.mark.parametrize("data", [b"", bytes(239)])
def test_too_few_bytes_are_said(data):
    with pytest.raises(InputError, match=f"{len(data)} bytes in rows of 30 are no image of 10 x 8"):
        image_pixels(encoding="bgr8", height=8, width=10, step=30, data=data)


def test_an_odd_width_cannot_be_yuv():
    with pytest.raises(InputError, match="9 x 8 pixels cannot be yuyv"):
        read(np.zeros((8, 18), dtype=np.uint8), "yuyv", size=(8, 9))


def test_an_unknown_encoding_is_named_with_those_that_are_read():
    with pytest.raises(InputError, match=r"encoding '16UC1' is not read: .*bgr8, .*bayer_rggb8"):
        image_pixels(encoding="16UC1", height=8, width=10, step=20, data=bytes(160))
