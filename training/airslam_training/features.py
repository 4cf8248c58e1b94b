# SPDX-License-Identifier: BSD-3-Clause
"""Caches keypoints and descriptors of altered views, on which the matcher learns: `python -m airslam_training.features`.

Groups of views: homographic views of one photo, or the views of one procedural scene. Each view is altered on its own
(independent light), so any two feature sets of a group make a pair whose true correspondence is known exactly.
"""
from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np
import torch

from . import augment
from .cache import CACHE, photo_split
from .geometry import HomographyRange, random_homography, select_keypoints, warp_image
from .pack import PackNetworks
from .procedural import DEPTH_UNIT, FOLDER
from .ray_cast import HEIGHT, WIDTH

POINTS = 256
FIELDS = ("points", "descriptors", "depth", "count", "size", "group", "view", "homography", "pose", "intrinsics")


class Store:
    """Grows lists of feature sets and writes them as one npz.

    points M x P x 2, descriptors M x P x 64 int8 (x 200), depth M x P (metres, 0: planar), count M, size M x 2
    (width, height), group M, view M,
    homography M x 3 x 3 (`view_from_source`), pose M x 4 x 4 (`world_from_cam`), intrinsics M x 3 x 3.
    """

    def __init__(self, network: PackNetworks, seed: int):
        self.network, self.rows = network, {k: [] for k in FIELDS}
        self.generator = torch.Generator().manual_seed(seed)

    def add(self, image: np.ndarray, group: int, view: int, depth=None, homography=None, pose=None, k=None) -> None:
        """Alter an image, detect and describe; skipped when it shows fewer than 24 keypoints."""
        x = torch.from_numpy(np.ascontiguousarray(image))[None, None].float()
        altered = augment.alter(x, self.generator)[0, 0].numpy().astype(np.uint8)
        maps, scores = self.network.look(altered)
        points = select_keypoints(scores, POINTS)
        n = len(points)
        if n < 24:
            return
        descriptors = np.zeros((POINTS, 64), np.int8)
        descriptors[:n] = np.clip(np.rint(self.network.describe(maps, points) * 200), -127, 127)
        padded = np.zeros((POINTS, 2), np.float32)
        padded[:n] = points
        z = np.zeros(POINTS, np.float32)
        if depth is not None:
            z[:n] = depth[points[:, 1].astype(int), points[:, 0].astype(int)] * DEPTH_UNIT
        eye = np.eye(3, dtype=np.float64)
        row = dict(points=padded, descriptors=descriptors, depth=z, count=n, size=image.shape[::-1], group=group, view=view,
                   homography=eye if homography is None else homography, pose=np.eye(4) if pose is None else pose,
                   intrinsics=eye if k is None else k)
        for key, value in row.items():
            self.rows[key].append(value)

    def save(self, name: str) -> None:
        np.savez(CACHE / f"{name}.tmp.npz", **{k: np.array(v) for k, v in self.rows.items()})
        (CACHE / f"{name}.tmp.npz").rename(CACHE / f"{name}.npz")
        print(name, len(self.rows["count"]), flush=True)


def photo_features(store: Store, files: list[Path], views: int, seed: int) -> None:
    """`views` homographic, independently altered views of every photo, WIDTH x HEIGHT or smaller."""
    rng = np.random.default_rng(seed)
    for group, file in enumerate(files):
        image = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
        for view in range(views):
            size = HEIGHT if rng.random() < 0.7 else 224
            h = random_homography(rng, image.shape, size, HomographyRange(0.65, 1.6, 30, 0.25, 0.4))
            width = size * WIDTH // HEIGHT
            h = np.array([[1, 0, (width - size) / 2], [0, 1, 0], [0, 0, 1]]) @ h
            store.add(warp_image(image, h, (width, size)), group, view, homography=h)


def scene_features(store: Store, pattern: str, repeats: int) -> None:
    """Every view of every procedural scene, `repeats` times, in a random lighting each."""
    rng = np.random.default_rng(3)
    for group, file in enumerate(sorted(FOLDER.glob(pattern))):
        data = np.load(file)
        images, depth = data["images"], data["depth"]
        for view in range(len(images)):
            for _ in range(repeats):
                store.add(images[view, rng.integers(3)], group, view, depth[view], None, data["poses"][view], data["k"])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--views", type=int, default=5)
    parser.add_argument("--repeats", type=int, default=4)
    parser.add_argument("--threads", type=int, default=1)
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    network = PackNetworks(threads=options.threads)
    train, held = photo_split()
    for name, files, pattern in (("held", held, "held_*.npz"), ("train", train, "scene_*.npz")):
        store = Store(network, 21)
        photo_features(store, files, options.views, 22)
        store.save(f"features_photos_{name}")
        store = Store(network, 23)
        scene_features(store, pattern, options.repeats)
        store.save(f"features_scenes_{name}")


if __name__ == "__main__":
    main()
