# SPDX-License-Identifier: BSD-3-Clause
"""Caches crops and the teacher's answers to them as numpy memmaps: `python -m airslam_training.cache photos`.

A shard NAME under the cache folder holds, for n crops of S x S:
  NAME.image.npy       n x S x S uint8
  NAME.descriptor.npy  n x S/4 x S/4 x 64 int8, unit descriptors x 200
  NAME.score.npy       n x S x S uint8, (logit + 30) / 0.15
  NAME.keypoint.npy    n x K x 2 int16 (x, y), strongest first, -1 where there are fewer
"""
from __future__ import annotations

import argparse
import json
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from .geometry import HomographyRange, random_homography, select_keypoints, warp_image
from .teacher import SHARED, teacher

CACHE = Path("/work/cache/train")
SIZE = 256
KEYPOINTS = 128
DESCRIPTOR_SCALE = 200.0
SCORE_LOW, SCORE_STEP = -30.0, 0.15


def photo_split(seed: int = 7) -> tuple[list[Path], list[Path]]:
    """Training and held-out (5 %) photos: the same split everywhere."""
    files = sorted((SHARED / "data/photos").glob("*.jpg"))
    order = np.random.default_rng(seed).permutation(len(files))
    held = len(files) // 20
    return [files[i] for i in order[held:]], [files[i] for i in order[:held]]


def photo_crops(files: list[Path], count: int, seed: int):
    """Generator of `count` random homographic views SIZE x SIZE of the photos, in turn."""
    rng = np.random.default_rng(seed)
    for i in range(count):
        image = cv2.imread(str(files[i % len(files)]), cv2.IMREAD_GRAYSCALE)
        h = random_homography(rng, image.shape, SIZE, HomographyRange())
        crop = warp_image(image, h, (SIZE, SIZE))
        yield crop[:, ::-1] if rng.random() < 0.5 else crop


@dataclass
class Shard:
    """Read side of a cached shard: four memmaps of equal length."""

    image: np.ndarray
    descriptor: np.ndarray
    score: np.ndarray
    keypoint: np.ndarray

    @staticmethod
    def open(name: str) -> "Shard":
        return Shard(*[np.load(CACHE / f"{name}.{k}.npy", mmap_mode="r")
                       for k in ("image", "descriptor", "score", "keypoint")])


def _create(name: str, n: int) -> Shard:
    def new(kind, dtype, shape):
        return np.lib.format.open_memmap(CACHE / f"{name}.{kind}.tmp.npy", "w+", dtype, (n, *shape))

    return Shard(new("image", np.uint8, (SIZE, SIZE)), new("descriptor", np.int8, (SIZE // 4, SIZE // 4, 64)),
                 new("score", np.uint8, (SIZE, SIZE)), new("keypoint", np.int16, (KEYPOINTS, 2)))


def build(name: str, crops, n: int, batch: int = 8) -> None:
    """Run the teacher over n crops and write shard `name` (complete or not at all)."""
    CACHE.mkdir(parents=True, exist_ok=True)
    shard, network = _create(name, n), teacher()
    pending: list[np.ndarray] = []
    done = 0
    for crop in crops:
        pending.append(crop)
        if len(pending) < batch and done + len(pending) < n:
            continue
        images = np.stack(pending)
        descriptors, scores = network.batch(images)
        descriptors = descriptors / np.linalg.norm(descriptors, axis=1, keepdims=True)
        part = slice(done, done + len(images))
        shard.image[part] = images
        shard.descriptor[part] = np.clip(np.rint(descriptors * DESCRIPTOR_SCALE), -127, 127).transpose(0, 2, 3, 1)
        shard.score[part] = np.clip(np.rint((scores - SCORE_LOW) / SCORE_STEP), 0, 255)
        for j, score in enumerate(scores):
            k = select_keypoints(score, KEYPOINTS)
            shard.keypoint[done + j] = -1
            shard.keypoint[done + j, :len(k)] = k
        done += len(images)
        pending = []
        if done % 800 < batch:
            print(f"{name}: {done}/{n}", flush=True)
        if done >= n:
            break
    for kind in ("image", "descriptor", "score", "keypoint"):
        (CACHE / f"{name}.{kind}.tmp.npy").rename(CACHE / f"{name}.{kind}.npy")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("source", choices=["photos", "procedural"])
    parser.add_argument("--count", type=int, default=13600)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    train, held = photo_split()
    if options.source == "photos":
        build("photos", photo_crops(train, options.count, options.seed), options.count)
        build("held", photo_crops(held, 160, options.seed + 1), 160)
        (CACHE / "split.json").write_text(json.dumps({"held": [f.name for f in held]}, indent=1))
    else:
        from .procedural import cached_crops
        build("procedural", cached_crops(options.count, options.seed), options.count)


if __name__ == "__main__":
    main()
