# SPDX-License-Identifier: BSD-3-Clause
"""Procedural rooms: images in several lightings with exact depth, camera poses and visible 3-D edges.

A scene is a room (a box seen from inside) full of boxes: shelves, tables, cartons, pillars, doors, windows, posters,
lamps. Faces carry photo crops or patterns. A vectorised ray caster intersects rays with the boxes; each light is
rendered on its own, so that the same view is mixed in several lightings. All is deterministic by seed.

World frame: z up, metres. Camera frame: x right, y down, z forward. Poses are `world_from_cam` (4 x 4).

    python -m airslam_training.procedural --scenes 200        writes scene_00000.npz ... to the cache
"""
from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from .cache import CACHE, SIZE, photo_split

WIDTH, HEIGHT = 384, 288
FOLDER = CACHE / "scenes"
DEPTH_UNIT = 0.0005  # metres a step of the stored 16-bit depth
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


# ---------------------------------------------------------------- ray casting

def _slabs(box: Box, origin: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Entry and exit parameters of rays (N x 3; origin 3 or N x 3) through a box, N each; entry > exit: a miss."""
    o = box.to_local(origin - box.centre)
    r = box.to_local(rays)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1 / np.where(np.abs(r) < 1e-9, F32(1e-9), r)
    a, b = (-box.half - o) * inverse, (box.half - o) * inverse
    low, high = np.minimum(a, b), np.maximum(a, b)
    return (np.maximum(np.maximum(low[..., 0], low[..., 1]), low[..., 2]),
            np.minimum(np.minimum(high[..., 0], high[..., 1]), high[..., 2]))


def intrinsics(focal: float) -> np.ndarray:
    return np.array([[focal, 0, (WIDTH - 1) / 2], [0, focal, (HEIGHT - 1) / 2], [0, 0, 1]])


def project(points: np.ndarray, world_from_cam: np.ndarray, k: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """World points N x 3 -> pixels N x 2 and depths N."""
    p = (points - world_from_cam[:3, 3]) @ world_from_cam[:3, :3]
    z = np.where(np.abs(p[:, 2]) < 1e-6, 1e-6, p[:, 2])
    return p[:, :2] / z[:, None] * np.diag(k)[:2] + k[:2, 2], p[:, 2]


def _window(box: Box, pose: np.ndarray, k: np.ndarray) -> tuple[int, int, int, int] | None:
    """Pixel window (top, bottom, left, right) that holds a box; None when it is out of view."""
    if box.inverted:
        return 0, HEIGHT, 0, WIDTH
    pixels, depth = project(box.corners(), pose, k)
    if depth.max() < 0.02:
        return None
    if depth.min() < 0.02:
        return 0, HEIGHT, 0, WIDTH
    left, top = np.floor(pixels.min(0)).astype(int)
    right, bottom = np.ceil(pixels.max(0)).astype(int) + 1
    left, top, right, bottom = max(left, 0), max(top, 0), min(right, WIDTH), min(bottom, HEIGHT)
    return (top, bottom, left, right) if left < right and top < bottom else None


def cast(scene: Scene, pose: np.ndarray, k: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Depth (z, metres) and index of the box seen, H x W each."""
    v, u = np.mgrid[:HEIGHT, :WIDTH].astype(F32)
    local = np.stack([(u - k[0, 2]) / k[0, 0], (v - k[1, 2]) / k[1, 1], np.ones_like(u)], -1).astype(F32)
    rays = local @ pose[:3, :3].T.astype(F32)
    origin = pose[:3, 3].astype(F32)
    depth, index = np.full((HEIGHT, WIDTH), 1e9, F32), np.zeros((HEIGHT, WIDTH), np.int16)
    for i, box in enumerate(scene.boxes):
        window = _window(box, pose, k)
        if window is None:
            continue
        part = np.s_[window[0]:window[1], window[2]:window[3]]
        enter, leave = _slabs(box, origin, rays[part])
        t = leave if box.inverted else enter
        hit = (t > 1e-3) & (t < depth[part]) & (enter <= leave)
        depth[part] = np.where(hit, t, depth[part])
        index[part] = np.where(hit, i, index[part])
    return depth, index


def _surface(scene: Scene, points: np.ndarray, index: np.ndarray, footprint: np.ndarray):
    """Albedo H x W, normals H x W x 3 and emission H x W at surface points; footprint: metres a pixel covers."""
    albedo, emission = np.zeros(index.shape, F32), np.zeros(index.shape, F32)
    normals = np.zeros(points.shape, F32)
    for i in np.unique(index):
        box, mask = scene.boxes[i], index == i
        p = box.to_local(points[mask] - box.centre)
        axis = np.argmax(np.abs(p) / box.half, axis=1)
        sign = np.sign(np.take_along_axis(p, axis[:, None], 1)[:, 0]) * (-1 if box.inverted else 1)
        local = np.zeros_like(p)
        np.put_along_axis(local, axis[:, None], sign[:, None], 1)
        normals[mask] = Box(box.centre, box.half, -box.yaw).to_local(local)
        uv = np.where((axis == 0)[:, None], p[:, [1, 2]], np.where((axis == 1)[:, None], p[:, [0, 2]], p[:, [0, 1]]))
        texture = (box.texture + axis * 2 * box.inverted) % len(scene.mips[0])
        uv = (uv - box.half[0]) / box.metres
        albedo[mask] = _texture(scene.mips, texture, uv * [1, -1], footprint[mask] / box.metres * TEXTURE)
        emission[mask] = box.emission
    return albedo, normals, emission


def _texture(mips: list[np.ndarray], texture: np.ndarray, uv: np.ndarray, texels: np.ndarray) -> np.ndarray:
    """Bilinear, mirrored texture lookup at the mip level whose texels match the pixel; N values."""
    level = np.clip(np.rint(np.log2(np.maximum(texels, 1e-6)) + 0.1), 0, len(mips) - 1).astype(int)
    out = np.zeros(len(uv), F32)
    for m in np.unique(level):
        s, use = mips[m].shape[1], level == m
        position = np.abs((uv[use] % 2 + 2) % 2 - 1) * (s - 1)
        cell = np.minimum(position.astype(int), s - 2)
        f = position - cell
        t, x, y, a, b = texture[use], cell[:, 0], cell[:, 1], f[:, 0], f[:, 1]
        map_ = mips[m]
        out[use] = (map_[t, y, x] * (1 - a) * (1 - b) + map_[t, y, x + 1] * a * (1 - b)
                    + map_[t, y + 1, x] * (1 - a) * b + map_[t, y + 1, x + 1] * a * b)
    return out


def _lit(scene: Scene, light: Light, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Light received from one lamp, with hard shadows: N values for N x 3 points and normals."""
    to_light = light.position - points
    distance = np.linalg.norm(to_light, axis=-1)
    direction = to_light / distance[:, None]
    received = np.maximum((direction * normals).sum(-1), 0) * light.strength / (0.3 + distance ** 2)
    if light.direction is not None:
        received *= 1 / (1 + np.exp(-12 * (-(direction @ light.direction) - 0.55)))
    active = np.nonzero(received > 1e-3)[0]
    start, ray = points[active] + normals[active] * F32(2e-3), to_light[active]
    free = np.ones(len(active), bool)
    if len(active) == 0:
        return received
    # Only boxes that reach into the hull of lamp and lit points can stand between them.
    low, high = np.minimum(start.min(0), light.position), np.maximum(start.max(0), light.position)
    for box in scene.boxes:
        corners = box.corners()
        if box.inverted or box.emission > 1.4 or (corners.max(0) < low).any() or (corners.min(0) > high).any():
            continue
        enter, leave = _slabs(box, start, ray)
        free &= ~((enter < leave) & (leave > 0) & (enter < 0.98))
    received[active] *= free
    return received


@dataclass
class View:
    """One rendered view: images L x H x W (uint8, the lightings), depth H x W (m), pose, edges."""

    images: np.ndarray
    depth: np.ndarray
    pose: np.ndarray
    edges: np.ndarray  # E x 10: x1, y1, x2, y2 in the image, then both end points in the world


def render(scene: Scene, pose: np.ndarray, k: np.ndarray, rng: np.random.Generator) -> View:
    """Render a view: all lamps; one lamp; a headlamp in the dark."""
    depth, index = cast(scene, pose, k)
    v, u = np.mgrid[:HEIGHT, :WIDTH].astype(F32)
    local = np.stack([(u - k[0, 2]) / k[0, 0], (v - k[1, 2]) / k[1, 1], np.ones_like(u)], -1).astype(F32)
    rays = local @ pose[:3, :3].T.astype(F32)
    points = rays * depth[..., None] + pose[:3, 3].astype(F32)
    footprint = depth / F32(k[0, 0])
    albedo, normals, emission = _surface(scene, points, index, footprint)
    flat = points.reshape(-1, 3), normals.reshape(-1, 3)
    lamps = [_lit(scene, light, *flat).reshape(depth.shape) for light in scene.lights]
    unit = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    facing = np.maximum(-(unit * normals).sum(-1), 0)
    beam = 1 / (1 + np.exp(-rng.uniform(12, 60) * (unit @ pose[:3, 2].astype(F32) - rng.uniform(0.8, 0.93))))
    headlamp = facing * beam * 4 / (0.5 + depth ** 2)
    ambient = 0.25 + 0.1 * normals[..., 2]
    one = int(rng.integers(len(lamps)))
    lightings = [(sum(lamps) + ambient, 1.0), (lamps[one] + rng.uniform(0.02, 0.1), 1.0),
                 (headlamp + rng.uniform(0.0, 0.03), 0.0)]
    images = [_expose(albedo * light + emission * albedo * on, index) for light, on in lightings]
    return View(np.stack(images), depth, pose, visible_edges(scene, pose, k, depth))


def _expose(radiance: np.ndarray, index: np.ndarray) -> np.ndarray:
    """Camera response: exposure by the 92nd percentile, soft shoulder, gamma, softened silhouettes; uint8."""
    x = radiance / max(float(np.percentile(radiance, 92)), 1e-3) * 0.75
    x = 255 * (x / (1 + 0.25 * x)).clip(0, 1.2) ** (1 / 1.8)
    edge = cv2.dilate(index, np.ones((2, 2), np.uint8)) != cv2.erode(index, np.ones((2, 2), np.uint8))
    smooth = cv2.GaussianBlur(x, (3, 3), 0.7)
    return np.clip(np.rint(np.where(edge, smooth, x)), 0, 255).astype(np.uint8)


# ---------------------------------------------------------------- edges, motion, files

EDGES = [(a, a | 1 << k) for k in range(3) for a in range(8) if not a >> k & 1]


def visible_edges(scene: Scene, pose: np.ndarray, k: np.ndarray, depth: np.ndarray, shortest: float = 12) -> np.ndarray:
    """Visible stretches of the boxes' edges, E x 10 (see View.edges): an edge point is visible when nothing is nearer."""
    farthest = cv2.dilate(depth, np.ones((3, 3), np.uint8))
    found = []
    for box in scene.boxes:
        if _window(box, pose, k) is None:
            continue
        corners = box.corners()
        for a, b in EDGES:
            t = np.linspace(0, 1, 160)[:, None]
            points = corners[a] * (1 - t) + corners[b] * t
            pixels, z = project(points, pose, k)
            xy = np.rint(pixels).clip(-1, 1e4).astype(int)
            good = (z > 0.05) & (xy >= 1).all(1) & (xy[:, 0] < WIDTH - 1) & (xy[:, 1] < HEIGHT - 1)
            good[good] = z[good] < farthest[xy[good, 1], xy[good, 0]] * 1.004 + 0.006
            bounds = np.flatnonzero(np.diff(np.concatenate([[0], good.astype(int), [0]])))
            for first, last in zip(bounds[::2], bounds[1::2] - 1):
                if np.linalg.norm(pixels[last] - pixels[first]) >= shortest:
                    found.append(np.concatenate([pixels[first], pixels[last], points[first], points[last]]))
    return np.array(found, F32).reshape(-1, 10)


def look(position: np.ndarray, yaw: float, pitch: float, roll: float) -> np.ndarray:
    """`world_from_cam` of a camera that looks along yaw (about z), pitched up, rolled."""
    cy, sy, cp, sp = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch)
    forward = np.array([cy * cp, sy * cp, sp])
    right = np.array([sy, -cy, 0])
    down = np.cross(forward, right)
    c, s = np.cos(roll), np.sin(roll)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right * c + down * s, down * c - right * s, forward], 1)
    pose[:3, 3] = position
    return pose


