# SPDX-License-Identifier: BSD-3-Clause
"""A result folder of `airslam map` and the data set it came from, for reports and viewers."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from . import Error, Map, Trajectory, align, associate

TRUTH_FILES = ("mav0/state_groundtruth_estimate0/data.csv", "mav0/mocap0/data.csv",
               "state_groundtruth_estimate0/data.csv", "poses.txt", "groundtruth.tum", "groundtruth.txt")


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
        return dataset_of(self.report)


def dataset_of(report: dict) -> Path | None:
    """The data set that the run of a report read, if it still lies there."""
    path = Path(report.get("dataset", ""))
    return path if report.get("dataset") and path.is_dir() else None


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


def knows_gravity(map_: Map, rows: np.ndarray | slice = slice(None)) -> bool:
    """Whether z points up in the map: the IMU's biases, and with them gravity, became known at keyframes of `rows`."""
    return bool(np.isfinite(map_.gyroscope_biases[rows]).all(axis=1).any())


def find_truth(dataset: Path | None) -> Path | None:
    """The ground truth that lies in a data set, if any."""
    if dataset is None:
        return None
    return next((dataset / name for name in TRUTH_FILES if (dataset / name).exists()), None)


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
    """Aligns by positions; None when fewer than three poses have ground truth. Raises Error when they lie on a line."""
    truth_rows, rows = associate(truth, estimate)
    if len(rows) < 3:
        return None
    expected, found = truth.world_from_body[truth_rows], estimate.world_from_body[rows]
    moved = align(found[:, :3, 3], expected[:, :3, 3])
    if moved is None:
        raise Error("the alignment is not determined: the poses with ground truth lie on one line")
    aligned = moved @ found
    # |A − B|_F = sqrt(8) sin(angle / 2) of two rotations.
    distance = np.linalg.norm(aligned[:, :3, :3] - expected[:, :3, :3], axis=(1, 2))
    angles = 2 * np.degrees(np.arcsin(np.clip(distance / np.sqrt(8), 0, 1)))
    errors = np.linalg.norm(aligned[:, :3, 3] - expected[:, :3, 3], axis=1)
    return Comparison(estimate.timestamps_ns[rows], expected[:, :3, 3], aligned[:, :3, 3], errors, angles, moved)
