# SPDX-License-Identifier: BSD-3-Clause
"""Structural average precision on YorkUrban (evaluation only) and on held-out photos and procedural views.

    python -m airslam_training.evaluate_lines [yorkurban] [held] [--checkpoint c.pt]      writes training/results/lines.md

Ours comes from the shipped ONNX files in f32, decoded in Python as the C++ side does, or from a checkpoint.
"""
from __future__ import annotations

import argparse
from pathlib import Path
from typing import Callable

import cv2
import numpy as np

from .cache import CACHE
from .export import load_lines, load_plnet
from .line_data import sources
from .lines import DecoderOptions
from .mlsd import Mlsd
from .teacher import SHARED
from .validate_lines import average_precision, detect, hits, squared_distances, to_grid

Detector = Callable[[np.ndarray], np.ndarray]  # image (grey, or BGR for M-LSD) -> segments n x 5


def yorkurban() -> list[tuple[np.ndarray, np.ndarray]]:
    """(BGR image, true segments m x 4) of all images."""
    files = sorted((SHARED / "data/yorkurban").glob("*.jpg"))
    return [(cv2.imread(str(f)), np.loadtxt(f.with_suffix(".csv"), delimiter=",", ndmin=2)) for f in files]


def ours(path: Path, scale: float = 1.0, options: DecoderOptions = DecoderOptions()) -> Detector:
    """The network of a training checkpoint, in PyTorch."""
    net = load_plnet(CACHE / "runs/plnet/checkpoint.pt")
    module = load_lines(path, net)
    return lambda image: detect(net.backbone, module, grey(image), scale, options)[0]


def grey(image: np.ndarray) -> np.ndarray:
    return cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if image.ndim == 3 else image


def lsd(image: np.ndarray) -> np.ndarray:
    """OpenCV's LSD, scored by length."""
    found = cv2.createLineSegmentDetector(cv2.LSD_REFINE_ADV).detect(grey(image))[0]
    found = np.zeros((0, 4)) if found is None else found.reshape(-1, 4).astype(np.float64)
    length = np.hypot(found[:, 2] - found[:, 0], found[:, 3] - found[:, 1])
    order = np.argsort(-length, kind="stable")
    return np.concatenate([found, length[:, None] / max(image.shape)], 1)[order]


def on_grid(detector: Detector, images) -> list[tuple[np.ndarray, np.ndarray]]:
    result = []
    for image, truth in images:
        found = detector(image)
        result.append((np.concatenate([to_grid(found, image.shape), found[:, 4:]], 1), to_grid(truth, image.shape)))
    return result


def stages(pairs) -> str:
    """Share of true segments among all proposals, and the sAP10 that an oracle's scores would give."""
    found = sum(int((squared_distances(f, t).min(0, initial=np.inf) < 10).sum()) for f, t in pairs)
    return f"{found / sum(len(t) for _, t in pairs):.3f}"


def precision_table(pairs) -> list[tuple[float, float, float, float]]:
    """(score threshold, precision, recall, lines an image) at 10 squared grid pixels."""
    rows = []
    for threshold in (0.1, 0.2, 0.3, 0.4, 0.5, 0.6):
        kept = [(f[f[:, 4] >= threshold], t) for f, t in pairs]
        hit, count = sum(hits(f, t, 10).sum() for f, t in kept), sum(len(f) for f, _ in kept)
        rows.append((threshold, hit / max(count, 1), hit / sum(len(t) for _, t in kept), count / len(kept)))
    return rows


def held_images(most: int = 80) -> dict[str, list]:
    """Held-out photos and procedural views with their sure labels (score over 0.25), short side enlarged to 480."""
    result = {}
    for name, source in sources(held=True).items():
        rows = []
        for i in np.linspace(0, len(source.names) - 1, min(most, len(source.names))).astype(int):
            image, truth = source.image(i), source.segments[i]
            truth = truth[truth[:, 4] > 0.25, :4]
            if len(truth):
                s = 480 / min(image.shape)
                rows.append((cv2.resize(image, None, fx=s, fy=s, interpolation=cv2.INTER_LINEAR), (truth + 0.5) * s - 0.5))
        result[name] = rows
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", default=["yorkurban", "held"])
    parser.add_argument("--checkpoint", type=Path, default=CACHE / "runs/lines/checkpoint.pt")
    parser.add_argument("--scale", type=float, default=1.0)
    parser.add_argument("--others", action="store_true")
    options = parser.parse_args()
    sets = ({"yorkurban": yorkurban()} if "yorkurban" in options.parts else {}) | (held_images() if "held" in options.parts else {})
    detectors = {"ours": ours(options.checkpoint, options.scale)}
    if options.others:
        detectors |= {"M-LSD large": Mlsd(), "LSD": lsd}
    for name, images in sets.items():
        for method, detector in detectors.items():
            pairs = on_grid(detector, images)
            print(name, method, *[f"{average_precision(pairs, t):.1f}" for t in (5, 10, 15)], "proposals", stages(pairs), flush=True)
            if method == "ours":
                for row in precision_table(pairs):
                    print("   threshold %.1f precision %.2f recall %.2f lines %.0f" % row)


if __name__ == "__main__":
    main()
