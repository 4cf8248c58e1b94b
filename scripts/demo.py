#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Draws and sums up a result folder of `airslam map`: trajectory.png and map.png beside its files.

    python scripts/demo.py out/demo [ground truth of EuRoC, TUM or KITTI form]

Also a module: benchmarks/accuracy.py draws with the functions below.
"""

from __future__ import annotations

import argparse
import json
import sqlite3
import sys
from dataclasses import dataclass
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402
from matplotlib.collections import LineCollection  # noqa: E402

ESTIMATE, TRUTH, ACCENT, FAINT = "#d95f02", "#404040", "#1b6ca8", "#9aa5b1"


@dataclass
class Path3:
    """Positions of the body over time: seconds (n,) from an arbitrary zero, metres (n, 3)."""

    seconds: np.ndarray
    positions: np.ndarray


def _nanoseconds(text: str) -> int:
    """Exact nanoseconds of a decimal number of seconds."""
    whole, _, fraction = text.partition(".")
    return int(whole) * 10**9 + int((fraction + "0" * 9)[:9])


def _read_rows(file: Path) -> list[list[str]]:
    lines = (line.strip() for line in file.read_text().splitlines())
    return [line.replace(",", " ").split() for line in lines if line and line[0] != "#"]


def read_path(file: Path, zero_ns: int = 0) -> Path3:
    """Reads TUM (seconds first), EuRoC csv (nanoseconds first) or KITTI poses (12 numbers).

    Seconds count from zero_ns. KITTI's times come from times.txt beside the poses.
    """
    rows = _read_rows(file)
    if not rows:
        raise SystemExit(f"demo: {file} holds no pose")
    if len(rows[0]) == 12:
        times = file.with_name("times.txt")
        stamps = [round(float(row[0]) * 1e9) for row in _read_rows(times)] if times.exists() \
            else [index * 10**9 for index in range(len(rows))]
        positions = [[float(row[i]) for i in (3, 7, 11)] for row in rows]
        stamps = stamps[:len(rows)]
    else:
        tum = len(rows[0]) == 8
        stamps = [_nanoseconds(row[0]) if tum else int(row[0]) for row in rows]
        positions = [[float(value) for value in row[1:4]] for row in rows]
    seconds = np.array([(stamp - zero_ns) * 1e-9 for stamp in stamps])
    return Path3(seconds, np.array(positions))


def first_timestamp(file: Path) -> int:
    """The first time of a TUM trajectory, in nanoseconds."""
    rows = _read_rows(file)
    return _nanoseconds(rows[0][0]) if rows else 0


def at_times(path: Path3, seconds: np.ndarray,
             tolerance: float = 0.06) -> tuple[np.ndarray, np.ndarray]:
    """Positions of a path at given times by linear interpolation, and which of them it covers.

    A time is covered when the path has poses on both sides that are near (or it is one of them).
    """
    after = np.clip(np.searchsorted(path.seconds, seconds), 1, len(path.seconds) - 1)
    before = after - 1
    near = np.minimum(np.abs(path.seconds[after] - seconds),
                      np.abs(path.seconds[before] - seconds)) <= tolerance
    interpolated = np.stack([np.interp(seconds, path.seconds, path.positions[:, i])
                             for i in range(3)], axis=1)
    return interpolated, near


def align(source: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotation R and translation t that minimise |R source + t - target|^2 (n x 3; no scale)."""
    mean_source, mean_target = source.mean(axis=0), target.mean(axis=0)
    u, _, vt = np.linalg.svd((target - mean_target).T @ (source - mean_source))
    sign = np.diag([1, 1, np.sign(np.linalg.det(u @ vt))])
    rotation = u @ sign @ vt
    return rotation, mean_target - rotation @ mean_source


@dataclass
class Comparison:
    """An estimate aligned to ground truth (SE(3)); everything in the frame of the ground truth."""

    seconds: np.ndarray
    estimate: np.ndarray
    truth: np.ndarray
    errors: np.ndarray  # metres
    rotation: np.ndarray
    translation: np.ndarray

    @property
    def rmse(self) -> float:
        return float(np.sqrt(np.mean(self.errors**2)))


