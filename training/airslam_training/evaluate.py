# SPDX-License-Identifier: BSD-3-Clause
"""Matching tables: Oxford affine (evaluation only) and synthetic light on held-out photos.

    python -m airslam_training.evaluate [oxford] [light]      writes training/results/*.md and quality.json
"""
from __future__ import annotations

import argparse
import json
from pathlib import Path

import cv2
import numpy as np
import torch

from . import augment
from .cache import photo_split
from .export import PACK
from .geometry import HomographyRange, inside, random_homography, warp_image, warp_points
from .loop import ROOT
from .methods import Method, methods
from .teacher import SHARED

THRESHOLD = 3.0
RESULTS = ROOT / "results"


def oxford_pairs(name: str, longer: int = 640):
    """(image 1, image k, homography) of a sequence, longer side 640, k = 2..6."""
    folder = SHARED / "data/oxford_affine" / name
    images, scales = [], []
    for k in range(1, 7):
        image = cv2.imread(str(next(folder.glob(f"img{k}.*"))), cv2.IMREAD_GRAYSCALE)
        s = longer / max(image.shape)
        images.append(cv2.resize(image, None, fx=s, fy=s, interpolation=cv2.INTER_AREA))
        half = (s - 1) / 2  # pixel centres keep their place: (x + 0.5) s - 0.5
        scales.append(np.array([[s, 0, half], [0, s, half], [0, 0, 1]]))
    for k in range(2, 7):
        storage = cv2.FileStorage(str(folder / f"H1to{k}p.xml"), cv2.FILE_STORAGE_READ)
        h = storage.getNode(f"H1{k}").mat()
        yield images[0], images[k - 1], scales[k - 1] @ h @ np.linalg.inv(scales[0])


def judge(method: Method, a, b, sizes, b_from_a: np.ndarray) -> tuple[float, float, float]:
    """(accuracy, correct matches, repeatability) of one pair at 3 pixels; a and b are detections."""
    pairs = method.match(a, b, *sizes)
    there = warp_points(b_from_a, a[0]) if len(a[0]) else np.zeros((0, 2))
    correct = int((np.linalg.norm(there[pairs[:, 0]] - b[0][pairs[:, 1]], axis=1) <= THRESHOLD).sum())
    seen = there[inside(there, sizes[1], 4)]
    if len(seen) == 0 or len(b[0]) == 0:
        return 0.0, 0.0, 0.0
    near = np.linalg.norm(seen[:, None] - b[0][None], axis=-1).min(1)
    return correct / max(len(pairs), 1), correct, float((near <= THRESHOLD).mean())


def evaluate(method: Method, pairs) -> np.ndarray:
    """Mean (accuracy, correct, repeatability) over pairs."""
    rows, known = [], {}
    for first, second, homography in pairs:
        if id(first) not in known:
            known = {id(first): method.detect(first, method.count)}
        sizes = first.shape[::-1], second.shape[::-1]
        rows.append(judge(method, known[id(first)], method.detect(second, method.count), sizes, homography))
    return np.mean(rows, 0)


def light_pairs() -> dict[str, list]:
    """Held-out photos: a clean view and another view under changed light. Homographies are moderate."""
    _, held = photo_split()
    rng, g = np.random.default_rng(123), torch.Generator().manual_seed(124)

    def gamma_of(value):
        return lambda x: 255 * (x / 255) ** value

    changes = {"none": lambda x: x, "gamma 0.4": gamma_of(0.4), "gamma 2.5": gamma_of(2.5),
               "dark": lambda x: augment.noise(augment.darken(x, g), g),
               "spot light": lambda x: augment.noise(augment.spot(x, g), g),
               "spot, dark": lambda x: augment.noise(augment.darken(augment.spot(x, g), g), g)}
    result: dict[str, list] = {name: [] for name in changes}
    for file in held:
        image = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
        size = image.shape[::-1]
        h = random_homography(rng, image.shape, min(image.shape), HomographyRange(0.85, 1.2, 12, 0.1, 0.1))
        h = np.array([[1, 0, (size[0] - min(size)) / 2], [0, 1, (size[1] - min(size)) / 2], [0, 0, 1]]) @ h
        view = torch.from_numpy(warp_image(image, h, size))[None, None].float()
        for name, change in changes.items():
            altered = change(view.clamp(0.5, 255)).round().clamp(0, 255)[0, 0].numpy().astype(np.uint8)
            result[name].append((image, altered, h))
    return result


def table(title: str, columns: list[str], rows: dict[str, list[np.ndarray]], repeat: bool) -> str:
    """Markdown: accuracy / correct matches (/ repeatability) per method and column, and the mean."""
    head = ["method"] + columns + ["mean"]
    lines = [f"## {title}", "", "| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for name, values in rows.items():
        cells = [f"{v[0]:.2f} / {v[1]:.0f}" + (f" / {v[2]:.2f}" if repeat else "")
                 for v in values + [np.mean(values, 0)]]
        lines.append("| " + " | ".join([name] + cells) + " |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", default=["oxford", "light"])
    parser.add_argument("--pack", type=Path, default=PACK)
    parser.add_argument("--out", type=Path, default=RESULTS)
    options = parser.parse_args()
    options.out.mkdir(exist_ok=True)
    compared = methods(options.pack)
    path = options.out / "quality.json"
    quality = json.loads(path.read_text()) if path.exists() else {}
    for part in options.parts:
        if part == "oxford":
            names = sorted(p.name for p in (SHARED / "data/oxford_affine").iterdir() if p.is_dir())
            pairs = {n: list(oxford_pairs(n)) for n in names}
            title = "Oxford affine: mean matching accuracy at 3 px / correct matches"
        else:
            pairs = light_pairs()
            title = "Held-out photos under changed light: accuracy at 3 px / correct matches / repeatability"
        rows = {m.name: [evaluate(m, p) for p in pairs.values()] for m in compared}
        text = table(title, list(pairs), rows, part == "light")
        (options.out / f"{part}.md").write_text(text)
        print(text)
        quality[part] = {m: {n: [round(float(x), 3) for x in v[:2]] for n, v in zip(pairs, values)}
                         for m, values in rows.items() if m.startswith("ours")}
    for m in compared:
        if hasattr(m.match, "used"):
            quality["matcher_mean_stages"] = round(float(np.mean(m.match.used)), 3)
    path.write_text(json.dumps(quality, indent=1) + "\n")


if __name__ == "__main__":
    main()