def _free(scene: Scene, p: np.ndarray, margin: float = 0.2) -> bool:
    """A camera at p is inside the room and not in (or close to) a box."""
    if (np.abs(p) > scene.room - margin).any():
        return False
    return all((np.abs(b.to_local(p - b.centre)) > b.half + margin).any() for b in scene.boxes if not b.inverted)


def path(scene: Scene, rng: np.random.Generator, count: int) -> list[np.ndarray]:
    """Poses of a short walk: every second one is the stereo partner of the one before."""
    for _ in range(500):
        p = np.array([*(rng.uniform(-0.85, 0.85, 2) * scene.room[:2]), rng.uniform(-0.6, 0.4) * scene.room[2]])
        yaw = rng.uniform(0, 2 * np.pi)
        ahead = p + 0.9 * np.array([np.cos(yaw), np.sin(yaw), 0])
        if _free(scene, p, 0.3) and _free(scene, ahead, 0.1):
            break
    pitch, roll, poses = rng.normal(0, 0.1), 0.0, []
    while len(poses) < count:
        pose = look(p, yaw, pitch, roll)
        right = pose.copy()
        right[:3, 3] += pose[:3, 0] * rng.uniform(0.06, 0.25)
        poses += [pose, right]
        for _ in range(50):
            step = rng.uniform(0.1, 1.0) * np.array([np.cos(yaw), np.sin(yaw), 0]) + rng.normal(0, 0.25, 3) * [1, 1, 0.4]
            if _free(scene, p + step):
                p = p + step
                break
        yaw, pitch, roll = yaw + rng.normal(0, 0.25), np.clip(pitch + rng.normal(0, .06), -.4, .4), rng.normal(0, 0.05)
    return poses[:count]


