# SPDX-License-Identifier: BSD-3-Clause
"""The plots of a report, each a matplotlib figure. Metres, seconds since the first frame, degrees."""

from __future__ import annotations

import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
from matplotlib.collections import LineCollection  # noqa: E402
from matplotlib.figure import Figure  # noqa: E402

from .results import Comparison, Results  # noqa: E402

ESTIMATE, TRUTH, ACCENT, SECOND, FAINT = "#d95f02", "#33404d", "#1b6ca8", "#7570b3", "#9aa5b1"
STATE_COLORS = {"initialized": "#1a7f5a", "tracked": "#66b896", "inertial": "#7570b3", "lost": "#c0392b",
                "skipped": "#8d99a6"}
plt.rcParams.update({"font.size": 9.5, "font.family": "sans-serif", "svg.fonttype": "none",
                     "font.sans-serif": ["DejaVu Sans", "Arial", "sans-serif"],
                     "svg.hashsalt": "airslam", "axes.edgecolor": "#9aa5b1", "axes.labelcolor": "#33404d",
                     "xtick.color": "#5b6876", "ytick.color": "#5b6876"})


def _figure(width: float, height: float, rows: int = 1, columns: int = 1,
            **options: object) -> tuple[Figure, np.ndarray]:
    figure, axes = plt.subplots(rows, columns, figsize=(width, height), layout="constrained",
                                squeeze=False, **options)
    return figure, axes


def _tidy(axes: plt.Axes, title: str, x_label: str, y_label: str) -> None:
    axes.set_title(title, loc="left", fontsize=10, color=TRUTH)
    axes.set_xlabel(x_label)
    axes.set_ylabel(y_label)
    axes.grid(color="#e8ebee", linewidth=0.7)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def plan_axes(positions: np.ndarray, z_is_up: bool) -> tuple[int, int, int]:
    """The two axes of the view from above and the third, the height.

    Where z is known to point up these are x, y, z; else the two axes of largest extent.
    """
    if z_is_up:
        return 0, 1, 2
    i, j = sorted(np.argsort(np.ptp(positions, axis=0))[-2:])
    return int(i), int(j), int(3 - i - j)


def world_is_upright(results: Results, truth_given: bool) -> bool:
    """Whether z points up in what is drawn: the IMU's world, or a ground truth of EuRoC's kind."""
    return results.map.calibration.has_imu and \
        (truth_given or results.report.get("inertial", {}).get("state") == "used")


def path_of(results: Results, comparison: Comparison | None) -> np.ndarray:
    """(n, 3) positions of all poses, in the ground truth's world where there is one."""
    positions = results.trajectory.world_from_body[:, :3, 3]
    if comparison is None:
        return positions
    move = comparison.truth_from_estimate
    return positions @ move[:3, :3].T + move[:3, 3]


def trajectory_figure(results: Results, comparison: Comparison | None) -> Figure:
    """The path from above and from the side, over the ground truth where there is one."""
    path = path_of(results, comparison)
    i, j, k = plan_axes(path, world_is_upright(results, comparison is not None))
    low, high = path.min(axis=0), path.max(axis=0)
    if comparison is not None:
        low, high = np.minimum(low, comparison.truth.min(axis=0)), np.maximum(high, comparison.truth.max(axis=0))
    middle, extent = (low + high) / 2, 1.1 * np.maximum(high - low, 0.05)
    # Both panels share a scale; a path that is long in y gets more x rather than a page of its own.
    width = max(extent[i], extent[j] / 0.55, extent[k] / 0.55)
    heights = {j: max(extent[j], 0.2 * width), k: max(extent[k], 0.12 * width)}
    figure, axes = _figure(9.5, 8.6 * (heights[j] + heights[k]) / width + 1.5, 2, 1,
                           height_ratios=[heights[j], heights[k]])
    for panel, across, title in ((axes[0, 0], j, "from above"), (axes[1, 0], k, "from the side")):
        if comparison is not None:
            panel.plot(comparison.truth[:, i], comparison.truth[:, across], color=TRUTH, linewidth=4,
                       alpha=0.3, label="ground truth", solid_capstyle="round")
        panel.plot(path[:, i], path[:, across], color=ESTIMATE, linewidth=1.4, label="AirSLAM")
        panel.plot(path[0, i], path[0, across], "o", color=ESTIMATE, markersize=6, label="start")
        panel.set_xlim(middle[i] - width / 2, middle[i] + width / 2)
        panel.set_ylim(middle[across] - heights[across] / 2, middle[across] + heights[across] / 2)
        panel.set_aspect("equal")
        _tidy(panel, title, f"{'xyz'[i]} [m]", f"{'xyz'[across]} [m]")
    axes[0, 0].legend(frameon=False, loc="best", ncols=3)
    return figure


def error_figure(comparison: Comparison, zero_ns: int) -> Figure:
    """Distance and angle to the ground truth over time."""
    seconds = (comparison.times_ns - zero_ns) * 1e-9
    figure, axes = _figure(9.5, 3.9, 2, 1, sharex=True)
    scale, unit = (1000, "mm") if comparison.rmse < 0.1 else (1, "m")
    position, rotation = axes[0, 0], axes[1, 0]
    position.plot(seconds, scale * comparison.position_errors, color=ESTIMATE, linewidth=1.2)
    position.axhline(scale * comparison.rmse, color=TRUTH, linewidth=0.8, linestyle=":")
    rotation.plot(seconds, comparison.rotation_errors, color=ACCENT, linewidth=1.2)
    for panel in (position, rotation):
        panel.set_ylim(bottom=0)
    _tidy(position, f"position error (dotted: RMSE, {scale * comparison.rmse:.3g} {unit})", "", f"[{unit}]")
    _tidy(rotation, "rotation error after the same alignment", "time [s]", "[°]")
    return figure


