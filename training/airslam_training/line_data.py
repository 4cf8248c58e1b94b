# SPDX-License-Identifier: BSD-3-Clause
"""Random views of labelled images, and their encoding for the line module's losses."""
from __future__ import annotations

import queue
import threading
from pathlib import Path

import cv2
import numpy as np

from .cache import CACHE, photo_split
from .geometry import HomographyRange, random_homography, warp_image, warp_points
from .line_labels import read_wireframe
from .lines import REACH, STRIDE
from .mlsd import FOLDER
from .teacher import SHARED


def view_range(scales: tuple[float, float]) -> HomographyRange:
    """How views differ. `scales`, of the view that just covers the shorter side: from whole pictures in little detail to
    parts as large as a camera sees them."""
    return HomographyRange(scale_min=scales[0], scale_max=scales[1], rotation_deg=12.0, perspective=0.2, shift=0.1)


def clip_segments(segments: np.ndarray, size: int, shortest: float = 8.0) -> np.ndarray:
    """Segments n x 5 cut to 0..size-1; those of which less than `shortest` pixels is left are dropped."""
    p, q = segments[:, :2], segments[:, 2:4]
    d = q - p
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = -p / d, (size - 1 - p) / d
    outside = (d == 0) & ((p < 0) | (p > size - 1))
    low = np.where(d == 0, 0, np.minimum(a, b)).max(1).clip(0, 1)
    high = np.where(d == 0, 1, np.maximum(a, b)).min(1).clip(0, 1)
    cut = np.concatenate([p + d * low[:, None], p + d * high[:, None], segments[:, 4:]], 1)
    return cut[(high > low) & ~outside.any(1) & (np.hypot(*(cut[:, 2:4] - cut[:, :2]).T) >= shortest)]


def warp_segments(homography: np.ndarray, segments: np.ndarray, size: int) -> np.ndarray:
    """Segments n x 5 of an image in a view of size x size."""
    p = np.concatenate([segments[:, :4].reshape(-1, 2), np.ones((2 * len(segments), 1))], 1) @ homography[2]
    front = (p > 1e-3).reshape(-1, 2).all(1)
    ends = warp_points(homography, segments[front, :4].reshape(-1, 2).astype(np.float64))
    return clip_segments(np.concatenate([ends.reshape(-1, 4), segments[front, 4:]], 1), size)


def encode(segments: np.ndarray, h: int, w: int) -> tuple[np.ndarray, np.ndarray]:
    """Targets of segments n x 5: field 6 x h x w (score, d, cos, sin, theta1, theta2) and junctions 3 x h x w
    (score, offset x, offset y in cells). Where regions overlap the nearer segment wins, a sure one before a doubtful."""
    field, cost = np.zeros((6, h, w), np.float32), np.full((h, w), np.inf, np.float32)
    junctions = np.zeros((3, h, w), np.float32)
    for x1, y1, x2, y2, score in segments:
        low = np.maximum(np.floor((np.array([min(x1, x2), min(y1, y2)]) - REACH) / STRIDE), 0).astype(int)
        high = np.minimum(np.ceil((np.array([max(x1, x2), max(y1, y2)]) + REACH) / STRIDE), [w - 1, h - 1]).astype(int) + 1
        part = np.s_[low[1]:high[1], low[0]:high[0]]
        x = np.arange(low[0], high[0], dtype=np.float32)[None] * STRIDE + 1.5
        y = np.arange(low[1], high[1], dtype=np.float32)[:, None] * STRIDE + 1.5
        length = np.hypot(x2 - x1, y2 - y1)
        u, v = (x2 - x1) / length, (y2 - y1) / length
        along = (x - x1) * u + (y - y1) * v  # of the foot, from end 1
        off = -(x - x1) * v + (y - y1) * u  # signed distance, positive along (-v, u)
        d = np.abs(off)
        price = d + 6 * (1 - score)
        use = (d < REACH) & (along > 0) & (along < length) & (price < cost[part])
        cost[part] = np.where(use, price, cost[part])
        side = -np.sign(off)  # from p to the foot: side * (-v, u); turned by 90 degrees: -side * (u, v)
        safe = np.maximum(d, 1e-3)
        first = np.arctan(np.where(side < 0, length - along, along) / safe)  # the end that lies along -side * (u, v)
        second = -np.arctan(np.where(side < 0, along, length - along) / safe)
        for k, value in enumerate((score, d, -side * v, side * u, first, second)):
            field[k][part] = np.where(use, value, field[k][part])
        for px, py in ((x1, y1), (x2, y2)):
            column, row = (px - 1.5) / STRIDE, (py - 1.5) / STRIDE
            c, r = min(max(int(np.rint(column)), 0), w - 1), min(max(int(np.rint(row)), 0), h - 1)
            if score > junctions[0, r, c]:
                junctions[:, r, c] = score, np.clip(column - c, -0.49, 0.49), np.clip(row - r, -0.49, 0.49)
    return field, junctions


