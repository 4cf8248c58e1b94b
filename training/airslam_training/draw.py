# SPDX-License-Identifier: BSD-3-Clause
"""Pictures to look at: curves of the trainings, matches under changed light, a procedural scene with its edges, lines.

    python -m airslam_training.draw [curves] [matches] [scene] [lines]

Curves and the scene (patterns only) go to training/results, lines in rooms without photos and in
the warehouse to docs/images. Matches and
lines on photos stay in the cache: the photos' licences are mixed, they are not to be committed.
"""
from __future__ import annotations

import argparse
import csv
import shutil

import cv2
import matplotlib
import numpy as np
import torch

matplotlib.use("Agg")
import matplotlib.pyplot as plt

from . import augment, procedural
from .cache import CACHE, photo_split
from .evaluate import RESULTS, THRESHOLD, light_pairs
from .evaluate_lines import ours
from .geometry import warp_points
from .methods import methods
from .teacher import SHARED

PICTURES = CACHE / "pictures"
# Frames of both warehouse sequences, whose lamps are almost out, dim or dazzling in the second.
WAREHOUSE = (70, 75, 142, 150, 225)


def read(path) -> dict[str, np.ndarray]:
    """Columns of a csv log; those that are not numbers stay text."""
    with open(path) as f:
        rows = list(csv.DictReader(f))
    columns = {}
    for k in rows[0]:
        values = [r[k] for r in rows]
        try:
            columns[k] = np.array(values, float)
        except ValueError:
            columns[k] = np.array(values)
    return columns


def curves() -> None:
    """Losses and validation of every run; the csv logs are copied beside the pictures."""
    for name in ("plnet", "lines", "lines_ends", "lines_long", "matcher"):
        folder = CACHE / "runs" / name
        if not (folder / "validation.csv").exists():
            continue
        for kind in ("log", "validation"):
            shutil.copyfile(folder / f"{kind}.csv", RESULTS / f"{name}_{kind}.csv")
        log, validation = read(folder / "log.csv"), read(folder / "validation.csv")
        figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4))
        for k in log:
            if k not in ("step", "crops", "pairs", "images", "rate", "crops_per_s", "pairs_per_s", "images_per_s"):
                left.plot(log["step"], log[k], label=k, lw=0.9)
        left.set(yscale="log", xlabel="step", title=f"{name}: training losses")
        sets = np.unique(validation["set"]) if "set" in validation else [None]
        for s in sets:
            part = slice(None) if s is None else validation["set"] == s
            for k, v in validation.items():
                if k not in ("step", "set", "correct", "correct_dark", "count"):
                    share = v[part] / 100 if k.endswith("sap10") else v[part]
                    right.plot(validation["step"][part], share, ".-", label=k if s is None else f"{s} {k}", lw=0.9)
        right.set(xlabel="step", title="held-out photos and scenes", ylim=(0, 1))
        left.legend(fontsize=7), right.legend(fontsize=6)
        figure.tight_layout()
        figure.savefig(RESULTS / f"{name}_curves.png", dpi=90)
        plt.close(figure)


def draw_matches(a: np.ndarray, b: np.ndarray, found, pairs: np.ndarray, b_from_a: np.ndarray) -> np.ndarray:
    """Both images side by side (b brightened to be seen), keypoints, matches: green right, red wrong."""
    shown = [a, cv2.normalize(b, None, 0, 255, cv2.NORM_MINMAX)]
    canvas = cv2.cvtColor(np.hstack(shown), cv2.COLOR_GRAY2BGR)
    shift = np.array([a.shape[1], 0])
    for points, offset in ((found[0][0], 0), (found[1][0], shift)):
        for p in np.rint(points + offset).astype(int):
            cv2.circle(canvas, p.tolist(), 1, (255, 160, 0), -1)
    error = np.linalg.norm(warp_points(b_from_a, found[0][0][pairs[:, 0]]) - found[1][0][pairs[:, 1]], axis=1)
    for (i, j), e in zip(pairs, error):
        colour = (0, 200, 0) if e <= THRESHOLD else (0, 0, 255)
        ends = np.rint([found[0][0][i], found[1][0][j] + shift]).astype(int)
        cv2.line(canvas, ends[0].tolist(), ends[1].tolist(), colour, 1, cv2.LINE_AA)
    return canvas