def compare(estimate_file: Path, truth_file: Path) -> Comparison:
    """Aligns a TUM trajectory to ground truth by its positions."""
    zero = first_timestamp(estimate_file)
    estimate = read_path(estimate_file, zero)
    truth = read_path(truth_file, zero)
    at_estimate, near = at_times(truth, estimate.seconds)
    if near.sum() < 3:
        raise SystemExit(f"demo: fewer than three poses of {estimate_file} have ground truth in "
                         f"{truth_file}")
    rotation, translation = align(estimate.positions[near], at_estimate[near])
    moved = estimate.positions[near] @ rotation.T + translation
    errors = np.linalg.norm(moved - at_estimate[near], axis=1)
    return Comparison(estimate.seconds[near], moved, at_estimate[near], errors, rotation,
                      translation)


def plan_axes(positions: np.ndarray) -> tuple[int, int]:
    """The two axes of largest extent, in order: the view "from above" of any convention."""
    extent = np.ptp(positions, axis=0)
    return tuple(sorted(np.argsort(extent)[-2:]))  # type: ignore[return-value]


def _tidy(axes: plt.Axes, title: str, x_label: str, y_label: str) -> None:
    axes.set_title(title, loc="left", fontsize=11)
    axes.set_xlabel(x_label)
    axes.set_ylabel(y_label)
    axes.grid(color="#e6e6e6", linewidth=0.7)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def draw_plan(axes: plt.Axes, result: Comparison, title: str) -> None:
    """Estimate and ground truth from above."""
    i, j = plan_axes(result.truth)
    axes.plot(result.truth[:, i], result.truth[:, j], color=TRUTH, linewidth=3.5, alpha=0.35,
              label="ground truth")
    axes.plot(result.estimate[:, i], result.estimate[:, j], color=ESTIMATE, linewidth=1.3,
              label="airslam")
    axes.plot(*result.estimate[0, [i, j]], "o", color=ESTIMATE, markersize=6, label="start")
    axes.set_aspect("equal", adjustable="datalim")
    names = "xyz"
    _tidy(axes, title, f"{names[i]} [m]", f"{names[j]} [m]")
    axes.legend(frameon=False, fontsize=9)


def draw_errors(axes: plt.Axes, result: Comparison) -> None:
    """Distance to ground truth over time."""
    axes.plot(result.seconds, 1000 * result.errors, color=ESTIMATE, linewidth=1.3)
    axes.axhline(1000 * result.rmse, color=TRUTH, linewidth=0.8, linestyle=":")
    axes.set_ylim(bottom=0)
    _tidy(axes, f"position error, RMSE {1000 * result.rmse:.1f} mm (dotted)", "time [s]", "[mm]")


def draw_tracked(axes: plt.Axes, report: dict) -> None:
    """Tracked points of each frame; keyframes and lost frames marked."""
    states = report.get("frame_states", [])
    if not states:
        axes.set_axis_off()
        return
    seconds = np.array([(s["timestamp_ns"] - states[0]["timestamp_ns"]) * 1e-9 for s in states])
    points = np.array([s.get("tracked_points", 0) for s in states], dtype=float)
    keyframe = np.array([bool(s.get("keyframe")) for s in states])
    lost = np.array([s.get("state") == "lost" for s in states])
    axes.plot(seconds, points, color=ACCENT, linewidth=1.2, label="points tracked")
    axes.plot(seconds[keyframe], points[keyframe], ".", color=ESTIMATE, markersize=6,
              label=f"keyframe ({keyframe.sum()})")
    if lost.any():
        axes.plot(seconds[lost], np.zeros(lost.sum()), "x", color="#b2182b", label="lost")
    axes.set_ylim(bottom=0)
    _tidy(axes, "points tracked", "time [s]", "points")
    axes.legend(frameon=False, fontsize=9, loc="lower left")


