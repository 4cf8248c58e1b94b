# SPDX-License-Identifier: BSD-3-Clause
"""Pictures to look at: curves of both trainings, matches under changed light, a procedural scene with its edges.

    python -m airslam_training.draw [curves] [matches] [scene]

Curves and the scene (patterns only) go to training/results. Matches show training photos, whose licences are mixed:
those pictures stay in the cache and are not to be committed.
"""
from __future__ import annotations

import argparse
import csv
import shutil

import cv2
import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt

from . import procedural
from .cache import CACHE
from .evaluate import RESULTS, THRESHOLD, light_pairs
from .geometry import warp_points
from .methods import methods

PICTURES = CACHE / "pictures"


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
    """Losses and validation of both runs; the csv logs are copied beside the pictures."""
    for name in ("plnet", "matcher"):
        folder = CACHE / "runs" / name
        if not (folder / "validation.csv").exists():
            continue
        for kind in ("log", "validation"):
            shutil.copyfile(folder / f"{kind}.csv", RESULTS / f"{name}_{kind}.csv")
        log, validation = read(folder / "log.csv"), read(folder / "validation.csv")
        figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4))
        for k in log:
            if k not in ("step", "crops", "pairs", "rate", "crops_per_s", "pairs_per_s"):
                left.plot(log["step"], log[k], label=k, lw=0.9)
        left.set(yscale="log", xlabel="step", title=f"{name}: training losses")
        sets = np.unique(validation["set"]) if "set" in validation else [None]
        for s in sets:
            part = slice(None) if s is None else validation["set"] == s
            for k, v in validation.items():
                if k not in ("step", "set", "correct", "correct_dark"):
                    right.plot(validation["step"][part], v[part], ".-", label=k if s is None else f"{s} {k}", lw=0.9)
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", default=["curves", "matches", "scene"])
    for part in parser.parse_args().parts:
        {"curves": curves, "matches": matches, "scene": scene}[part]()


if __name__ == "__main__":
    main()
