# SPDX-License-Identifier: BSD-3-Clause
"""What a procedural scene holds: a room (a box seen from inside) full of boxes, shelves, tables, cartons, pillars, doors,
windows, posters and lamps, whose faces carry photo crops or patterns. World frame: z up, metres. Deterministic by seed.
"""
from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

TEXTURE = 256
F32 = np.float32


@dataclass
class Box:
    """Box turned about the vertical: centre, half sizes, yaw, texture of its faces and metres a texture covers."""

    centre: np.ndarray
    half: np.ndarray
    yaw: float = 0.0
    texture: int = 0
    metres: float = 1.0
    emission: float = 0.0
    inverted: bool = False  # the room: seen from inside

    def corners(self) -> np.ndarray:
        """8 x 3 world points; bit 0, 1, 2 of the index picks the side in x, y, z."""
        signs = np.array([[(i >> k & 1) * 2 - 1 for k in range(3)] for i in range(8)], F32)
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        local = signs * self.half
        x, y = local[:, 0] * c - local[:, 1] * s, local[:, 0] * s + local[:, 1] * c
        return np.stack([x, y, local[:, 2]], 1) + self.centre

    def to_local(self, vectors: np.ndarray) -> np.ndarray:
        """Rotate world vectors ... x 3 into the box's axes."""
        c, s = F32(np.cos(self.yaw)), F32(np.sin(self.yaw))
        x, y = vectors[..., 0], vectors[..., 1]
        return np.stack([x * c + y * s, y * c - x * s, vectors[..., 2]], -1)


@dataclass
class Light:
    """Point lamp with a soft cone downwards (or all round), its strength in grey at one metre."""

    position: np.ndarray
    strength: float
    direction: np.ndarray | None = None


@dataclass
class Scene:
    room: np.ndarray  # half sizes
    boxes: list[Box]
    lights: list[Light]
    mips: list[np.ndarray]  # T x s x s, s = 256, 128, ... 8


# ---------------------------------------------------------------- textures

