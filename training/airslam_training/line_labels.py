# SPDX-License-Identifier: BSD-3-Clause
"""Segments to train on: `python -m airslam_training.line_labels` merges what `mlsd` collected.

Photos: the teacher's segments of all views of a photo are brought together; each cluster is scored by how surely it is
found in the views that hold it (homographic adaptation), and its line is fitted to the image's gradients. Procedural
views: the exact visible edges, with the teacher's segments beside them (textures carry lines, too), each weighted by its
contrast in the lighting at hand. A label is x1, y1, x2, y2 (pixels of the image), score in 0..1; ends that meet are one
point. The file `lines/labels.npz` holds an n x 5 array for each name (scenes: `scene_00000_VIEW_LIGHTING`).
"""
from __future__ import annotations

import argparse
import json
from pathlib import Path

import cv2
import numpy as np

from .cache import CACHE, photo_split
from .geometry import inside, warp_points
from .loop import ROOT
from .mlsd import FOLDER, INPUT

SCENES = CACHE / "scenes"
PHOTOS = ROOT / "labels/photos.npz"  # the photos' labels, shipped: the teacher's answers take an hour
UNIT, LEVELS = 8, 255  # in that file, steps of a pixel and of the score


def end_distance(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Larger of the two end distances of segments a (n x 4) and b (m x 4), the better of both directions: n x m."""
    p, q = a[:, None, :4].reshape(-1, 1, 2, 2), b[None, :, :4].reshape(1, -1, 2, 2)
    forward = np.linalg.norm(p - q, axis=-1).max(-1)
    return np.minimum(forward, np.linalg.norm(p - q[:, :, ::-1], axis=-1).max(-1))


def lengths(segments: np.ndarray) -> np.ndarray:
    return np.hypot(segments[:, 2] - segments[:, 0], segments[:, 3] - segments[:, 1])


# ---------------------------------------------------------------- homographic adaptation

def _cut_by_view(segments: np.ndarray, h: np.ndarray, shape: tuple[int, int], margin: float = 10) -> np.ndarray:
    """n bools: an end lies at the view's border but not at the image's: the segment goes on outside the view."""
    ends = segments[:, :4].reshape(-1, 2)
    at_view = ~inside(warp_points(h, ends), (INPUT, INPUT), margin)
    at_image = ~inside(ends, shape[::-1], 3)
    return (at_view & ~at_image).reshape(-1, 2).any(1)


def merge_views(raw: dict, shape: tuple[int, int], tolerance: float = 5.0, least: float = 0.06) -> np.ndarray:
    """Clusters of the segments of all views, n x 5; the score is the sum over views / the number of views that hold it.

    `tolerance` (pixels) is how far the ends of one segment may lie apart between views, at most 30 % of its length.
    """
    count = sum(k.startswith("segments") for k in raw)
    pool, views = [], []
    for k in range(count):
        found = raw[f"segments{k}"].astype(np.float64)
        found = found[~_cut_by_view(found, raw[f"view_from_image{k}"], shape)] if len(found) else found
        pool.append(found)
        views.append(np.full(len(found), k))
    pool, views = np.concatenate(pool), np.concatenate(views)
    order = np.argsort(-pool[:, 4], kind="stable")
    pool, views = pool[order], views[order]
    near = end_distance(pool, pool) < np.minimum(tolerance, 0.3 * np.maximum(lengths(pool), 4))[:, None]
    free, clusters = np.ones(len(pool), bool), []
    for i in range(len(pool)):
        if not free[i]:
            continue
        members = np.flatnonzero(near[i] & free)
        free[members] = False
        clusters.append(_cluster(pool[members], views[members], raw, count, shape))
    merged = np.array(clusters).reshape(-1, 5)
    return merged[merged[:, 4] >= least]


def _cluster(members: np.ndarray, views: np.ndarray, raw: dict, count: int, shape: tuple[int, int]) -> np.ndarray:
    """Score-weighted mean segment of a cluster, and its consistency."""
    best = members[0]
    ends = members[:, :4].copy()
    swap = (np.linalg.norm(ends[:, :2] - best[:2], axis=1) + np.linalg.norm(ends[:, 2:] - best[2:4], axis=1)
            > np.linalg.norm(ends[:, 2:] - best[:2], axis=1) + np.linalg.norm(ends[:, :2] - best[2:4], axis=1))
    ends[swap] = ends[swap][:, [2, 3, 0, 1]]
    mean = (ends * members[:, 4:]).sum(0) / members[:, 4].sum()
    holding = sum(bool(inside(warp_points(raw[f"view_from_image{k}"], mean.reshape(2, 2)), (INPUT, INPUT), 2).all())
                  or k < 2 for k in range(count))
    total = sum(members[views == k, 4].max() for k in np.unique(views))
    w, h = shape[1] - 1, shape[0] - 1
    return np.append(np.clip(mean, 0, [w, h, w, h]), min(total / holding, 1.0))


# ---------------------------------------------------------------- gradients

def _profiles(image: np.ndarray, segment: np.ndarray, offsets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Grey values across a segment: positions along it (0..1) n, and n x len(offsets) values."""
    p, q = segment[:2], segment[2:4]
    n = int(np.clip(np.hypot(*(q - p)) / 2, 6, 60))
    s = (np.arange(n) + 0.5) / n
    normal = np.array([p[1] - q[1], q[0] - p[0]]) / max(np.hypot(*(q - p)), 1e-6)
    points = p + s[:, None] * (q - p)
    grid = (points[:, None] + offsets[None, :, None] * normal).astype(np.float32)
    return s, cv2.remap(image, grid[..., 0], grid[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def refine(image: np.ndarray, segments: np.ndarray, reach: float = 2.0) -> np.ndarray:
    """Segments moved across their direction to the crest of the gradient (at most `reach` pixels at either end)."""
    smooth = cv2.GaussianBlur(image, (0, 0), 0.8).astype(np.float32)
    offsets = np.arange(-reach - 1, reach + 1.01, 0.5)
    refined = segments.copy()
    for segment in refined:
        s, grey = _profiles(smooth, segment, offsets)
        gradient = np.abs(grey[:, 2:] - grey[:, :-2])
        t = offsets[1:-1]
        weight = np.maximum(gradient - 0.6 * gradient.max(1, keepdims=True), 0) ** 2 * np.exp(-0.5 * (t / reach) ** 2)
        total = weight.sum(1)
        where, sure = (weight * t).sum(1) / np.maximum(total, 1e-6), np.minimum(gradient.max(1), 30)
        for _ in range(3):  # a line through the crests, those far from it counting little
            a = np.stack([1 - s, s], 1) * sure[:, None]
            ends = np.linalg.solve(a.T @ a + 2 * np.eye(2), a.T @ (where * sure))
            sure = np.minimum(gradient.max(1), 30) / (1 + (np.abs(where - np.stack([1 - s, s], 1) @ ends) / 0.5) ** 2)
        if np.abs(ends).max() <= reach:
            p, q = segment[:2], segment[2:4]
            normal = np.array([p[1] - q[1], q[0] - p[0]]) / max(np.hypot(*(q - p)), 1e-6)
            segment[:4] += np.concatenate([normal * ends[0], normal * ends[1]])
    return refined


def visibility(image: np.ndarray, segments: np.ndarray, contrast: float = 5.0) -> np.ndarray:
    """How much of each segment has a step of at least `contrast` grey levels across it: n values in 0..1."""
    offsets = np.array([-3.0, -2.0, -1.2, 1.2, 2.0, 3.0])
    shares = []
    for segment in segments:
        _, grey = _profiles(image.astype(np.float32), segment, offsets)
        near, far = np.abs(grey[:, 2] - grey[:, 3]), np.abs(grey[:, :3].mean(1) - grey[:, 3:].mean(1))
        shares.append((np.maximum(near, far) > contrast).mean())
    return np.clip((np.array(shares) - 0.2) / 0.5, 0, 1)


def join_ends(segments: np.ndarray, distance: float = 2.5) -> np.ndarray:
    """Ends nearer to each other than `distance` become one point, the score-weighted mean; too short ones are dropped."""
    ends, weight = segments[:, :4].reshape(-1, 2).copy(), np.repeat(segments[:, 4], 2)
    free = np.ones(len(ends), bool)
    for i in np.argsort(-weight, kind="stable"):
        if free[i]:
            group = np.flatnonzero(free & (np.linalg.norm(ends - ends[i], axis=1) < distance))
            free[group] = False
            ends[group] = (ends[group] * weight[group, None]).sum(0) / weight[group].sum()
    joined = np.concatenate([ends.reshape(-1, 4), segments[:, 4:]], 1)
    return joined[lengths(joined) > distance]


def without_doubles(segments: np.ndarray, distance: float = 3.0) -> np.ndarray:
    """Best first, without those whose ends both lie within `distance` of a better one's."""
    segments = segments[np.argsort(-segments[:, 4], kind="stable")]
    near = end_distance(segments, segments) < distance
    keep: list[int] = []
    for i in range(len(segments)):
        if not near[i, keep].any():
            keep.append(i)
    return segments[keep]


# ---------------------------------------------------------------- both sources

def photo_labels(name: str, image: np.ndarray) -> np.ndarray:
    merged = merge_views(dict(np.load(FOLDER / "raw" / f"{name}.npz")), image.shape)
    if len(merged) == 0:
        return np.zeros((0, 5), np.float32)
    return without_doubles(join_ends(refine(image, merged))).astype(np.float32)


def scene_labels(edges: np.ndarray, taught: np.ndarray, images: np.ndarray, exact: float = 0.85) -> list[np.ndarray]:
    """Labels of each lighting of a procedural view: exact edges (E x 4), and the teacher's segments where no edge is."""
    segments = np.concatenate([edges, np.full((len(edges), 1), exact)], 1)
    segments = without_doubles(segments[lengths(segments) >= 12], 2.5)
    if len(taught):
        taught = taught[taught[:, 4] > 0.06]
        new = end_distance(taught, segments).min(1, initial=np.inf) > 6
        segments = np.concatenate([segments, refine(images[0], taught[new].astype(np.float64))])
    labels = []
    for image in images:
        lit = segments.copy()
        lit[:, 4] *= visibility(image, lit)
        lit = lit[lit[:, 4] > 0.04]
        labels.append((join_ends(lit, 1.5) if len(lit) else lit).astype(np.float32))
    return labels


def read_wireframe(file: Path) -> tuple[str, np.ndarray]:
    """(image name, segments n x 5 with score 1) of a raw annotation of the Wireframe dataset, one JSON object:
    `filename`, `junctions` (x, y) or `junc`, and `edges_positive` or `lines`: pairs of junction indices."""
    data = json.loads(file.read_text())
    key = next((k for k in ("junctions", "junc") if k in data), None)
    pairs = next((k for k in ("edges_positive", "lines") if k in data), None)
    if key is None or pairs is None:
        raise ValueError(f"{file}: not a Wireframe annotation: it has {sorted(data)}, expected junctions and edges")
    junctions = np.array(data[key], np.float32).reshape(-1, 2)
    edges = np.array(data[pairs], int).reshape(-1, 2)
    if len(edges) and (edges.min() < 0 or edges.max() >= len(junctions)):
        raise ValueError(f"{file}: an edge names a junction outside 0..{len(junctions) - 1}")
    ends = junctions[edges].reshape(-1, 4)
    return data.get("filename", file.with_suffix(".png").name), np.concatenate([ends, np.ones((len(ends), 1), np.float32)], 1)


def write_packed(file: Path, labels: dict[str, np.ndarray]) -> None:
    """Labels n x 5 of each name in few bytes: all rows one after the other as integers, and how many each name has."""
    rows = np.concatenate([*labels.values(), np.zeros((0, 5))]) * ([UNIT] * 4 + [LEVELS])
    file.parent.mkdir(exist_ok=True)
    np.savez_compressed(file, names=np.array(list(labels)), counts=np.array([len(v) for v in labels.values()]),
                        rows=np.rint(rows).astype(np.int16))


def read_packed(file: Path) -> dict[str, np.ndarray]:
    """What `write_packed` wrote, within half a step; nothing where there is no file."""
    if not file.exists():
        return {}
    data = np.load(file)
    rows = (data["rows"] / ([UNIT] * 4 + [LEVELS])).astype(np.float32)
    return dict(zip(data["names"].tolist(), np.split(rows, np.cumsum(data["counts"])[:-1])))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.parse_args()
    cv2.setNumThreads(1)
    labels = read_packed(PHOTOS)
    for file in sum(photo_split(), []):
        if (FOLDER / "raw" / f"{file.stem}.npz").exists():
            labels[file.stem] = photo_labels(file.stem, cv2.imread(str(file), cv2.IMREAD_GRAYSCALE))
    write_packed(PHOTOS, labels)
    print(f"{len(labels)} photos, {np.mean([(v[:, 4] > 0.3).sum() for v in labels.values()]):.0f} sure segments each")
    for file in sorted(SCENES.glob("*.npz")):
        data = np.load(file)
        for i, images in enumerate(data["images"]):
            raw = FOLDER / "raw" / f"{file.stem}_{i}.npz"
            taught = np.load(raw)["segments0"] if raw.exists() else np.zeros((0, 5), np.float32)
            for k, found in enumerate(scene_labels(data[f"edges{i}"][:, :4], taught, images)):
                labels[f"{file.stem}_{i}_{k}"] = found
    np.savez(FOLDER / "labels.tmp.npz", **labels)
    (FOLDER / "labels.tmp.npz").rename(FOLDER / "labels.npz")
    print(f"{len(labels)} images")


if __name__ == "__main__":
    main()
