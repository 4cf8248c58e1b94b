# SPDX-License-Identifier: BSD-3-Clause
"""Held-out validation while training: homography pairs of photos that no training crop came from."""
from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
import torch

from . import augment
from .cache import SIZE, Shard, photo_split, DESCRIPTOR_SCALE
from .geometry import (HomographyRange, inside, mutual_nearest, random_homography, sample_descriptors, select_keypoints,
                       warp_image, warp_points)

PAIRS = 40


@lru_cache
def held_pairs() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Views a and b (PAIRS x S x S uint8) of held-out photos and `b_from_a` (PAIRS x 3 x 3)."""
    rng = np.random.default_rng(99)
    _, held = photo_split()
    first, second, maps = [], [], []
    for i in range(PAIRS):
        image = cv2.imread(str(held[i % len(held)]), cv2.IMREAD_GRAYSCALE)
        views = [random_homography(rng, image.shape, SIZE, HomographyRange(0.8, 1.4)) for _ in range(2)]
        first.append(warp_image(image, views[0], (SIZE, SIZE)))
        second.append(warp_image(image, views[1], (SIZE, SIZE)))
        maps.append(views[1] @ np.linalg.inv(views[0]))
    return np.stack(first), np.stack(second), np.stack(maps)


def match_accuracy(a, b, b_from_a: np.ndarray, count: int = 300, threshold: float = 3.0) -> tuple[int, int]:
    """(matches, correct) of mutual neighbours; a and b are (descriptor map, score map) of two views."""
    points = [select_keypoints(s, count) for _, s in (a, b)]
    pairs = mutual_nearest(sample_descriptors(a[0], points[0]), sample_descriptors(b[0], points[1]))
    if len(pairs) == 0:
        return 0, 0
    where = warp_points(b_from_a, points[0][pairs[:, 0]])
    seen = inside(where, (SIZE, SIZE))
    error = np.linalg.norm(where - points[1][pairs[:, 1]], axis=1)
    return int(seen.sum()), int((error[seen] <= threshold).sum())


@torch.no_grad()
def validate_plnet(net: torch.nn.Module, device: torch.device) -> dict[str, float]:
    """Cosine to the teacher on held-out crops; accuracy and correct matches of pairs, mildly and darkly altered."""
    g = torch.Generator(device).manual_seed(5)
    held = Shard.open("held")
    image = torch.from_numpy(np.array(held.image[:96]))[:, None].float().to(device)
    target = torch.from_numpy(np.array(held.descriptor[:96])).permute(0, 3, 1, 2).float().to(device) / DESCRIPTOR_SCALE
    maps = run(net, augment.standardize(augment.alter(image, g)))[0]
    cosine = torch.nn.functional.cosine_similarity(maps, target, dim=1).mean()
    result = {"cosine": float(cosine)}
    first, second, homographies = held_pairs()
    for name in ("", "_dark"):
        views = []
        for part in (first, second):
            x = torch.from_numpy(part)[:, None].float().to(device)
            x = augment.noise(augment.darken(augment.spot(x, g).clamp(0, 255), g), g) if name else augment.alter(x, g)
            maps, scores = run(net, augment.standardize(x.round().clamp(0, 255)))
            views.append((maps.cpu().numpy(), scores[:, 0].cpu().numpy()))
        counts = [match_accuracy((views[0][0][i], views[0][1][i]), (views[1][0][i], views[1][1][i]), homographies[i])
                  for i in range(PAIRS)]
        result["accuracy" + name] = float(np.mean([c / max(m, 1) for m, c in counts]))
        result["correct" + name] = float(np.mean([c for _, c in counts]))
    return result


def run(net: torch.nn.Module, x: torch.Tensor, batch: int = 16) -> tuple[torch.Tensor, torch.Tensor]:
    """Network over many images in small batches, in fp32."""
    parts = [net(x[i:i + batch].contiguous(memory_format=torch.channels_last)) for i in range(0, len(x), batch)]
    return torch.cat([p[0] for p in parts]).float(), torch.cat([p[1] for p in parts]).float()
