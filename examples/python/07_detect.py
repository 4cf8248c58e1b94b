# SPDX-License-Identifier: BSD-3-Clause
"""Keypoints and lines of two images, matched by their descriptors: python 07_detect.py [<image> <image> [<picture>]]

Needs pillow to read the images and to draw.
"""

import sys
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

import airslam

images = sorted((Path(__file__).resolve().parents[1] / "warehouse_day" / "mav0" / "cam0" / "data").iterdir())
given = sys.argv[1:] or [images[0], images[3]]
picture = Path(given[2] if len(given) > 2 else "out/example_07.png")

detector = airslam.Detector()  # or the folder of a model pack of your own
pixels = [np.array(Image.open(file).convert("L")) for file in given[:2]]
first, second = (detector.detect(p, max_keypoints=300, min_line_score=0.4) for p in pixels)
print(first, second)

# Descriptors have unit length: their products are cosines. A match is the nearest one in both directions.
cosine = first.descriptors @ second.descriptors.T
forth, back = cosine.argmax(axis=1), cosine.argmax(axis=0)
mutual = np.flatnonzero(back[forth] == np.arange(len(forth)))
moved = second.keypoints[forth[mutual], :2] - first.keypoints[mutual, :2]
print(f"{len(mutual)} matches, which moved by {np.median(np.linalg.norm(moved, axis=1)):.1f} pixels (median)")

canvas = Image.fromarray(pixels[0]).convert("RGB")
draw = ImageDraw.Draw(canvas)
for x1, y1, x2, y2, score in first.lines:
    draw.line([x1, y1, x2, y2], fill=(255, 160, 40), width=1)
for (x, y), (dx, dy) in zip(first.keypoints[mutual, :2], moved):
    draw.line([x, y, x + dx, y + dy], fill=(60, 230, 120), width=1)
    draw.ellipse([x - 2, y - 2, x + 2, y + 2], outline=(255, 255, 255))
picture.parent.mkdir(parents=True, exist_ok=True)
canvas.save(picture)
print(f"{len(first.lines)} lines and the matches' motion are drawn in {picture}")
