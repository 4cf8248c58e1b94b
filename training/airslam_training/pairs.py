# SPDX-License-Identifier: BSD-3-Clause
"""Random pairs of cached feature sets with labels from exact geometry."""
from __future__ import annotations

import numpy as np

from .cache import CACHE
from .geometry import warp_points


def normalize_points(points: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Pixels N x 2 -> matcher coordinates (k - size/2) / (max(size)/2), float32."""
    return ((points - size / 2) / (max(size) / 2)).astype(np.float32)


class FeatureSets:
    """The arrays of one features_*.npz (see features.Store), grouped."""

    def __init__(self, name: str):
        data = np.load(CACHE / f"{name}.npz")
        for field in data.files:
            setattr(self, field, data[field])
        self.planar = not (self.depth > 0).any()
        self.members = [np.flatnonzero(self.group == g) for g in np.unique(self.group)]
        self.members = [m for m in self.members if len(np.unique(self.view[m])) > 1]

    def transfer(self, i: int, j: int, n: int) -> np.ndarray:
        """Where the first n points of set i lie in set j's image, n x 2 (nan behind the camera)."""
        points = self.points[i, :n].astype(np.float64)
        if self.planar:
            return warp_points(self.homography[j] @ np.linalg.inv(self.homography[i]), points)
        k = self.intrinsics[i]
        rays = np.stack([(points[:, 0] - k[0, 2]) / k[0, 0], (points[:, 1] - k[1, 2]) / k[1, 1], np.ones(n)], 1)
        world = (rays * self.depth[i, :n, None]) @ self.pose[i][:3, :3].T + self.pose[i][:3, 3]
        local = (world - self.pose[j][:3, 3]) @ self.pose[j][:3, :3]
        local[local[:, 2] < 0.05] = np.nan
        k = self.intrinsics[j]
        return local[:, :2] / local[:, 2:] * np.diag(k)[:2] + k[:2, 2]

    def distance(self, i: int, j: int, n: int) -> np.ndarray:
        """n x n: larger of the two transfer errors (i to j and j to i), in pixels; occluded points come out large."""
        n0, n1 = min(n, int(self.count[i])), min(n, int(self.count[j]))
        d = np.full((n, n), np.inf)
        there, back = self.transfer(i, j, n0), self.transfer(j, i, n1)
        forward = np.linalg.norm(there[:, None] - self.points[j, None, :n1], axis=-1)
        backward = np.linalg.norm(back[None] - self.points[i, :n0, None], axis=-1)
        d[:n0, :n1] = np.nan_to_num(np.maximum(forward, backward), nan=np.inf)
        return d


def labels(distance: np.ndarray, positive: float, negative: float):
    """Positives n x n (mutually nearest and close), unmatched rows n and columns n (nothing near): bools."""
    best0, best1 = distance.argmin(1), distance.argmin(0)
    rows = np.arange(len(distance))
    mutual = (best1[best0] == rows) & (distance[rows, best0] <= positive)
    matrix = np.zeros(distance.shape, bool)
    matrix[rows[mutual], best0[mutual]] = True
    return matrix, distance.min(1) > negative, distance.min(0) > negative


class Pairs:
    """Draws batches: a dict of arrays with a leading batch axis."""

    def __init__(self, part: str, config: dict, seed: int):
        self.c, self.rng = config, np.random.default_rng(seed)
        self.photos = FeatureSets(f"features_photos_{part}")
        self.scenes = FeatureSets(f"features_scenes_{part}")

    def _choose(self, sets: FeatureSets) -> tuple[int, int]:
        """Two feature sets of different views of one group."""
        members = sets.members[self.rng.integers(len(sets.members))]
        while True:
            i, j = self.rng.choice(members, 2, replace=False)
            if sets.view[i] != sets.view[j]:
                return int(i), int(j)

    def one(self, planar: bool) -> dict[str, np.ndarray]:
        """A pair with at least 8 true matches, or (rarely) an unrelated one."""
        sets, n, c = self.photos if planar else self.scenes, self.c["points"], self.c
        unrelated = self.rng.random() < c["unrelated_share"]
        for _ in range(20):
            i, j = self._choose(sets)
            if unrelated:
                j = self._choose(sets)[1]
                if sets.group[i] == sets.group[j]:
                    continue
            d = np.full((n, n), np.inf) if unrelated else sets.distance(i, j, n)
            matrix, alone0, alone1 = labels(d, c["positive_pixels"], c["negative_pixels"])
            if unrelated or matrix.sum() >= 8:
                break
        pair = {"positive": matrix}
        for side, (index, alone) in enumerate(((i, alone0), (j, alone1))):
            mask = np.arange(n) < sets.count[index]
            d = sets.descriptors[index, :n].astype(np.float32)
            pair |= {f"points{side}": normalize_points(sets.points[index, :n], sets.size[index]),
                     f"descriptors{side}": d / np.maximum(np.linalg.norm(d, axis=1, keepdims=True), 1e-6),
                     f"mask{side}": mask.astype(np.float32), f"alone{side}": alone & mask}
        return pair

    def batch(self, count: int) -> dict[str, np.ndarray]:
        pairs = [self.one(self.rng.random() < self.c["photo_share"]) for _ in range(count)]
        return {k: np.stack([p[k] for p in pairs]) for k in pairs[0]}