def _pattern(rng: np.random.Generator) -> np.ndarray:
    """A procedural texture TEXTURE x TEXTURE, grey 0..255: plain, noise, checks, stripes, bricks, planks or marks."""
    kind = rng.choice(["plain", "plain", "noise", "checks", "stripes", "bricks", "planks", "marks"])
    n = TEXTURE
    y, x = np.mgrid[:n, :n]
    low, high = np.sort(rng.uniform(30, 230, 2))
    cells = int(rng.integers(2, 10))
    if kind == "checks":
        image = np.where((x * cells // n + y * cells // n) % 2, high, low)
    elif kind == "stripes":
        image = np.where((x * cells * 2 // n) % 2, high, low)
    elif kind in ("bricks", "planks"):
        rows = cells + 2
        row = y * rows // n
        step = n / max(2, rows // 2)
        offset = (row % 2) * step / 2 if kind == "bricks" else row * 71 % step
        joint = (y * rows % n < 0.12 * n) | ((x + offset) % step < 3)
        tone = (row * 37 + ((x + offset) // step) * 61) % 17 / 17
        image = np.where(joint, low, high - 25 * tone)
    else:
        image = np.full((n, n), rng.uniform(60, 210))
    image = image.astype(F32)
    if kind == "marks":
        for _ in range(int(rng.integers(5, 40))):
            p, q = rng.integers(0, n, 2), rng.integers(5, 60, 2)
            cv2.rectangle(image, p.tolist(), (p + q).tolist(), float(rng.uniform(10, 245)), -1 if rng.random() < .6 else 2)
    grain = cv2.resize(rng.normal(0, 1, (n, n)).astype(F32), (n, n))
    coarse = cv2.resize(rng.normal(0, 1, (16, 16)).astype(F32), (n, n), interpolation=cv2.INTER_CUBIC)
    return image + grain * rng.uniform(1, 12 if kind == "noise" else 4) + coarse * rng.uniform(1, 14)


def _photo_texture(rng: np.random.Generator, files: list[Path]) -> np.ndarray:
    image = cv2.imread(str(files[rng.integers(len(files))]), cv2.IMREAD_GRAYSCALE)
    side = int(min(image.shape) * rng.uniform(0.6, 1))
    top, left = [int(rng.integers(0, s - side + 1)) for s in image.shape]
    return cv2.resize(image[top:top + side, left:left + side], (TEXTURE, TEXTURE), interpolation=cv2.INTER_AREA)


def make_textures(rng: np.random.Generator, files: list[Path], count: int = 20) -> list[np.ndarray]:
    """Mip levels of `count` textures (half photos, if there are any), albedo 0..1: a list of T x s x s arrays."""
    level = np.stack([_photo_texture(rng, files) if files and i % 2 else _pattern(rng) for i in range(count)]).astype(F32)
    mips = [np.clip(level, 5, 250) / 255]
    while mips[-1].shape[1] > 8:
        m = mips[-1]
        mips.append((m[:, ::2, ::2] + m[:, 1::2, ::2] + m[:, ::2, 1::2] + m[:, 1::2, 1::2]) / 4)
    return mips


# ---------------------------------------------------------------- furniture

class _Builder:
    """Fills a room with boxes; everything random comes from one generator."""

    def __init__(self, rng: np.random.Generator, room: np.ndarray):
        self.rng, self.room, self.boxes = rng, room, []

    def add(self, centre, half, yaw=0.0, texture=None, metres=None, emission=0.0) -> None:
        rng = self.rng
        texture = int(rng.integers(20)) if texture is None else texture
        metres = float(rng.uniform(0.4, 1.8)) if metres is None else metres
        self.boxes.append(Box(np.array(centre, F32), np.array(half, F32), yaw, texture, metres, emission))

    def wall_frame(self):
        """A random place on a wall: (origin at floor level, unit along the wall, unit into the room, yaw)."""
        side = int(self.rng.integers(4))
        yaw = side * np.pi / 2
        along, inward = np.array([np.cos(yaw), np.sin(yaw), 0]), np.array([-np.sin(yaw), np.cos(yaw), 0])
        depth, length = (self.room[1], self.room[0]) if side % 2 == 0 else (self.room[0], self.room[1])
        origin = -inward * depth + along * self.rng.uniform(-0.75, 0.75) * length
        origin[2] = -self.room[2]
        return origin, along, inward, yaw

    def panel(self, door: bool) -> None:
        """A door (from the floor) or a window / poster: a thin panel and a frame of four bars."""
        rng = self.rng
        origin, along, inward, yaw = self.wall_frame()
        w = rng.uniform(0.4, 0.6) if door else rng.uniform(0.3, 1.0)
        h = rng.uniform(0.95, 1.1) if door else rng.uniform(0.3, 0.7)
        z = h if door else rng.uniform(1.2, 1.7)
        bar, up = rng.uniform(0.02, 0.07), np.array([0, 0, 1])
        glow = rng.uniform(0.5, 1.2) if not door and rng.random() < 0.4 else 0.0
        tone = int(rng.integers(10)) * 2
        base = origin + inward * 0.02
        self.add(base + up * z, [w, 0.015, h], yaw, metres=2 * max(w, h), emission=glow)
        if rng.random() < 0.75:
            for side in (-1, 1):
                self.add(base + along * side * (w + bar) + up * z, [bar, 0.05, h + 2 * bar], yaw, tone)
                if not door or side > 0:
                    self.add(base + up * (z + side * (h + bar)), [w, 0.05, bar], yaw, tone)

    def shelf(self) -> None:
        """Uprights, boards, and goods on the boards."""
        rng = self.rng
        origin, along, inward, yaw = self.wall_frame()
        w, d, h = rng.uniform(0.5, 1.3), rng.uniform(0.15, 0.35), rng.uniform(0.6, 1.2)
        base, up = origin + inward * (d + 0.03), np.array([0, 0, 1])
        tone, thick = int(rng.integers(10)) * 2, rng.uniform(0.012, 0.03)
        for side in (-1, 1):
            self.add(base + along * side * w + up * h, [thick, d, h], yaw, tone)
        levels = int(rng.integers(3, 6))
        for k in range(levels):
            z = 2 * h * (k + 0.15) / levels
            self.add(base + up * z, [w, d, thick], yaw, tone)
            x = -w + 0.1
            while x < w - 0.15 and len(self.boxes) < 95:
                a, b = rng.uniform(0.06, 0.22), rng.uniform(0.06, 0.7 * h / levels)
                if rng.random() < 0.7:
                    self.add(base + along * (x + a) + up * (z + thick + b), [a, d * rng.uniform(0.4, 0.9), b], yaw)
                x += 2 * a + rng.uniform(0.02, 0.2)

    def table(self) -> None:
        rng = self.rng
        spot = rng.uniform(-0.6, 0.6, 2) * self.room[:2]
        yaw, w, d, h = rng.uniform(0, np.pi), rng.uniform(0.4, 0.9), rng.uniform(0.3, 0.5), rng.uniform(0.6, 0.9)
        c, s, tone = np.cos(yaw), np.sin(yaw), int(rng.integers(10)) * 2
        floor = -self.room[2]
        self.add([*spot, floor + h], [w, d, 0.02], yaw, tone)
        for x in (-w + 0.04, w - 0.04):
            for y in (-d + 0.04, d - 0.04):
                self.add([spot[0] + x * c - y * s, spot[1] + x * s + y * c, floor + h / 2], [0.025, 0.025, h / 2], yaw, tone)
        for _ in range(int(rng.integers(0, 4))):
            x, y, a = rng.uniform(-w, w) * 0.7, rng.uniform(-d, d) * 0.7, rng.uniform(0.05, 0.2, 3)
            self.add([spot[0] + x * c - y * s, spot[1] + x * s + y * c, floor + h + 0.02 + a[2]], a, rng.uniform(0, np.pi))

    def carton(self) -> None:
        rng = self.rng
        spot, half, yaw = rng.uniform(-0.9, 0.9, 2) * self.room[:2], rng.uniform(0.1, 0.5, 3), rng.uniform(0, np.pi)
        half[2] *= rng.choice([0.7, 1.0, 1.8])
        z = -self.room[2]
        for _ in range(int(rng.integers(1, 4))):
            self.add([*spot, z + half[2]], half, yaw + rng.normal(0, 0.2))
            z, half = z + 2 * half[2], half * rng.uniform(0.6, 0.95)

    def pillar(self) -> None:
        spot, a = self.rng.uniform(-0.8, 0.8, 2) * self.room[:2], self.rng.uniform(0.08, 0.3)
        self.add([*spot, 0], [a, a, self.room[2]], self.rng.choice([0.0, 0.5]))


def make_scene(seed: int, files: list[Path]) -> Scene:
    """Random room with furniture, textures and lamps."""
    rng = np.random.default_rng([seed, 1])
    room = np.array([rng.uniform(2, 6), rng.uniform(1.6, 4.5), rng.uniform(1.2, 2.0)], F32)
    b = _Builder(rng, room)
    for make, low, high in ((lambda: b.panel(True), 2, 5), (lambda: b.panel(False), 4, 9), (b.shelf, 0, 4),
                            (b.table, 0, 3), (b.carton, 2, 8), (b.pillar, 0, 3)):
        for _ in range(int(rng.integers(low, high))):
            make()
    lights = []
    for _ in range(2):
        p = np.array([*(rng.uniform(-0.8, 0.8, 2) * room[:2]), room[2] - rng.uniform(0.08, 0.5)], F32)
        down = np.array([rng.normal(0, .2), rng.normal(0, .2), -1], F32)
        lights.append(Light(p, float(rng.uniform(0.8, 3.0)), down / np.linalg.norm(down) if rng.random() < 0.6 else None))
        b.add(p + [0, 0, 0.06], [0.15, 0.15, 0.02], 0.0, 0, 1.0, emission=1.5)
    boxes = [Box(np.zeros(3, F32), room, 0.0, int(rng.integers(20)), float(rng.uniform(1.0, 4.0)), 0.0, True)]
    return Scene(room, boxes + b.boxes, lights, make_textures(rng, files))