def matches(count: int = 3) -> None:
    """Ours (nearest neighbours, and with the matcher if there is one) on dark and spot-lit held-out photos."""
    compared = [m for m in methods() if m.name.startswith("ours") and m.name != "ours"]
    for name, pairs in light_pairs().items():
        if name not in ("dark", "spot, dark"):
            continue
        rows = []
        for a, b, h in pairs[4:4 + count]:
            row = []
            for m in compared:
                found = m.detect(a, m.count), m.detect(b, m.count)
                pairs_found = m.match(*found, a.shape[::-1], b.shape[::-1])
                row.append(cv2.resize(draw_matches(a, b, found, pairs_found, h), (760, 280)))
            rows.append(np.hstack(row))
        PICTURES.mkdir(exist_ok=True)
        cv2.imwrite(str(PICTURES / f"matches_{name.replace(', ', '_')}.png"), np.vstack(rows))


def scene(seed: int = 100003) -> None:
    """The three lightings of one procedural view without photos, its depth and its edges."""
    _, views = procedural.make_views(seed, [], 1)
    view = views[0]
    edges = cv2.cvtColor(view.images[0], cv2.COLOR_GRAY2BGR)
    for e in view.edges:
        cv2.line(edges, *[tuple(np.rint(p).astype(int).tolist()) for p in (e[:2], e[2:4])], (0, 255, 0), 1, cv2.LINE_AA)
    depth = cv2.cvtColor(cv2.normalize(view.depth, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8), cv2.COLOR_GRAY2BGR)
    lit = [cv2.cvtColor(i, cv2.COLOR_GRAY2BGR) for i in view.images]
    cv2.imwrite(str(RESULTS / "procedural_scene.png"), np.hstack(lit + [depth, edges]))


def draw_lines(image: np.ndarray, found: np.ndarray, size: tuple[int, int], least: float = 0.3) -> np.ndarray:
    """A grey image, brightened and scaled to `size`, with lines n x 5 over `least`: red doubtful, green sure."""
    canvas = cv2.cvtColor(cv2.resize(cv2.normalize(image, None, 0, 255, cv2.NORM_MINMAX), size), cv2.COLOR_GRAY2BGR)
    scale = np.tile(np.array(size) / image.shape[::-1], 2)
    for line in found[found[:, 4] >= least][::-1]:
        p = np.rint(((line[:4] + 0.5) * scale - 0.5) * 8).astype(int)
        sure = min((line[4] - least) / (0.8 - least), 1)
        cv2.line(canvas, p[:2].tolist(), p[2:].tolist(), (0, 60 + 195 * sure, 255 * (1 - sure)), 1, cv2.LINE_AA, 3)
        for end in (p[:2], p[2:]):
            cv2.circle(canvas, end.tolist(), 14, (0, 230, 255), -1, cv2.LINE_AA, 3)
    return canvas


def lines(photos: int = 15) -> None:
    """Lines of three rooms without photos, in three lightings each; and of held-out photos, light and dark."""
    detector = ours(CACHE / "runs/lines_long/checkpoint.pt")

    def tile(image: np.ndarray, size: tuple[int, int]) -> np.ndarray:
        large = cv2.resize(image, None, fx=480 / min(image.shape), fy=480 / min(image.shape))
        return draw_lines(large, detector(large), size)

    rows = []
    for seed in (100001, 100003, 100007):
        _, views = procedural.make_views(seed, [], 1)
        rows.append(np.hstack([tile(i, (384, 288)) for i in views[0].images]))
    cv2.imwrite(str(RESULTS.parents[1] / "docs/images/lines_rooms.jpg"), np.vstack(rows), [cv2.IMWRITE_JPEG_QUALITY, 85])
    rows = []
    for light in ("day", "dynamic"):
        files = sorted((SHARED / f"data/warehouse_{light}/mav0/cam0/data").iterdir())
        images = [cv2.imread(str(files[k]), cv2.IMREAD_GRAYSCALE) for k in WAREHOUSE]
        rows.append(np.hstack([tile(i, (376, 240)) for i in images]))
    cv2.imwrite(str(RESULTS.parents[1] / "docs/images/lines_warehouse.jpg"), np.vstack(rows), [cv2.IMWRITE_JPEG_QUALITY, 85])
    g = torch.Generator().manual_seed(5)
    rows = []
    for file in photo_split()[1][:photos]:
        image = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
        dark = augment.noise(augment.darken(torch.from_numpy(image)[None, None].float(), g), g).round().clamp(0, 255)
        rows.append(np.hstack([tile(i, (560, 400)) for i in (image, dark[0, 0].numpy().astype(np.uint8))]))
    PICTURES.mkdir(exist_ok=True)
    for k in range(0, len(rows), 5):
        cv2.imwrite(str(PICTURES / f"lines_{k // 5}.jpg"), np.vstack(rows[k:k + 5]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", default=["curves", "matches", "scene", "lines"])
    for part in parser.parse_args().parts:
        {"curves": curves, "matches": matches, "scene": scene, "lines": lines}[part]()


if __name__ == "__main__":
    main()