def tracking_figure(states: list[dict], zero_ns: int) -> Figure:
    """Points tracked and milliseconds of tracking, frame by frame."""
    seconds = np.array([(s["timestamp_ns"] - zero_ns) * 1e-9 for s in states])
    points = np.array([s.get("tracked_points", 0) for s in states], dtype=float)
    keyframe = np.array([bool(s.get("keyframe")) for s in states])
    figure, axes = _figure(9.5, 3.7, 2, 1, sharex=True)
    tracked, cost = axes[0, 0], axes[1, 0]
    tracked.plot(seconds, points, color=ACCENT, linewidth=1.1)
    tracked.plot(seconds[keyframe], points[keyframe], ".", color=ESTIMATE, markersize=5,
                 label=f"keyframe ({keyframe.sum()})")
    milliseconds = np.array([s.get("ms", 0.0) for s in states])
    cost.vlines(seconds, 0, milliseconds, color=SECOND, linewidth=1.2)
    # One frame that starts the map can take many times as long as the others: it is cut off.
    top = 1.3 * float(np.percentile(milliseconds, 99)) if len(milliseconds) else 1
    cut = int((milliseconds > top).sum())
    for panel in (tracked, cost):
        panel.set_ylim(bottom=0)
    cost.set_ylim(top=max(top, 1e-3))
    _tidy(tracked, "points tracked", "", "points")
    _tidy(cost, "time of tracking" + (f" ({cut} above, up to {milliseconds.max():.0f} ms)" if cut else ""),
          "time [s]", "[ms]")
    tracked.legend(frameon=False, loc="lower left")
    return figure


def bias_figure(results: Results, zero_ns: int) -> Figure | None:
    """Biases of the IMU at the keyframes; None where none is known."""
    biases = (results.map.gyroscope_biases, results.map.accelerometer_biases)
    known = np.isfinite(biases[0]).all(axis=1)
    if not known.any():
        return None
    seconds = (results.map.timestamps_ns[known] - zero_ns) * 1e-9
    figure, axes = _figure(9.5, 3.2, 1, 2)
    for panel, values, title, unit in zip(axes[0], biases, ("gyroscope bias", "accelerometer bias"),
                                          ("rad/s", "m/s²")):
        for axis, color in enumerate((ESTIMATE, ACCENT, SECOND)):
            panel.plot(seconds, values[known, axis], color=color, linewidth=1.2, label="xyz"[axis])
        _tidy(panel, title, "time [s]", f"[{unit}]")
    axes[0, 0].legend(frameon=False, ncols=3)
    return figure


def _reach(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centre and half size of the box that holds the points but the few that are far away."""
    centre = np.median(points, axis=0)
    return centre, np.percentile(np.abs(points - centre), 98, axis=0) * 1.3


def map_figure(results: Results, comparison: Comparison | None) -> Figure:
    """Points and lines from above, coloured by height, with path and keyframes."""
    content, component = results.map, results.map.largest_component
    move = np.eye(4) if comparison is None else comparison.truth_from_estimate
    to_world = lambda x: x @ move[:3, :3].T + move[:3, 3]  # noqa: E731
    points = to_world(content.landmarks[content.landmark_components == component])
    lines = to_world(content.lines[content.line_components == component])
    keyframes = to_world(content.world_from_body[content.components == component][:, :3, 3])
    path, counts = path_of(results, comparison), (len(points), len(lines))
    if len(points):
        centre, reach = _reach(points)
        points = points[(np.abs(points - centre) <= reach).all(axis=1)]
        lines = lines[(np.abs(lines - centre) <= reach).all(axis=(1, 2))]
    everything = np.concatenate([path, points])
    i, j, k = plan_axes(everything, world_is_upright(results, comparison is not None))
    extent = np.maximum(np.ptp(everything, axis=0), 0.1)
    figure, axes = _figure(9.5, float(np.clip(8.2 * extent[j] / extent[i], 4, 9.5)))
    panel = axes[0, 0]
    # What lies lowest first, so that tops of shelves are not hidden by the floor.
    points = points[np.argsort(points[:, k])]
    dots = panel.scatter(points[:, i], points[:, j], c=points[:, k], s=3.5, cmap="viridis", linewidths=0)
    lines = lines[np.argsort(lines[:, :, k].mean(axis=1))]
    colors = dots.cmap(dots.norm(lines[:, :, k].mean(axis=1)))
    panel.add_collection(LineCollection(lines[:, :, [i, j]], colors=colors, linewidths=1.6))
    panel.plot(path[:, i], path[:, j], color=ESTIMATE, linewidth=1.4, label="path")
    panel.plot(keyframes[:, i], keyframes[:, j], "o", color=ESTIMATE, markersize=3.5,
               markeredgecolor="white", markeredgewidth=0.5, label=f"keyframes ({len(keyframes)})")
    panel.set_aspect("equal", adjustable="datalim")
    _tidy(panel, f"{counts[0]} points, {counts[1]} lines", f"{'xyz'[i]} [m]", f"{'xyz'[j]} [m]")
    panel.legend(frameon=False, loc="upper right")
    figure.colorbar(dots, ax=panel, shrink=0.7, label=f"{'xyz'[k]} [m]")
    return figure
