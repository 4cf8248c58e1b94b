# SPDX-License-Identifier: BSD-3-Clause
"""Structural average precision, and where lines get lost: junctions, proposals or classifier."""
from __future__ import annotations

import cv2
import numpy as np
import torch

from .augment import standardize
from .line_data import sources
from .lines import DecoderOptions, LineModule

GRID = 128.0  # wireframe parsing measures in pixels of a 128 x 128 image


def to_grid(segments: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Ends n x 4 in pixels of an image of (height, width) -> the 128 x 128 grid."""
    return segments[:, :4] * (GRID / np.array([shape[1], shape[0]] * 2))


def squared_distances(found: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Summed squared end distances n x m, the better of both directions."""
    p, q = found[:, None, :4], truth[None, :, :4]
    return np.minimum(((p - q) ** 2).sum(-1), ((p - q[..., [2, 3, 0, 1]]) ** 2).sum(-1))


def hits(found: np.ndarray, truth: np.ndarray, threshold: float) -> np.ndarray:
    """n bools for segments best first, on the grid: the nearest true segment is within the threshold and still free."""
    hit = np.zeros(len(found), bool)
    if len(found) == 0 or len(truth) == 0:
        return hit
    d = squared_distances(found, truth)
    nearest, taken = d.argmin(1), np.zeros(len(truth), bool)
    for i, j in enumerate(nearest):
        if d[i, j] < threshold and not taken[j]:
            hit[i] = taken[j] = True
    return hit


def average_precision(images: list[tuple[np.ndarray, np.ndarray]], threshold: float) -> float:
    """sAP in percent over (found n x 5, truth m x 4) on the grid: precision made monotone, summed over recall."""
    hit = np.concatenate([hits(f, t, threshold) for f, t in images])
    score = np.concatenate([f[:, 4] for f, _ in images])
    hit = hit[np.argsort(-score, kind="stable")]
    total = max(sum(len(t) for _, t in images), 1)
    true = np.cumsum(hit)
    precision = np.append(true / np.arange(1, len(hit) + 1), 0)
    recall = np.append(true / total, 1)
    precision = np.maximum.accumulate(precision[::-1])[::-1]
    return 100 * float((np.diff(np.append(0, recall)) * precision).sum())


def prepare(image: np.ndarray, scale: float, multiple: int = 16) -> tuple[torch.Tensor, np.ndarray]:
    """Network input of a grey image, enlarged by about `scale` to multiples of 16, and input pixels an image pixel (2)."""
    h, w = [max(multiple, int(round(s * scale / multiple)) * multiple) for s in image.shape]
    factors = np.array([w / image.shape[1], h / image.shape[0]])
    method = cv2.INTER_AREA if max(factors) < 1 else cv2.INTER_LINEAR
    x = torch.from_numpy(cv2.resize(image, (w, h), interpolation=method))[None, None].float()
    return standardize(x), factors


@torch.no_grad()
def detect(backbone, module: LineModule, image: np.ndarray, scale: float, options=DecoderOptions()):
    """Lines n x 5 and junctions m x 3 of a grey image, in its pixels, as PyTorch finds them."""
    x, f = prepare(image, scale)
    lines, junctions = [a.numpy().astype(np.float64) for a in module.detect(backbone(x), options)]
    lines[:, :4] = (lines[:, :4] + 0.5) / np.tile(f, 2) - 0.5
    junctions[:, :2] = (junctions[:, :2] + 0.5) / f - 0.5
    return lines, junctions


def validate_lines(backbone, module: LineModule, most: int = 40, sure: float = 0.25) -> dict[str, float]:
    """On held-out photos (labels surer than `sure`) and procedural views, short side 480: sAP10 and the recall of
    junctions (ends within 8 pixels of 480) and of proposals (within the same 10 squared grid pixels)."""
    module = module.eval()
    result: dict[str, float] = {}
    for name, source in sources(held=True).items():
        images, ends_found, ends, proposed, count = [], 0, 0, 0, []
        for i in np.linspace(0, len(source.names) - 1, min(most, len(source.names))).astype(int):
            image, truth = source.image(i), source.segments[i]
            truth = truth[truth[:, 4] > sure]
            if len(truth) == 0:
                continue
            found, junctions = detect(backbone, module, image, 480 / min(image.shape))
            f, t = to_grid(found, image.shape), to_grid(truth, image.shape)
            images.append((np.concatenate([f, found[:, 4:]], 1), t))
            reach = 8 * min(image.shape) / 480
            d = np.linalg.norm(truth[:, :4].reshape(-1, 1, 2) - junctions[None, :, :2], axis=-1)
            ends_found, ends = ends_found + int((d.min(1, initial=np.inf) < reach).sum()), ends + 2 * len(truth)
            proposed += int((squared_distances(f, t).min(0, initial=np.inf) < 10).sum())
            count.append((found[:, 4] > 0.3).sum())
        result |= {f"{name}_sap10": average_precision(images, 10), f"{name}_junctions": ends_found / max(ends, 1),
                   f"{name}_proposals": 2 * proposed / max(ends, 1)}
    return result | {"count": float(np.mean(count))}
