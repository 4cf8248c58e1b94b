# SPDX-License-Identifier: BSD-3-Clause
"""Procedural scenes: short walks with a stereo camera through rooms of their own, and their files.

All is deterministic by seed; frames and poses as in rooms.py and ray_cast.py.

    python -m airslam_training.procedural --scenes 200        writes scene_00000.npz ... to the cache
"""
from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np

from .cache import CACHE, SIZE, photo_split
from .ray_cast import HEIGHT, WIDTH, View, intrinsics, render
from .rooms import Scene, make_scene

FOLDER = CACHE / "scenes"
DEPTH_UNIT = 0.0005  # metres a step of the stored 16-bit depth


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