def make_views(seed: int, files: list[Path], count: int = 6) -> tuple[np.ndarray, list[View]]:
    """Intrinsics (3 x 3) and `count` views of scene `seed`."""
    scene = make_scene(seed, files)
    rng = np.random.default_rng([seed, 2])
    k = intrinsics(rng.uniform(210, 360))
    return k, [render(scene, pose, k, rng) for pose in path(scene, rng, count)]


def save_scene(seed: int, files: list[Path], name: str) -> None:
    k, views = make_views(seed, files)
    edges = {f"edges{i}": v.edges for i, v in enumerate(views)}
    depth = np.stack([np.clip(v.depth / DEPTH_UNIT, 0, 65535).astype(np.uint16) for v in views])
    np.savez(FOLDER / f"{name}.tmp.npz", k=k, images=np.stack([v.images for v in views]), depth=depth,
             poses=np.stack([v.pose for v in views]), **edges)
    (FOLDER / f"{name}.tmp.npz").rename(FOLDER / f"{name}.npz")


def cached_crops(count: int, seed: int):
    """Generator of `count` crops SIZE x SIZE of the evenly lit and one-lamp images, for the PLNet cache."""
    rng = np.random.default_rng(seed)
    files = sorted(FOLDER.glob("scene_*.npz"))
    per_file = -(-count // len(files))
    for f in files:
        images = np.load(f)["images"]
        for _ in range(per_file):
            image = images[rng.integers(len(images)), int(rng.random() < 0.3)]
            y, x = rng.integers(0, HEIGHT - SIZE + 1), rng.integers(0, WIDTH - SIZE + 1)
            yield image[y:y + SIZE, x:x + SIZE]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=200)
    parser.add_argument("--held", type=int, default=12)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    FOLDER.mkdir(parents=True, exist_ok=True)
    train, held = photo_split()
    names = [(f"held_{i:05d}", 100000 + i, held) for i in range(options.held)]
    names += [(f"scene_{i:05d}", i, train) for i in range(options.scenes)]
    for name, seed, files in names:
        if not (FOLDER / f"{name}.npz").exists():
            save_scene(seed, files, name)
            print(name, flush=True)


if __name__ == "__main__":
    main()
