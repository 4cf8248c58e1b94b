# SPDX-License-Identifier: BSD-3-Clause
"""The EdgePoint2 teacher, run in OpenVINO. It supervises and is compared with; it is never shipped."""
from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import openvino as ov

SHARED = Path("/work/shared")
TEACHERS = SHARED / "teachers"


class Network:
    """A keypoint network (teacher or ours) behind one call: grey image -> descriptor map and score map."""

    def __init__(self, path: Path, normalization: str, multiple: int, precision: str = "f32", threads: int = 2):
        hint = {"INFERENCE_PRECISION_HINT": precision, "INFERENCE_NUM_THREADS": threads, "NUM_STREAMS": 1}
        self.model = ov.Core().compile_model(str(path), "CPU", hint)
        self.normalization, self.multiple = normalization, multiple

    def prepare(self, images: np.ndarray) -> np.ndarray:
        """Grey images B x H x W in 0..255 -> network input B x 1 x H x W."""
        x = images.astype(np.float32)
        if self.normalization == "unit":
            return x[:, None] / 255
        mean, std = x.mean((1, 2), keepdims=True), x.std((1, 2), keepdims=True)
        return ((x - mean) / np.maximum(std, 2.0))[:, None]

    def batch(self, images: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """B x H x W grey, H and W multiples -> descriptors B x 64 x H/4 x W/4, score logits B x H x W."""
        result = self.model({"image": self.prepare(images)})
        return result["descriptors"], result["score_logits"][:, 0]

    def __call__(self, image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """One grey image of any size -> descriptors 64 x h x w and scores H x W (padding cut off the scores)."""
        h, w = image.shape
        m = self.multiple
        padded = cv2.copyMakeBorder(image, 0, -h % m, 0, -w % m, cv2.BORDER_REPLICATE)
        descriptors, scores = self.batch(padded[None])
        return descriptors[0], np.ascontiguousarray(scores[0, :h, :w])


def teacher(name: str = "E64", **options) -> Network:
    """EdgePoint2-E64 or -S64."""
    return Network(TEACHERS / f"edgepoint2_{name}.onnx", "unit", 32, **options)
