# SPDX-License-Identifier: BSD-3-Clause
"""Homographies, warps, keypoint selection and matching: the geometry that training and evaluation share.

Pixels have integer coordinates at their centres. A homography `b_from_a` (3 x 3) maps pixels of image a to image b.
"""
from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np


@dataclass(frozen=True)
class HomographyRange:
    """How far a random view may turn. Scale is output pixels per source pixel."""

    scale_min: float = 0.6
    scale_max: float = 1.6
    rotation_deg: float = 25.0
    perspective: float = 0.18
    shift: float = 0.15


def random_homography(rng: np.random.Generator, source: tuple[int, int], size: int, r: HomographyRange) -> np.ndarray:
    """Homography `crop_from_source` (3 x 3): a size x size view of a source image of (height, width).

    Scale is relative to the view that just covers the shorter side. Most rotations are small: robots drive upright.
    """
    h, w = source
    unit = size / min(h, w)
    scale = unit * np.exp(rng.uniform(np.log(r.scale_min), np.log(r.scale_max)))
    angle = np.deg2rad(np.clip(rng.normal(0, r.rotation_deg / 2), -2 * r.rotation_deg, 2 * r.rotation_deg))
    # Centre of view: free where the source is larger than the view, near the centre otherwise.
    slack = np.maximum(np.array([w, h]) * scale - size, 0) / (2 * scale)
    centre = np.array([w - 1, h - 1]) / 2 + rng.uniform(-1, 1, 2) * (slack + r.shift * size / scale / 2)
    c, s = np.cos(angle), np.sin(angle)
    stretch = np.exp(rng.normal(0, 0.08))
    linear = np.array([[c, -s], [s, c]]) @ np.diag([scale * stretch, scale / stretch])
    similarity = np.eye(3)
    similarity[:2, :2] = linear
    similarity[:2, 2] = -linear @ centre
    # Perspective about the view's centre, so that it foreshortens without moving the content away.
    tilt = np.eye(3)
    tilt[2, :2] = np.clip(rng.normal(0, r.perspective / 2, 2), -r.perspective, r.perspective) * 2 / size
    to_corner = np.eye(3)
    to_corner[:2, 2] = (size - 1) / 2
    homography = to_corner @ tilt @ similarity
    return homography / homography[2, 2]


def local_scale(homography: np.ndarray, source: tuple[int, int]) -> float:
    """Square root of the area change at the source's centre: below 1 the view shrinks the image."""
    p = np.array([source[1] / 2, source[0] / 2])
    q = warp_points(homography, np.stack([p, p + [1, 0], p + [0, 1]]))
    return float(np.sqrt(abs(np.linalg.det(np.stack([q[1] - q[0], q[2] - q[0]])))))


def warp_image(image: np.ndarray, homography: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Warp a grey image to (width, height), blurring first when the view shrinks it; the border mirrors."""
    scale = local_scale(homography, image.shape[:2])
    if scale < 0.9:
        image = cv2.GaussianBlur(image, (0, 0), 0.45 / scale)
    return cv2.warpPerspective(image, homography, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101)


def warp_points(homography: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points N x 2 of image a -> N x 2 of image b."""
    p = points @ homography[:, :2].T + homography[:, 2]
    return p[:, :2] / p[:, 2:]


def inside(points: np.ndarray, size: tuple[int, int], border: float = 0.0) -> np.ndarray:
    """N bools: within an image of (width, height), `border` pixels from its edge."""
    w, h = size
    return ((points >= border) & (points <= np.array([w - 1, h - 1]) - border)).all(-1)


def select_keypoints(scores: np.ndarray, count: int, radius: int = 2, threshold: float = -5.0,
                     border: int = 4) -> np.ndarray:
    """Best local maxima of a score map H x W -> N x 2 float (x, y), strongest first, N <= count."""
    peak = cv2.dilate(scores, np.ones((2 * radius + 1, 2 * radius + 1), np.uint8))
    mask = (scores == peak) & (scores > threshold)
    mask[:border], mask[-border:], mask[:, :border], mask[:, -border:] = False, False, False, False
    y, x = np.nonzero(mask)
    order = np.argsort(-scores[y, x], kind="stable")[:count]
    return np.stack([x[order], y[order]], -1).astype(np.float64)


def sample_map(maps: np.ndarray, points: np.ndarray, stride: int = 4) -> np.ndarray:
    """Bilinear samples: maps D x h x w, points N x 2 in pixels -> N x D ("half pixel" cells)."""
    h, w = maps.shape[1:]
    cell = (points + 0.5) / stride - 0.5
    x, y = np.clip(cell[:, 0], 0, w - 1), np.clip(cell[:, 1], 0, h - 1)
    x0, y0 = np.minimum(x.astype(int), w - 2), np.minimum(y.astype(int), h - 2)
    ax, ay = x - x0, y - y0
    return (maps[:, y0, x0] * (1 - ax) * (1 - ay) + maps[:, y0, x0 + 1] * ax * (1 - ay)
            + maps[:, y0 + 1, x0] * (1 - ax) * ay + maps[:, y0 + 1, x0 + 1] * ax * ay).T


def sample_descriptors(maps: np.ndarray, points: np.ndarray, stride: int = 4) -> np.ndarray:
    """The same, of unit length."""
    d = sample_map(maps, points, stride)
    return d / np.maximum(np.linalg.norm(d, axis=1, keepdims=True), 1e-9)


def mutual_nearest(d0: np.ndarray, d1: np.ndarray) -> np.ndarray:
    """Mutual nearest neighbours of unit descriptors N x D, M x D -> K x 2 index pairs."""
    if len(d0) == 0 or len(d1) == 0:
        return np.zeros((0, 2), int)
    similarity = d0 @ d1.T
    forward, backward = similarity.argmax(1), similarity.argmax(0)
    i = np.nonzero(backward[forward] == np.arange(len(d0)))[0]
    return np.stack([i, forward[i]], -1)


def refine_keypoints(scores: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Sub-pixel peaks: a parabola along each axis, at most half a pixel; points N x 2, none on the border."""
    x, y = points[:, 0].astype(int), points[:, 1].astype(int)

    def vertex(low: np.ndarray, centre: np.ndarray, high: np.ndarray) -> np.ndarray:
        curvature = low + high - 2 * centre
        return np.clip(0.5 * (low - high) / np.where(curvature < -1e-6, curvature, np.inf), -0.5, 0.5)

    centre = scores[y, x]
    return points + np.stack([vertex(scores[y, x - 1], centre, scores[y, x + 1]),
                              vertex(scores[y - 1, x], centre, scores[y + 1, x])], 1)