def draw_trajectory(file: Path, result: Comparison | None, estimate: Path3, report: dict) -> None:
    """Writes trajectory.png."""
    figure = plt.figure(figsize=(12, 6), dpi=110, layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=[1.15, 1])
    plan = figure.add_subplot(grid[:, 0])
    errors, tracked = figure.add_subplot(grid[0, 1]), figure.add_subplot(grid[1, 1])
    if result is not None:
        draw_plan(plan, result, "trajectory from above, aligned to ground truth (SE(3))")
        draw_errors(errors, result)
    else:
        i, j = plan_axes(estimate.positions)
        plan.plot(estimate.positions[:, i], estimate.positions[:, j], color=ESTIMATE)
        plan.set_aspect("equal", adjustable="datalim")
        _tidy(plan, "trajectory", f"{'xyz'[i]} [m]", f"{'xyz'[j]} [m]")
        errors.set_axis_off()
    draw_tracked(tracked, report)
    figure.savefig(file)
    plt.close(figure)


@dataclass
class MapContent:
    """What map.db holds of the largest component: metres in the map's world, left camera."""

    landmarks: np.ndarray  # (n, 3)
    lines: np.ndarray      # (m, 2, 3), the ends of each
    keyframes: np.ndarray  # (k, 3), positions of the body


