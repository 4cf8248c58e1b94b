# SPDX-License-Identifier: BSD-3-Clause
"""`python -m airslam report`: one page, report.html, about a result folder; it needs no network."""

from __future__ import annotations

import argparse
import base64
import io
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from . import Error, Trajectory, evaluate
from .results import Comparison, Results, compare, find_truth, load_results

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass
class Subject:
    """What the page is about. The evaluation is None without ground truth."""

    results: Results
    dataset: Path | None
    truth: Path | None
    comparison: Comparison | None
    evaluation: dict | None

    @property
    def zero_ns(self) -> int:
        """The time of the first frame."""
        states = self.results.report.get("frame_states") or []
        return states[0]["timestamp_ns"] if states else int(self.results.trajectory.timestamps_ns[0])


def _plots() -> object:
    """The plots, which need matplotlib."""
    try:
        from . import plots  # noqa: PLC0415 (optional)
    except ImportError:
        raise Error("the report needs matplotlib and pillow: pip install '.[report]'") from None
    return plots


def load_subject(folder: Path, truth: Path | None = None, dataset: Path | None = None) -> Subject:
    """Reads everything; ground truth and data set are found by themselves where they are not given."""
    results = load_results(folder)
    if not len(results.trajectory):
        raise Error(f"{folder / 'trajectory.tum'} holds no pose")
    if dataset is not None and not dataset.is_dir():
        raise Error(f"the data set {dataset} is no folder")
    dataset = dataset or results.dataset
    truth = truth or find_truth(dataset)
    if truth is None:
        return Subject(results, dataset, None, None, None)
    comparison = compare(Trajectory.load(truth), results.trajectory)
    if comparison is None:
        raise Error(f"fewer than three poses of {folder / 'trajectory.tum'} have ground truth in {truth}")
    evaluation = evaluate(truth, folder / "trajectory.tum", dataset=dataset)
    return Subject(results, dataset, truth, comparison, evaluation)


def _image(figure: Figure, kind: str, about: str) -> str:
    """A figure as an <img> that holds its own data."""
    stream = io.BytesIO()
    figure.savefig(stream, format=kind, dpi=150, metadata={"Date": None} if kind == "svg" else None)
    _plots().plt.close(figure)
    data = base64.b64encode(stream.getvalue()).decode()
    media = "svg+xml" if kind == "svg" else kind
    return f'<img alt="{escape(about)}" src="data:image/{media};base64,{data}">'


def _section(title: str, *parts: str) -> str:
    return f"<section><h2>{escape(title)}</h2>{''.join(parts)}</section>"


