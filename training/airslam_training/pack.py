# SPDX-License-Identifier: BSD-3-Clause
"""The shipped networks as the C++ side runs them: grey image -> keypoints with descriptors, lines."""
from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import openvino as ov
import torch

from .augment import standardize
from .export import MAPS, PACK
from .geometry import refine_keypoints, sample_map, select_keypoints
from .lines import STRIDE, DecoderOptions, classifier_features, discount_overlaps, propose, without_doubles


class PackNetworks:
    """PLNet, descriptor head, line neck and classifier of a model pack, in OpenVINO."""

    def __init__(self, pack: Path = PACK, multiple: int = 16, precision: str = "f32", threads: int = 1):
        hint = {"INFERENCE_PRECISION_HINT": precision, "INFERENCE_NUM_THREADS": threads, "NUM_STREAMS": 1}
        names = [n for n in ("plnet", "descriptor_head", "line_neck", "line_classifier") if (pack / f"{n}.onnx").exists()]
        self.networks = {n: ov.Core().compile_model(str(pack / f"{n}.onnx"), "CPU", hint) for n in names}
        self.multiple = multiple

    def look(self, image: np.ndarray) -> tuple[dict[str, np.ndarray], np.ndarray]:
        """Maps 1 x h x w x C of the padded image, and score logits H x W of the image."""
        x = standardize(torch.from_numpy(image)[None, None].float())[0, 0].numpy()
        h, w = image.shape
        padded = cv2.copyMakeBorder(x, 0, -h % self.multiple, 0, -w % self.multiple, cv2.BORDER_REPLICATE)
        found = self.networks["plnet"]({"image": padded[None, None]})
        rows, columns = padded.shape
        maps = {name: found[name].reshape(1, rows // s, columns // s, -1) for name, s in MAPS.items()}
        cells = found["score_logits"].reshape(rows // STRIDE, columns // STRIDE, STRIDE, STRIDE)
        scores = cells.transpose(0, 2, 1, 3).reshape(rows, columns)
        return maps, np.ascontiguousarray(scores[:h, :w])

    def describe(self, maps: dict[str, np.ndarray], points: np.ndarray) -> np.ndarray:
        """Unit descriptors N x D at points N x 2."""
        sampled = [sample_map(maps[name][0].transpose(2, 0, 1), points, s) for name, s in MAPS.items()]
        raw = self.networks["descriptor_head"]({"features": np.concatenate(sampled, 1).astype(np.float32)})["descriptors"]
        return raw / np.maximum(np.linalg.norm(raw, axis=1, keepdims=True), 1e-9)

    def keypoints(self, image: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Points N x 2 (pixels) and their descriptors N x D, best first."""
        maps, scores = self.look(image)
        points = refine_keypoints(scores, select_keypoints(scores, count))
        return points, self.describe(maps, points)

    def lines(self, image: np.ndarray, options: DecoderOptions = DecoderOptions()) -> np.ndarray:
        """All proposals n x 5 (ends in pixels, probability), best first."""
        maps, _ = self.look(image)
        found = self.networks["line_neck"](maps)
        h, w = found["line_field"].shape[2:]
        ends, extra, _, _ = propose(*[torch.from_numpy(found[n][0]) for n in ("line_field", "junction_maps")], options)
        pooled = torch.from_numpy(found["line_features"].reshape(h, w, -1).transpose(2, 0, 1).copy())
        features = classifier_features(pooled, ends, extra)
        score = torch.sigmoid(torch.from_numpy(self.networks["line_classifier"]({"features": features.numpy()})["logits"]))
        lines = torch.cat([ends, score], 1)
        order = torch.sort(lines[:, 4], descending=True, stable=True).indices
        return discount_overlaps(without_doubles(lines[order], options.double), options.overlap).numpy()