def _rotate(quaternion_wxyz: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Rotates one vector by (k, 4) quaternions."""
    w, xyz = quaternion_wxyz[:, :1], quaternion_wxyz[:, 1:]
    twice = 2 * np.cross(xyz, vector)
    return vector + w * twice + np.cross(xyz, twice)


def read_map(file: Path) -> MapContent:
    """Reads the landmarks and keyframes of a map file's largest component (read-only)."""
    with sqlite3.connect(f"file:{file}?mode=ro", uri=True) as database:
        component = database.execute("SELECT component FROM keyframes GROUP BY component "
                                     "ORDER BY COUNT(*) DESC, component LIMIT 1").fetchone()
        if component is None:
            return MapContent(np.zeros((0, 3)), np.zeros((0, 2, 3)), np.zeros((0, 3)))
        poses = np.array(database.execute(
            "SELECT qw, qx, qy, qz, tx, ty, tz FROM keyframes WHERE component = ? ORDER BY id",
            component).fetchall())
        landmarks = np.array(database.execute(
            "SELECT x, y, z FROM landmarks JOIN keyframes ON first_seen_by = keyframes.id "
            "WHERE component = ? ORDER BY landmarks.id", component).fetchall()).reshape(-1, 3)
        lines = np.array(database.execute(
            "SELECT x1, y1, z1, x2, y2, z2 FROM line_landmarks JOIN keyframes "
            "ON first_seen_by = keyframes.id WHERE component = ? ORDER BY line_landmarks.id",
            component).fetchall()).reshape(-1, 2, 3)
        mount = np.array(database.execute(
            "SELECT body_from_left_qw, body_from_left_qx, body_from_left_qy, body_from_left_qz, "
            "body_from_left_tx, body_from_left_ty, body_from_left_tz FROM calibration").fetchone())
    # world_from_body = world_from_cam * cam_from_body; the body's origin in the camera is -R^T t.
    inverse = mount[:4] * np.array([1, -1, -1, -1])
    body_in_cam = -_rotate(inverse[None], mount[4:])[0]
    return MapContent(landmarks, lines, poses[:, 4:] + _rotate(poses[:, :4], body_in_cam))


def _reach(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centre and half size of the box that holds the points but the few that are far away."""
    centre = np.median(points, axis=0)
    return centre, np.percentile(np.abs(points - centre), 98, axis=0) * 1.3


def draw_map(file: Path, content: MapContent, result: Comparison | None, estimate: Path3) -> None:
    """Writes map.png: points and lines from above, coloured by height, with path and keyframes."""
    rotation, translation = (np.eye(3), np.zeros(3)) if result is None else \
        (result.rotation, result.translation)
    path = estimate.positions @ rotation.T + translation
    keyframes = content.keyframes @ rotation.T + translation
    points = content.landmarks @ rotation.T + translation
    lines = content.lines @ rotation.T + translation
    if len(points):
        centre, reach = _reach(points)
        points = points[(np.abs(points - centre) <= reach).all(axis=1)]
        lines = lines[(np.abs(lines - centre) <= reach).all(axis=(1, 2))]
    everything = np.concatenate([path, points])
    i, j = plan_axes(everything)
    height = 3 - i - j
    extent = np.ptp(everything, axis=0)
    size = (8.5, float(np.clip(7.5 * extent[j] / extent[i], 4, 10)))
    figure, axes = plt.subplots(figsize=size, dpi=110, layout="constrained")
    # What lies lowest first, so that tops of shelves are not hidden by the floor.
    points = points[np.argsort(points[:, height])]
    dots = axes.scatter(points[:, i], points[:, j], c=points[:, height], s=4.0, cmap="viridis",
                        linewidths=0)
    lines = lines[np.argsort(lines[:, :, height].mean(axis=1))]
    axes.add_collection(LineCollection(
        lines[:, :, [i, j]], colors=dots.cmap(dots.norm(lines[:, :, height].mean(axis=1))),
        linewidths=1.6))
    axes.plot(path[:, i], path[:, j], color=ESTIMATE, linewidth=1.5, label="path")
    axes.plot(keyframes[:, i], keyframes[:, j], "o", color=ESTIMATE, markersize=3.5,
              markeredgecolor="white", markeredgewidth=0.5, label=f"keyframes ({len(keyframes)})")
    axes.set_aspect("equal", adjustable="datalim")
    _tidy(axes, f"map from above: {len(content.landmarks)} points, {len(content.lines)} lines",
          f"{'xyz'[i]} [m]",
          f"{'xyz'[j]} [m]")
    axes.legend(frameon=False, fontsize=9, loc="upper right")
    figure.colorbar(dots, ax=axes, shrink=0.7, label=f"height {'xyz'[height]} [m]")
    figure.savefig(file)
    plt.close(figure)


def summary(folder: Path, report: dict, result: Comparison | None) -> str:
    """The short block that the demo ends with."""
    lost = sum(interval["frames"] for interval in report.get("lost_intervals", []))
    frames = report.get("frames", 0)
    lines = [
        f"frames       {frames}, lost {lost}",
        f"speed        {report.get('frames_per_second', 0):.1f} frames/s "
        f"({report.get('wall_seconds', 0):.1f} s for everything)",
        f"map          {report.get('keyframes', 0)} keyframes, {report.get('landmarks', 0)} "
        f"landmarks, {report.get('lines', {}).get('landmarks', 0)} lines, {(folder / 'map.db').stat().st_size / 1e6:.1f} MB",
    ]
    if result is not None:
        length = np.linalg.norm(np.diff(result.truth, axis=0), axis=1).sum()
        lines.append(f"accuracy     ATE RMSE {1000 * result.rmse:.1f} mm over {length:.1f} m "
                     "(body, SE(3) alignment)")
    lines.append("pictures     " + ", ".join(
        str(folder / name) for name in ("trajectory.png", "map.png", "matches.png")
        if (folder / name).exists()))
    return "\n".join(lines)


def main() -> int:
    parser = argparse.ArgumentParser(description="Draw and sum up a result of `airslam map`.")
    parser.add_argument("folder", type=Path, help="what `airslam map --out` wrote")
    parser.add_argument("truth", type=Path, nargs="?", help="ground truth, to compare with")
    arguments = parser.parse_args()
    folder: Path = arguments.folder
    report = json.loads((folder / "report.json").read_text())
    estimate = read_path(folder / "trajectory.tum", first_timestamp(folder / "trajectory.tum"))
    result = compare(folder / "trajectory.tum", arguments.truth) if arguments.truth else None
    draw_trajectory(folder / "trajectory.png", result, estimate, report)
    draw_map(folder / "map.png", read_map(folder / "map.db"), result, estimate)
    print(summary(folder, report, result))
    return 0


if __name__ == "__main__":
    sys.exit(main())
