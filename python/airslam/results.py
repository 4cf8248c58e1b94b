# SPDX-License-Identifier: BSD-3-Clause
"""A result folder of `airslam map` and the data set it came from, for reports and viewers."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from . import Error, Map, Trajectory

TRUTH_FILES = ("mav0/state_groundtruth_estimate0/data.csv", "mav0/mocap0/data.csv",
               "state_groundtruth_estimate0/data.csv", "poses.txt", "groundtruth.tum", "groundtruth.txt")
MAX_TIME_DIFFERENCE_NS = 10_000_000  # of poses that are compared, as `airslam eval` does


@dataclass
class Results:
    """What a run has written."""

    folder: Path
    report: dict
    trajectory: Trajectory
    map: Map

    @property
    def dataset(self) -> Path | None:
        """The data set that the run read, if it still lies there."""
        path = Path(self.report.get("dataset", ""))
        return path if self.report.get("dataset") and path.is_dir() else None


def load_results(folder: Path) -> Results:
    """Reads a result folder; an Error names what is missing or damaged."""
    for name in ("report.json", "trajectory.tum", "map.db"):
        if not (folder / name).exists():
            raise Error(f"{folder} is no result of airslam map: {folder / name} is missing")
    try:
        report = json.loads((folder / "report.json").read_text())
        return Results(folder, report, Trajectory.load(folder / "trajectory.tum"),
                       Map.load(folder / "map.db"))
    except json.JSONDecodeError as error:
        raise Error(f"{folder / 'report.json'} is no JSON: {error}") from None


def find_truth(dataset: Path | None) -> Path | None:
    """The ground truth that lies in a data set, if any."""
    if dataset is None:
        return None
    return next((dataset / name for name in TRUTH_FILES if (dataset / name).exists()), None)


def align(source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """The 4 x 4 rigid transform that minimises |T source − target|² over points (n x 3)."""
    mean_source, mean_target = source.mean(axis=0), target.mean(axis=0)
    u, _, vt = np.linalg.svd((target - mean_target).T @ (source - mean_source))
    result = np.eye(4)
    result[:3, :3] = u @ np.diag([1, 1, np.sign(np.linalg.det(u @ vt))]) @ vt
    result[:3, 3] = mean_target - result[:3, :3] @ mean_source
    return result


def _pairs(truth_ns: np.ndarray, estimate_ns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows of poses of the same time: each of the shorter with the nearest of the longer trajectory."""
    if len(truth_ns) < len(estimate_ns):
        estimate_rows, truth_rows = _pairs(estimate_ns, truth_ns)
        return truth_rows, estimate_rows
    after = np.clip(np.searchsorted(truth_ns, estimate_ns), 1, len(truth_ns) - 1)
    earlier = estimate_ns - truth_ns[after - 1] <= truth_ns[after] - estimate_ns
    nearest = after - earlier
    near = abs(truth_ns[nearest] - estimate_ns) <= MAX_TIME_DIFFERENCE_NS
    return nearest[near], np.flatnonzero(near)


@dataclass
class Comparison:
    """An estimate laid over its ground truth (SE(3)), in the world of the ground truth."""

    times_ns: np.ndarray        # (n,) of the compared poses
    truth: np.ndarray           # (n, 3) metres
    estimate: np.ndarray        # (n, 3), aligned
    position_errors: np.ndarray   # (n,) metres
    rotation_errors: np.ndarray   # (n,) degrees
    truth_from_estimate: np.ndarray  # 4 x 4

    @property
    def rmse(self) -> float:
        """Metres, as `airslam eval` computes it."""
        return float(np.sqrt(np.mean(self.position_errors**2)))


def compare(truth: Trajectory, estimate: Trajectory) -> Comparison | None:
    """Aligns by positions; None when fewer than three poses have ground truth."""
    times = estimate.timestamps_ns
    if len(truth.timestamps_ns) < 3 or len(times) < 3:
        return None
    truth_rows, rows = _pairs(truth.timestamps_ns, times)
    if len(rows) < 3:
        return None
    expected, found = truth.world_from_body[truth_rows], estimate.world_from_body[rows]
    moved = align(found[:, :3, 3], expected[:, :3, 3])
    aligned = moved @ found
    # |A − B|_F = sqrt(8) sin(angle / 2) of two rotations.
    distance = np.linalg.norm(aligned[:, :3, :3] - expected[:, :3, :3], axis=(1, 2))
    angles = 2 * np.degrees(np.arcsin(np.clip(distance / np.sqrt(8), 0, 1)))
    errors = np.linalg.norm(aligned[:, :3, 3] - expected[:, :3, 3], axis=1)
    return Comparison(times[rows], expected[:, :3, 3], aligned[:, :3, 3], errors, angles, moved)


def largest_component(map_: Map) -> int:
    """The component with most keyframes, as trajectory.tum holds it; −1 of an empty map."""
    numbers, counts = np.unique(map_.components, return_counts=True)
    return int(numbers[counts.argmax()]) if len(numbers) else -1
