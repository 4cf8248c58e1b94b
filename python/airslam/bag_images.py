# SPDX-License-Identifier: BSD-3-Clause
"""Image messages of ROS as files: raw pixels become PNG, compressed ones keep their bytes.

Nothing is lost: 16 bits stay 16 bits, colours stay colours (the readers of AirSLAM make them grey as they
read). A Bayer mosaic is interpolated to colours, for its raw pixels are no picture.
"""

from __future__ import annotations

import io
from dataclasses import dataclass

import numpy as np
from PIL import Image

from . import Error


SUPPORTED = ("mono8, 8UC1, mono16, 16UC1, rgb8, bgr8, 8UC3, rgba8, bgra8, bayer_rggb8, bayer_bggr8, "
             "bayer_gbrg8, bayer_grbg8")
# Position (row, column) of red in the 2 x 2 cell of each mosaic; blue lies across.
RED_OF_MOSAIC = {"rggb": (0, 0), "bggr": (1, 1), "gbrg": (1, 0), "grbg": (0, 1)}


@dataclass
class ImageFile:
    """The bytes of an image file and its ending."""

    content: bytes
    suffix: str  # .png or .jpg


def _rows(message: object, topic: str, channels: int, dtype: np.dtype) -> np.ndarray:
    """The pixels of a raw message without the padding of its rows: (height, width[, channels])."""
    height, width, step = message.height, message.width, message.step
    used = width * channels * dtype.itemsize
    data = np.asarray(message.data, dtype=np.uint8)
    if height <= 0 or width <= 0 or step < used or data.size < step * height:
        raise Error(f"an image of topic {topic} is said to be {width} x {height} pixels of "
                      f"{message.encoding}, but holds {data.size} bytes in rows of {step}")
    rows = np.ascontiguousarray(data[:step * height].reshape(height, step)[:, :used]).view(dtype)
    return rows.reshape(height, width) if channels == 1 else rows.reshape(height, width, channels)


def demosaic(mosaic: np.ndarray, pattern: str) -> np.ndarray:
    """Bilinear interpolation of a Bayer mosaic (h, w) to colours (h, w, 3), red first.

    Each colour is the mean of its samples in the 3 x 3 neighbourhood, weighed 1 2 1 in both directions;
    a pixel's own colour stays as it is.
    """
    red_row, red_column = RED_OF_MOSAIC[pattern]
    row, column = np.indices(mosaic.shape)
    is_red = ((row % 2) == red_row) & ((column % 2) == red_column)
    is_blue = ((row % 2) != red_row) & ((column % 2) != red_column)
    colours = []
    for own in (is_red, ~(is_red | is_blue), is_blue):
        total = _smooth(np.where(own, mosaic, 0).astype(np.float64))
        weight = _smooth(own.astype(np.float64))
        mean = np.rint(total / np.maximum(weight, 1e-9)).astype(np.uint8)
        colours.append(np.where(own, mosaic, mean))
    return np.stack(colours, axis=-1)


def _smooth(values: np.ndarray) -> np.ndarray:
    """1 2 1 in both directions, zero outside."""
    padded = np.pad(values, 1)
    rows = padded[:-2] + 2 * padded[1:-1] + padded[2:]
    return rows[:, :-2] + 2 * rows[:, 1:-1] + rows[:, 2:]


def pixels(message: object, topic: str) -> np.ndarray:
    """The pixels of a sensor_msgs/Image: (h, w) uint8 or uint16, or (h, w, 3) uint8 with red first."""
    encoding = message.encoding
    eight = np.dtype(np.uint8)
    if encoding in ("mono8", "8UC1"):
        return _rows(message, topic, 1, eight)
    if encoding in ("mono16", "16UC1"):
        stored = np.dtype(">u2" if message.is_bigendian else "<u2")
        return _rows(message, topic, 1, stored).astype(np.uint16)
    if encoding == "rgb8":
        return _rows(message, topic, 3, eight)
    if encoding in ("bgr8", "8UC3"):
        return np.ascontiguousarray(_rows(message, topic, 3, eight)[:, :, ::-1])
    if encoding == "rgba8":
        return np.ascontiguousarray(_rows(message, topic, 4, eight)[:, :, :3])
    if encoding == "bgra8":
        return np.ascontiguousarray(_rows(message, topic, 4, eight)[:, :, 2::-1])
    if encoding.startswith("bayer_") and encoding[6:-1] in RED_OF_MOSAIC and encoding.endswith("8"):
        return demosaic(_rows(message, topic, 1, eight), encoding[6:-1])
    raise Error(f"the images of topic {topic} are {encoding}, which is not supported; these are: "
                  f"{SUPPORTED}, and JPEG or PNG as compressed images")


def image_file(message: object, topic: str) -> ImageFile:
    """The file of a sensor_msgs/Image or CompressedImage."""
    if hasattr(message, "encoding"):
        stream = io.BytesIO()
        Image.fromarray(pixels(message, topic)).save(stream, "PNG", compress_level=1)
        return ImageFile(stream.getvalue(), ".png")
    content = bytes(np.asarray(message.data, dtype=np.uint8))
    if content.startswith(b"\xff\xd8\xff"):
        return ImageFile(content, ".jpg")
    if content.startswith(b"\x89PNG\r\n\x1a\n"):
        return ImageFile(content, ".png")
    raise Error(f"the compressed images of topic {topic} are of format \"{message.format}\", neither "
                  "JPEG nor PNG")
