# SPDX-License-Identifier: BSD-3-Clause
"""Structural average precision on YorkUrban (evaluation only), held-out photos and procedural views; results/lines.md.

    python -m airslam_training.evaluate_lines [--checkpoint c.pt] [--program build/bin/airslam]

sAP as in wireframe parsing: ends scaled to 128 x 128, a hit when the summed squared end distance to the nearest true
segment, not hit before by a surer one, is below 5, 10 or 15. Ours is what `airslam detect` writes, in the precision of
this CPU, with its default and with `--line-scale 1`, which is what mapping sees, and the same network in PyTorch (f32).
Every method enlarges or shrinks an image as it likes (M-LSD to 512 x 512). On held-out images (288 rows), truth is what the
labels are surest of (over 0.25): these numbers compare versions of ours; M-LSD made the labels of the photos, so its own
number there says little.
"""
from __future__ import annotations

import argparse
import subprocess
import tempfile
from pathlib import Path
from typing import Callable

import cv2
import numpy as np

from .cache import CACHE
from .evaluate import RESULTS
from .export import load_lines, load_plnet
from .line_data import sources
from .lines import DecoderOptions
from .loop import ROOT
from .mlsd import Mlsd
from .teacher import SHARED
from .validate_lines import average_precision, detect, hits, squared_distances, to_grid

Detector = Callable[[np.ndarray], np.ndarray]  # image (grey, or BGR for M-LSD) -> segments n x 5


def yorkurban() -> list[tuple[np.ndarray, np.ndarray]]:
    """(BGR image, true segments m x 4) of all images."""
    files = sorted((SHARED / "data/yorkurban").glob("*.jpg"))
    return [(cv2.imread(str(f)), np.loadtxt(f.with_suffix(".csv"), delimiter=",", ndmin=2)) for f in files]


def enlargement(image: np.ndarray, most: float = 2.0, side: int = 720) -> float:
    """How much `airslam detect` enlarges an image for its lines (neural/detect_image.h)."""
    return float(np.clip(side / min(image.shape[:2]), 1.0, most))


def ours(path: Path, options: DecoderOptions = DecoderOptions()) -> Detector:
    """The network of a training checkpoint, in PyTorch."""
    net = load_plnet(CACHE / "runs/plnet/checkpoint.pt")
    module = load_lines(path, net)
    return lambda image: detect(net.backbone, module, grey(image), enlargement(image), options)[0]


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


def proposal_recall(pairs) -> float:
    """Share of the true segments that are among the proposals, whatever their score."""
    found = sum(int((squared_distances(f, t).min(0, initial=np.inf) < 10).sum()) for f, t in pairs)
    return found / sum(len(t) for _, t in pairs)


def precision_table(pairs) -> list[tuple[float, float, float, float]]:
    """(score threshold, precision, recall, lines an image) at 10 squared grid pixels."""
    rows = []
    for threshold in (0.1, 0.2, 0.3, 0.4, 0.5, 0.6):
        kept = [(f[f[:, 4] >= threshold], t) for f, t in pairs]
        hit, count = sum(hits(f, t, 10).sum() for f, t in kept), sum(len(f) for f, _ in kept)
        rows.append((threshold, hit / max(count, 1), hit / sum(len(t) for _, t in kept), count / len(kept)))
    return rows


def held_images(most: int = 80) -> dict[str, list]:
    """Held-out photos and procedural views with their sure labels (score over 0.25)."""
    result = {}
    for name, source in sources(held=True).items():
        rows = []
        for i in np.linspace(0, len(source.names) - 1, min(most, len(source.names))).astype(int):
            truth = source.segments[i]
            truth = truth[truth[:, 4] > 0.25, :4]
            if len(truth):
                rows.append((source.image(i), truth))
        result[name] = rows
    return result


def program(binary: Path, images: list[np.ndarray], *options: str) -> Detector:
    """What `airslam detect` with these options writes for these images; the detector takes them in the same order."""
    with tempfile.TemporaryDirectory() as folder:
        source, out = Path(folder) / "in", Path(folder) / "out"
        source.mkdir()
        for i, image in enumerate(images):
            cv2.imwrite(str(source / f"{i:05d}.png"), grey(image))
        subprocess.run([binary, "detect", source, "--out", out, *options], check=True, capture_output=True)
        tables = []
        for file in sorted(out.glob("*.lines.csv")):
            tables.append(np.loadtxt(file, delimiter=",", ndmin=2) if file.stat().st_size else np.zeros((0, 5)))
    answers = iter(tables)
    return lambda image: next(answers)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--checkpoint", type=Path, default=CACHE / "runs/lines_long/checkpoint.pt")
    parser.add_argument("--program", type=Path, default=ROOT.parent / "build/bin/airslam")
    options = parser.parse_args()
    names = {"yorkurban": "YorkUrban (51 images)", "photos": "held-out photos", "scenes": "held-out procedural views"}
    text = ["# Lines", "", "`python -m airslam_training.evaluate_lines`; what the numbers mean stands in that file.", "",
            "| images | method | sAP5 | sAP10 | sAP15 | true segments among all proposals |", "|---|---|---|---|---|---|"]
    precision = ["", "Precision and recall at 10 of `airslam detect`, by score; lines an image:", "",
                 "| images | score over | precision | recall | lines |", "|---|---|---|---|---|"]
    for name, images in ({"yorkurban": yorkurban()} | held_images()).items():
        pictures = [i for i, _ in images]
        detectors = {"ours (`airslam detect`)": program(options.program, pictures),
                     "ours as mapping sees them (`--line-scale 1`)": program(options.program, pictures, "--line-scale", "1"),
                     "ours (PyTorch, f32)": ours(options.checkpoint), "M-LSD large": Mlsd(), "OpenCV LSD": lsd}
        for method, detector in detectors.items():
            pairs = on_grid(detector, images)
            sap = [f"{average_precision(pairs, t):.1f}" for t in (5, 10, 15)]
            text.append(f"| {names[name]} | {method} | {' | '.join(sap)} | {proposal_recall(pairs):.2f} |")
            print(text[-1], flush=True)
            if method == "ours (`airslam detect`)":
                precision += [f"| {names[name]} | {t} | {p:.2f} | {r:.2f} | {n:.0f} |"
                              for t, p, r, n in precision_table(pairs)]
    (RESULTS / "lines.md").write_text("\n".join(text + precision) + "\n")


if __name__ == "__main__":
    main()
