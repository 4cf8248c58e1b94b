# SPDX-License-Identifier: BSD-3-Clause
"""What a camera sees of a procedural room: images in several lightings, exact depth and visible 3-D edges.

A vectorised ray caster intersects rays with the boxes; each light is rendered on its own, so that the same view is mixed in
several lightings. Camera frame: x right, y down, z forward. Poses are `world_from_cam` (4 x 4).
"""
from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from .rooms import F32, TEXTURE, Box, Light, Scene

WIDTH, HEIGHT = 384, 288


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


# ---------------------------------------------------------------- edges

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
