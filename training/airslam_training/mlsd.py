# SPDX-License-Identifier: BSD-3-Clause
"""The M-LSD teacher's raw answers to warped views of each training image: `python -m airslam_training.mlsd`.

It supervises and is compared with; it is never shipped. The network of `mlsd_512_large_fp16.tflite` runs in OpenVINO.
A file `raw/NAME.npz` in the cache's `lines` folder holds, for each view k, `segments{k}` (n x 5: x1, y1, x2, y2 in
pixels of the image, score) and `view_from_image{k}` (3 x 3). View 0 is the image itself, view 1 its mirror image, the
others are random homographies. Views are added in passes, so that an interrupted run leaves labels of every image.
"""
from __future__ import annotations

import argparse
import zlib

import cv2
import numpy as np
import openvino as ov

from .cache import CACHE, photo_split
from .geometry import HomographyRange, random_homography, warp_image, warp_points
from .teacher import TEACHERS

FOLDER = CACHE / "lines"
INPUT = 512
# Views zoom in by up to 1.7 and hardly out: M-LSD was trained on pictures that show more than our small photos.
VIEWS = HomographyRange(scale_min=0.95, scale_max=1.7, rotation_deg=14.0, perspective=0.25, shift=0.1)


class Mlsd:
    """Grey image of any size -> segments n x 5 (x1, y1, x2, y2 in its pixels, score), best first."""

    def __init__(self, precision: str = "f32", threads: int = 1):
        hint = {"INFERENCE_PRECISION_HINT": precision, "INFERENCE_NUM_THREADS": threads, "NUM_STREAMS": 1}
        self.model = ov.Core().compile_model(str(TEACHERS / "mlsd_512_large_fp16.tflite"), "CPU", hint)

    def __call__(self, image: np.ndarray, threshold: float = 0.02, shortest: float = 5.0) -> np.ndarray:
        """`shortest` is a length in pixels of the 512 x 512 input."""
        h, w = image.shape[:2]
        colour = cv2.cvtColor(image, cv2.COLOR_GRAY2RGB) if image.ndim == 2 else image[..., ::-1]
        x = np.ones((1, INPUT, INPUT, 4), np.float32)
        x[0, ..., :3] = cv2.resize(colour, (INPUT, INPUT), interpolation=cv2.INTER_AREA if min(h, w) > INPUT else
                                   cv2.INTER_LINEAR)
        answer = {tuple(v.shape[1:]): v[0] for v in self.model([x]).values()}
        centre, score, shift = answer[(200, 2)], answer[(200,)], answer[(INPUT // 2, INPUT // 2, 4)]
        d = shift[centre[:, 0], centre[:, 1]]
        ends = (centre[:, [1, 0, 1, 0]] + d + 0.5) * 2 - 0.5  # of the half-size map -> of the input
        keep = (score > threshold) & (np.hypot(*(ends[:, :2] - ends[:, 2:]).T) >= shortest)
        ends = (ends + 0.5) * (np.array([w, h, w, h]) / INPUT) - 0.5
        found = np.concatenate([ends, score[:, None]], 1)[keep].astype(np.float32)
        return found[np.argsort(-found[:, 4], kind="stable")]


def view_homography(k: int, name: str, shape: tuple[int, int]) -> np.ndarray:
    """`view_from_image` of view k: the same whenever it is asked for."""
    if k == 0:
        return np.diag([INPUT / shape[1], INPUT / shape[0], 1.0])
    mirror = np.array([[-1.0, 0, INPUT - 1], [0, 1, 0], [0, 0, 1]])
    if k == 1:
        return mirror @ view_homography(0, name, shape)
    rng = np.random.default_rng([zlib.crc32(name.encode()), k])
    h = random_homography(rng, shape, INPUT, VIEWS)
    return mirror @ h if rng.random() < 0.5 else h


def look(teacher: Mlsd, image: np.ndarray, view_from_image: np.ndarray) -> np.ndarray:
    """The teacher's segments in one view, in pixels of the image, n x 5."""
    found = teacher(warp_image(image, view_from_image, (INPUT, INPUT)))
    ends = warp_points(np.linalg.inv(view_from_image), found[:, :4].reshape(-1, 2).astype(np.float64))
    return np.concatenate([ends.reshape(-1, 4), found[:, 4:]], 1).astype(np.float32)


def annotate(teacher: Mlsd, name: str, image: np.ndarray, views: int) -> None:
    """Bring `raw/name.npz` to `views` views."""
    path = FOLDER / "raw" / f"{name}.npz"
    known = dict(np.load(path)) if path.exists() else {}
    if f"segments{views - 1}" in known:
        return
    for k in range(views):
        if f"segments{k}" not in known:
            h = view_homography(k, name, image.shape)
            known |= {f"view_from_image{k}": h, f"segments{k}": look(teacher, image, h)}
    np.savez(path.with_suffix(".tmp.npz"), **known)
    path.with_suffix(".tmp.npz").rename(path)


def images(seed: int = 3):
    """(name, image, views wanted) of all photos (held-out first) and one view of each procedural scene pose."""
    train, held = photo_split()
    order = np.random.default_rng(seed).permutation(len(train))
    for file in [*held, *[train[i] for i in order]]:
        yield file.stem, cv2.imread(str(file), cv2.IMREAD_GRAYSCALE), None
    for file in sorted((CACHE / "scenes").glob("*.npz")):
        for i, lit in enumerate(np.load(file)["images"]):
            yield f"{file.stem}_{i}", lit[0], 1


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--passes", type=int, nargs="+", default=[1, 2, 4, 6], help="views after each pass")
    parser.add_argument("--precision", default="bf16")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    (FOLDER / "raw").mkdir(parents=True, exist_ok=True)
    teacher = Mlsd(options.precision)
    for views in options.passes:
        for i, (name, image, most) in enumerate(images()):
            annotate(teacher, name, image, min(views, most or views))
            if i % 100 == 0:
                print(f"{views} views: {i}", flush=True)


if __name__ == "__main__":
    main()