def _table(head: list[str], rows: list[list[str]]) -> str:
    cells = "".join(f"<th>{escape(cell)}</th>" for cell in head)
    body = "".join("<tr>" + "".join(f"<td>{cell}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table>{f'<tr>{cells}</tr>' if head else ''}{body}</table>"


def _length(metres: float) -> str:
    return f"{1000 * metres:.1f} mm" if metres < 0.1 else f"{metres:.3f} m"


def _tiles(subject: Subject) -> str:
    report = subject.results.report
    lost = sum(interval["frames"] for interval in report.get("lost_intervals", []))
    tiles = [(f"{report.get('frames_with_pose', 0)} / {report.get('frames', 0)}", "frames with a pose", lost > 0)]
    if subject.evaluation is not None:
        tiles += [(_length(subject.comparison.rmse), "ATE (RMSE, SE(3))", False),
                  (f"{100 * subject.evaluation['coverage']:.1f} %", "coverage", False)]
    tiles += [(f"{report.get('frames_per_second', 0):.1f}", "frames/s, whole process", False),
              (str(report.get("keyframes", 0)), "keyframes", False),
              (str(report.get("landmarks", 0)), "points in the map", False),
              (str(report.get("lines", {}).get("landmarks", 0)), "lines in the map", False)]
    return '<div class="tiles">' + "".join(
        f'<div class="tile{" bad" if bad else ""}"><b>{value}</b><span>{name}</span></div>'
        for value, name, bad in tiles) + "</div>"


def _events(subject: Subject) -> str:
    """What went wrong, or that nothing did."""
    report, zero = subject.results.report, subject.zero_ns
    at = lambda ns: f"{(ns - zero) * 1e-9:.2f} s"  # noqa: E731
    events = [escape(str(warning)) for warning in report.get("warnings", [])]
    events += [f"lost from {at(i['from_ns'])} to {at(i['to_ns'])}: {i['frames']} frames"
               for i in report.get("lost_intervals", [])]
    if report.get("stopped_by"):
        events.append(f"the run was ended by {escape(report['stopped_by'])} after {report['frames']} of "
                      f"{report.get('frames_in_sequence', '?')} frames")
    if report.get("frames_skipped"):
        events.append(f"{report['frames_skipped']} frames skipped: their images could not be used")
    if report.get("components", 1) > 1:
        events.append(f"the map has {report['components']} components that share no world; the page shows "
                      "the largest")
    inertial = report.get("inertial", {})
    events += [f"gap of the IMU from {at(g['from_ns'])} to {at(g['to_ns'])}" for g in inertial.get("gaps", [])]
    if inertial.get("reason") and inertial.get("state") not in ("off", "no calibration"):
        events.append(f"IMU: {escape(inertial['reason'])}")
    if not events:
        return '<div class="good">No frame was lost or skipped, and nothing was odd.</div>'
    return "".join(f'<div class="warning">{event}</div>' for event in events)


def _state_strip(states: list[dict]) -> str:
    """One band over time: the state of each frame, and ticks for keyframes below."""
    colors = _plots().STATE_COLORS
    begin = states[0]["timestamp_ns"]
    span = max(states[-1]["timestamp_ns"] - begin, 1) / max(len(states) - 1, 1) * len(states)
    shapes, run = [], 0
    for index, state in enumerate(states):
        x = 1000 * (state["timestamp_ns"] - begin) / span
        if state.get("keyframe"):
            shapes.append(f'<rect x="{x:.2f}" y="32" width="1.2" height="8" fill="#d95f02"/>')
        if index + 1 < len(states) and states[index + 1]["state"] == state["state"]:
            continue
        start = 1000 * (states[run]["timestamp_ns"] - begin) / span
        end = 1000.0 if index + 1 == len(states) else 1000 * (states[index + 1]["timestamp_ns"] - begin) / span
        shapes.append(f'<rect x="{start:.2f}" y="4" width="{end - start:.2f}" height="24" '
                      f'fill="{colors.get(state["state"], "#000")}"/>')
        run = index + 1
    counts = {name: sum(s["state"] == name for s in states) for name in colors}
    legend = "".join(f'<span><i style="background:{colors[name]}"></i>{name}: {n}</span>'
                     for name, n in counts.items() if n)
    legend += '<span><i style="background:#d95f02"></i>keyframe</span>'
    return (f'<svg viewBox="0 0 1000 42" preserveAspectRatio="none" style="width:100%;height:42px">'
            f'{"".join(shapes)}</svg><div class="legend">{legend}</div>')


def _stages(report: dict) -> str:
    stages = sorted(report.get("stages", {}).items(), key=lambda item: -item[1]["total_ms"])
    longest = max((stage["total_ms"] for _, stage in stages), default=1) or 1
    rows = [[escape(name), str(s["count"]), f"{s['median_ms']:.2f}", f"{s['mean_ms']:.2f}",
             f"{s['p95_ms']:.2f}", f"{s['max_ms']:.1f}", f"{s['total_ms'] / 1000:.2f}",
             f'<i style="width:{100 * s["total_ms"] / longest:.1f}%"></i>'] for name, s in stages]
    table = _table(["stage", "times", "median ms", "mean ms", "95 % ms", "max ms", "total s", ""], rows)
    return table.replace("<td><i", '<td class="bar"><i') + \
        ('<p class="note">Stages run on several threads and overlap: their sum is more than the '
         f"{report.get('wall_seconds', 0):.1f} s of the process.</p>")


def _frames(subject: Subject) -> str:
    from . import frame_pictures as drawing  # noqa: PLC0415 (needs pillow)

    pictures = drawing.frame_pictures(subject.results, subject.dataset)
    if not pictures:
        return ""
    figures = "".join(
        f"<figure>{p.svg}<figcaption>{(p.timestamp_ns - subject.zero_ns) * 1e-9:.2f} s: {p.points} keypoints, "
        f"{p.points_in_map} in the map; {p.lines} lines, {p.lines_in_map} in the map</figcaption></figure>"
        for p in pictures)
    legend = "".join(f'<span><i style="background:{color};border:1px solid #9aa5b1"></i>{name}</span>'
                     for color, name in ((drawing.IN_MAP_POINT, "keypoint in the map"),
                                         (drawing.POINT, "other keypoint"),
                                         (drawing.IN_MAP_LINE, "line in the map"),
                                         (drawing.LINE, "other line")))
    return _section("What the camera saw", f'<div class="frames">{figures}</div>',
                    f'<div class="legend">{legend}</div>')


def _errors(subject: Subject) -> str:
    evaluation = subject.evaluation
    rows = [[name, *(f"{scale * evaluation[key][part]:.4g}" for part in ("rmse", "mean", "median", "max"))]
            for name, key, scale in (("position, ATE [m]", "ate_position_m", 1),
                                     ("relative translation [m]", "rpe_translation_m", 1),
                                     ("relative rotation [°]", "rpe_rotation_deg", 1))]
    plot = _image(_plots().error_figure(subject.comparison, subject.zero_ns), "svg", "errors over time")
    return _section("Errors against ground truth", plot, _table(["", "RMSE", "mean", "median", "max"], rows),
                    f'<p class="note">{len(subject.comparison.times_ns)} poses compared with '
                    f"{escape(str(subject.truth))}; as <code>airslam eval</code> computes it.</p>")


def _numbers(report: dict) -> str:
    """Counts and the IMU as two columns of names and numbers."""
    lines, inertial = report.get("lines", {}), report.get("inertial", {})
    counts = [["frames", report.get("frames")], ["in the trajectory", report.get("frames_in_trajectory")],
              ["carried by the IMU alone", report.get("frames_inertial")],
              ["that needed the matcher", report.get("frames_that_needed_the_matcher")],
              ["lines detected in keyframes", lines.get("detected")],
              ["lines matched left to right", lines.get("stereo_matched")],
              ["observations of lines", lines.get("observations")], ["components", report.get("components")]]
    imu = [["state", inertial.get("state", "–")], ["readings", inertial.get("readings")],
           ["time offset [ms]", f"{1000 * inertial.get('time_offset_s', 0):.2f}"]]
    for start in inertial.get("starts", []):
        imu.append(["gravity found after [s]", f"{start['seconds']:.1f}"])
    bias = inertial.get("final_bias") or {}
    imu += [[f"{name} bias [{unit}]", ", ".join(f"{v:+.4f}" for v in bias[name])]
            for name, unit in (("gyroscope", "rad/s"), ("accelerometer", "m/s²")) if name in bias]
    tables = [_table([], [[escape(str(a)), escape(str(b))] for a, b in rows if b is not None])
              for rows in (counts, imu)]
    return f'<div class="pairs"><div>{tables[0]}</div><div>{tables[1]}</div></div>'


def page(subject: Subject) -> str:
    """The whole page as HTML."""
    plots, report = _plots(), subject.results.report
    states = report.get("frame_states") or []
    name = Path(report.get("dataset") or subject.results.folder).name
    css = (Path(__file__).parent / "report.css").read_text()
    parts = [f"<h1>{escape(name)}</h1><p class='path'>{escape(str(subject.results.folder))}, model pack "
             f"{escape(str(report.get('model_pack', '–')))}</p>", _tiles(subject),
             _section("What happened", _events(subject), _state_strip(states) if states else ""),
             _section("Trajectory", _image(plots.trajectory_figure(subject.results, subject.comparison),
                                           "svg", "trajectory from above and from the side"),
                      "" if subject.comparison else '<p class="note">No ground truth was found or given.</p>')]
    if subject.comparison is not None:
        parts.append(_errors(subject))
    parts += [_section("Map from above", _image(plots.map_figure(subject.results, subject.comparison), "png",
                                                "map from above")), _frames(subject)]
    if states:
        parts.append(_section("Tracking", _image(plots.tracking_figure(states, subject.zero_ns), "svg",
                                                 "points tracked and time of tracking")))
    biases = plots.bias_figure(subject.results, subject.zero_ns)
    parts += [_section("IMU", _image(biases, "svg", "biases over time")) if biases is not None else "",
              _section("Time of each stage", _stages(report)), _section("Numbers", _numbers(report)),
              _section("Configuration", "<details><summary>effective options</summary><pre>"
                       f"{escape(str(report.get('options', '')))}</pre></details>")]
    return (f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{escape(name)} – AirSLAM</title>'
            '<meta name="viewport" content="width=device-width, initial-scale=1">'
            f"<style>{css}</style></head><body><main>{''.join(parts)}</main></body></html>\n")


def summary(subject: Subject) -> str:
    """A few lines of the same for the terminal."""
    report, folder = subject.results.report, subject.results.folder
    lost = sum(interval["frames"] for interval in report.get("lost_intervals", []))
    lines = [f"frames       {report['frames']}, lost {lost}",
             f"speed        {report['frames_per_second']:.1f} frames/s ({report['wall_seconds']:.1f} s for everything)",
             f"map          {report['keyframes']} keyframes, {report['landmarks']} points, "
             f"{report.get('lines', {}).get('landmarks', 0)} lines, {(folder / 'map.db').stat().st_size / 1e6:.1f} MB"]
    if subject.evaluation is not None:
        lines.append(f"accuracy     ATE RMSE {_length(subject.comparison.rmse)} over "
                     f"{subject.evaluation['path_length_m']:.1f} m (body, SE(3) alignment)")
    return "\n".join(lines)


def write_report(subject: Subject, *, out: Path | None = None, pictures: bool = False) -> Path:
    """Writes the page (report.html in the result folder by default) and returns its path.

    With pictures, trajectory.png and map.png are written beside it.
    """
    folder = subject.results.folder
    file = out or folder / "report.html"
    file.write_text(page(subject))
    if pictures:
        plots = _plots()
        for name, draw in (("trajectory", plots.trajectory_figure), ("map", plots.map_figure)):
            figure = draw(subject.results, subject.comparison)
            figure.savefig(file.with_name(f"{name}.png"), dpi=110)
            plots.plt.close(figure)
    return file


def add_parser(subparsers: argparse._SubParsersAction) -> argparse.ArgumentParser:
    """Registers the command."""
    parser = subparsers.add_parser("report", help="one page, report.html, about a result folder",
                                   description=__doc__)
    parser.add_argument("folder", type=Path, help="what airslam map has written")
    parser.add_argument("--truth", type=Path, help="ground truth (EuRoC csv, KITTI poses or TUM); found in "
                                                   "the data set by itself")
    parser.add_argument("--dataset", type=Path, help="the images' folder, where it has moved since the run")
    parser.add_argument("--out", type=Path, help="file to write (report.html in the folder)")
    parser.add_argument("--pictures", action="store_true", help="also trajectory.png and map.png beside it")
    return parser


def main(arguments: argparse.Namespace) -> int:
    """Runs the command."""
    subject = load_subject(arguments.folder, arguments.truth, arguments.dataset)
    file = write_report(subject, out=arguments.out, pictures=arguments.pictures)
    print(summary(subject))
    print(f"page         {file} ({file.stat().st_size / 1e6:.1f} MB)")
    return 0
