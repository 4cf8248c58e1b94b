# SPDX-License-Identifier: BSD-3-Clause
"""Detectors and matchers to compare, all behind `detect(image) -> (points N x 2, descriptors)` and `match(a, b)`."""
from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Callable

import cv2
import numpy as np
import openvino as ov

from .export import MATCHER_POINTS, PACK
from .geometry import mutual_nearest, refine_keypoints, sample_descriptors, select_keypoints
from .pack import PackNetworks
from .pairs import normalize_points
from .teacher import Teacher, teacher

Detected = tuple[np.ndarray, np.ndarray]


@dataclass
class Method:
    """Name, detector (grey image, count -> points and descriptors) and matcher (two detections, sizes -> pairs)."""

    name: str
    detect: Callable[[np.ndarray, int], Detected]
    match: Callable[[Detected, Detected, tuple, tuple], np.ndarray]
    count: int = 1024


def _teacher_detector(network: Teacher) -> Callable:
    def detect(image: np.ndarray, count: int) -> Detected:
        maps, scores = network(image)
        points = refine_keypoints(scores, select_keypoints(scores, count))
        return points, sample_descriptors(maps, points)

    return detect


def _opencv_detector(make: Callable) -> Callable:
    def detect(image: np.ndarray, count: int) -> Detected:
        keypoints, descriptors = make(count).detectAndCompute(image, None)
        if descriptors is None:
            return np.zeros((0, 2)), np.zeros((0, 1))
        order = np.argsort([-k.response for k in keypoints], kind="stable")[:count]
        return np.array([keypoints[i].pt for i in order]), descriptors[order]

    return detect


def _nearest(a: Detected, b: Detected, *_) -> np.ndarray:
    return mutual_nearest(a[1], b[1])


def _cross_check(norm: int) -> Callable:
    def match(a: Detected, b: Detected, *_) -> np.ndarray:
        if min(len(a[0]), len(b[0])) == 0:
            return np.zeros((0, 2), int)
        found = cv2.BFMatcher(norm, crossCheck=True).match(a[1], b[1])
        return np.array([(m.queryIdx, m.trainIdx) for m in found]).reshape(-1, 2)

    return match


class StagedMatcher:
    """Our matcher's ONNX stages with early exit, as the C++ side runs them."""

    def __init__(self, pack: Path = PACK, threshold: float = 0.1, exit_confidence: float = 0.95,
                 precision: str = "f32", stages: int | None = None):
        hint = {"INFERENCE_PRECISION_HINT": precision, "INFERENCE_NUM_THREADS": 1}
        files = sorted(pack.glob("matcher_stage*.onnx"))[:stages]
        self.stages = [ov.Core().compile_model(str(f), "CPU", hint) for f in files]
        self.threshold, self.exit_confidence = threshold, exit_confidence
        self.used: list[int] = []

    def __call__(self, a: Detected, b: Detected, size_a: tuple, size_b: tuple) -> np.ndarray:
        n = MATCHER_POINTS
        inputs, state = {}, {}
        for side, ((points, descriptors), size) in enumerate(((a, size_a), (b, size_b))):
            count = min(len(points), n)
            p, d, m = np.zeros((1, n, 2), np.float32), np.zeros((1, n, 64), np.float32), np.zeros((1, n), np.float32)
            p[0, :count], d[0, :count], m[0, :count] = normalize_points(points[:count], np.array(size)), descriptors[:count], 1
            inputs |= {f"keypoints{side}": p, f"mask{side}": m}
            state[f"descriptors{side}"] = d
        for k, stage in enumerate(self.stages):
            result = stage({**inputs, **state})
            state = {f"state{s}": result[f"next_state{s}"] for s in (0, 1)}
            sure = np.concatenate([result[f"confidence{s}"][inputs[f"mask{s}"] > 0] for s in (0, 1)])
            if (sure > self.exit_confidence).mean() >= 0.95:
                break
        self.used.append(k + 1)
        scores = result["scores"][0]
        best0, best1 = scores.argmax(1), scores.argmax(0)
        i = np.flatnonzero((best1[best0] == np.arange(n)) & (scores.max(1) > self.threshold))
        return np.stack([i, best0[i]], 1)


def methods(pack: Path = PACK) -> list[Method]:
    """Ours (with and without matcher), the teachers, ORB and SIFT."""
    ours = PackNetworks(pack).keypoints
    result = [Method("ours", ours, _nearest), Method("ours, 400 points", ours, _nearest, MATCHER_POINTS)]
    if list(pack.glob("matcher_stage*.onnx")):
        result.append(Method("ours, 400 points + matcher", ours, StagedMatcher(pack), MATCHER_POINTS))
    result += [Method(f"teacher EdgePoint2-{n}", _teacher_detector(teacher(n)), _nearest) for n in ("E64", "S64")]
    result.append(Method("ORB", _opencv_detector(lambda n: cv2.ORB_create(n, fastThreshold=5)),
                         _cross_check(cv2.NORM_HAMMING)))
    result.append(Method("SIFT", _opencv_detector(lambda n: cv2.SIFT_create(n, contrastThreshold=0.01)),
                         _cross_check(cv2.NORM_L2)))
    return result
