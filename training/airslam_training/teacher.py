# SPDX-License-Identifier: BSD-3-Clause
"""The EdgePoint2 teacher, run in OpenVINO. It supervises and is compared with; it is never shipped."""
from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import openvino as ov

SHARED = Path("/work/shared")
TEACHERS = SHARED / "teachers"
MULTIPLE = 32  # of which an image's height and width must be multiples


class Teacher:
    """The teacher behind one call: grey image -> descriptor map and score map."""

    def __init__(self, path: Path, precision: str = "f32", threads: int = 2):
        hint = {"INFERENCE_PRECISION_HINT": precision, "INFERENCE_NUM_THREADS": threads, "NUM_STREAMS": 1}
        self.model = ov.Core().compile_model(str(path), "CPU", hint)

    def batch(self, images: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """B x H x W grey, H and W multiples -> descriptors B x 64 x H/4 x W/4, score logits B x H x W."""
        result = self.model({"image": images[:, None].astype(np.float32) / 255})
        return result["descriptors"], result["score_logits"][:, 0]

    def __call__(self, image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """One grey image of any size -> descriptors 64 x h x w and scores H x W (padding cut off the scores)."""
        h, w = image.shape
        padded = cv2.copyMakeBorder(image, 0, -h % MULTIPLE, 0, -w % MULTIPLE, cv2.BORDER_REPLICATE)
        descriptors, scores = self.batch(padded[None])
        return descriptors[0], np.ascontiguousarray(scores[0, :h, :w])


def teacher(name: str = "E64", **options) -> Teacher:
    """EdgePoint2-E64 or -S64."""
    return Teacher(TEACHERS / f"edgepoint2_{name}.onnx", **options)