class Source:
    """Labelled images in memory: `image(i)` grey, `segments[i]` n x 5."""

    def __init__(self, names: list[str], labels: dict):
        self.names = [n for n in names if n in labels]
        self.segments = [labels[n].astype(np.float64) for n in self.names]
        scenes = {n.rsplit("_", 2)[0] for n in self.names if n.startswith(("scene_", "held_"))}
        self.scenes = {s: np.load(CACHE / "scenes" / f"{s}.npz")["images"] for s in sorted(scenes)}
        self.photos = {n: cv2.imread(str(SHARED / "data/photos" / f"{n}.jpg"), cv2.IMREAD_GRAYSCALE)
                       for n in self.names if n.rsplit("_", 2)[0] not in scenes}

    def image(self, i: int) -> np.ndarray:
        if self.names[i] in self.photos:
            return self.photos[self.names[i]]
        scene, view, light = self.names[i].rsplit("_", 2)
        return self.scenes[scene][int(view), int(light)]


class Wireframe(Source):
    """Images of the Wireframe dataset in a folder, with an annotation `NAME.json` beside each or in `annotations`."""

    def __init__(self, folder: Path):
        found = [read_wireframe(f) for f in sorted(folder.rglob("*.json"))]
        if not found:
            raise FileNotFoundError(f"{folder}: no annotation (*.json) in it")
        files = {f.name: f for f in folder.rglob("*") if f.suffix.lower() in (".png", ".jpg")}
        missing = [n for n, _ in found if n not in files]
        if missing:
            raise FileNotFoundError(f"{folder}: no image {missing[0]}")
        self.names, self.segments = [n for n, _ in found], [s.astype(np.float64) for _, s in found]
        self.files = files

    def image(self, i: int) -> np.ndarray:
        return cv2.imread(str(self.files[self.names[i]]), cv2.IMREAD_GRAYSCALE)


def sources(held: bool = False) -> dict[str, Source]:
    """`photos` and `scenes`, for training or held out."""
    labels = dict(np.load(FOLDER / "labels.npz"))
    names = [f.stem for f in photo_split()[1 if held else 0]]
    prefix = "held_" if held else "scene_"
    return {"photos": Source(names, labels), "scenes": Source(sorted(n for n in labels if n.startswith(prefix)), labels)}


class Views:
    """Random batches of views, read ahead in a thread. `shares`: source -> how often it is drawn."""

    def __init__(self, pools: list[tuple[Source, float]], batch: int, size: int, scales: tuple[float, float], seed: int):
        self.pools = [p for p, _ in pools]
        self.range = view_range(scales)
        self.share = np.array([s for _, s in pools]) / sum(s for _, s in pools)
        self.batch, self.size, self.rng = batch, size, np.random.default_rng(seed)
        self.queue: queue.Queue = queue.Queue(maxsize=3)
        threading.Thread(target=self._work, daemon=True).start()

    def _one(self):
        rng, size = self.rng, self.size
        pool = self.pools[rng.choice(len(self.pools), p=self.share)]
        i = int(rng.integers(len(pool.names)))
        image = pool.image(i)
        h = random_homography(rng, image.shape, size, self.range)
        if rng.random() < 0.5:
            h = np.array([[-1.0, 0, size - 1], [0, 1, 0], [0, 0, 1]]) @ h
        segments = warp_segments(h, pool.segments[i], size)
        # Beyond the picture there is mirrored content whose segments are unknown: it becomes plain grey.
        view = warp_image(image, h, (size, size))
        known = cv2.warpPerspective(np.full(image.shape, 255, np.uint8), h, (size, size))
        if rng.random() < 0.5:  # an enlarged photo is soft, a camera's frame is not
            soft = cv2.GaussianBlur(view, (0, 0), 1.2)
            view = cv2.addWeighted(view, 1 + (amount := rng.uniform(0.3, 1.5)), soft, -amount, 0)
        view = np.where(known > 0, view, np.uint8(rng.integers(256)))
        return view, segments, *encode(segments, size // STRIDE, size // STRIDE)

    def _work(self) -> None:
        while True:
            rows = [self._one() for _ in range(self.batch)]
            self.queue.put((np.stack([r[0] for r in rows]), [r[1] for r in rows],
                            np.stack([r[2] for r in rows]), np.stack([r[3] for r in rows])))

    def next(self):
        """Images B x S x S, segments (list of n x 5), field B x 6 x S/4 x S/4, junctions B x 3 x S/4 x S/4."""
        return self.queue.get()
