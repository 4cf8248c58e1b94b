#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""A five-minute run: does the time of a frame grow, does memory grow more than the map?

    .venv/bin/python benchmarks/growth.py --source ../shared/data/warehouse_day --minutes 5

Repeats a sequence forth and back (frame n-1 follows frame n on the way back) under fresh, evenly
spaced timestamps, maps it while sampling the process's memory, and compares the first third of the
run with the last. Options after `--` go to `airslam map`.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import shutil
import statistics
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

import records

REPOSITORY = Path(__file__).resolve().parent.parent
START_NS = 1_800_000_000_000_000_000


def forth_and_back(count: int, total: int) -> list[int]:
    """Indices 0, 1, ..., count-1, count-2, ..., 1, 0, 1, ... `total` of them."""
    period = list(range(count)) + list(range(count - 2, 0, -1))
    return [period[i % len(period)] for i in range(total)]


def read_images(camera: Path) -> list[str]:
    """The file names of a camera's data.csv, in order."""
    with open(camera / "data.csv", newline="") as file:
        return [row[1].strip() for row in csv.reader(file) if row and not row[0].startswith("#")]


def make_long_sequence(source: Path, target: Path, total: int, rate_hz: float) -> None:
    """Writes an EuRoC folder of links to the source's images. No IMU: time runs back there."""
    if target.exists():
        shutil.rmtree(target)
    for name in ("cam0", "cam1"):
        camera, out = source / "mav0" / name, target / "mav0" / name
        (out / "data").mkdir(parents=True)
        shutil.copy(camera / "sensor.yaml", out / "sensor.yaml")
        images = read_images(camera)
        lines = ["#timestamp [ns],filename"]
        for i, index in enumerate(forth_and_back(len(images), total)):
            stamp = START_NS + round(i * 1e9 / rate_hz)
            image = f"{stamp}{Path(images[index]).suffix}"
            (out / "data" / image).symlink_to((camera / "data" / images[index]).resolve())
            lines.append(f"{stamp},{image}")
        (out / "data.csv").write_text("\n".join(lines) + "\n")


@dataclass
class MemoryTrace:
    """Resident memory of a process over time."""

    seconds: list[float] = field(default_factory=list)
    megabytes: list[float] = field(default_factory=list)
    exit_code: int = -1
    wall_seconds: float = 0


def resident_mb(pid: int) -> float | None:
    """Resident memory of a process, or nothing when it has ended."""
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    except (OSError, IndexError):
        return None
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def run_sampled(command: list[str], log: Path, interval: float = 0.5) -> MemoryTrace:
    """Runs a command and samples its memory."""
    trace = MemoryTrace()
    start = time.monotonic()
    with open(log, "w") as stream:
        process = subprocess.Popen(command, stdout=stream, stderr=subprocess.STDOUT)
        while process.poll() is None:
            megabytes = resident_mb(process.pid)
            if megabytes:
                trace.seconds.append(time.monotonic() - start)
                trace.megabytes.append(megabytes)
            time.sleep(interval)
    trace.exit_code = process.returncode
    trace.wall_seconds = time.monotonic() - start
    return trace


def thirds(values: list[float]) -> tuple[list[float], list[float]]:
    """The first and the last third."""
    third = max(1, len(values) // 3)
    return values[:third], values[-third:]


def measure(report: dict, trace: MemoryTrace, map_bytes: int) -> dict:
    """What happened in the whole run, and medians of its first and last third."""
    states = report["frame_states"]
    keyframe_at = [i for i, state in enumerate(states) if state.get("keyframe")]
    times = [float(state["ms"]) for state in states if "ms" in state]
    count = len(states)
    return {
        "frames": count,
        "tracked": sum(state["state"] in ("tracked", "initialized") for state in states),
        "wall_seconds": trace.wall_seconds,
        "frames_per_second": count / trace.wall_seconds,
        "keyframes": report["keyframes"], "landmarks": report["landmarks"],
        "map_mb": map_bytes / 1e6, "peak_mb": max(trace.megabytes, default=0.0),
        "thirds": {
            "tracking of a frame, median, ms": [statistics.median(part) for part in thirds(times)],
            "resident memory, median, MB": [statistics.median(part)
                                            for part in thirds(trace.megabytes)],
            "new keyframes": [sum(lo <= i < hi for i in keyframe_at) for lo, hi in
                              ((0, count // 3), (2 * count // 3, count))],
        },
    }


def summarize(result: dict) -> str:
    """The table, and how the map grew meanwhile."""
    rows = ["| | first third | last third | change |", "|---|---|---|---|"]
    rows += [f"| {name} | {first:.1f} | {last:.1f} | {100 * (last / first - 1):+.0f} % |"
             for name, (first, last) in result["thirds"].items()]
    return "\n".join([
        f"{result['frames']} frames, {result['tracked']} tracked, {result['wall_seconds']:.1f} s, "
        f"{result['frames_per_second']:.1f} frames/s; {result['keyframes']} keyframes, "
        f"{result['landmarks']} landmarks, map.db {result['map_mb']:.1f} MB, peak "
        f"{result['peak_mb']:.0f} MB", "", *rows])


def draw(file: Path, report: dict, trace: MemoryTrace) -> None:
    """Frame time, memory and keyframes over the run."""
    import matplotlib  # noqa: PLC0415

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt  # noqa: PLC0415
    import numpy as np  # noqa: PLC0415

    states = report["frame_states"]
    times = np.array([state.get("ms", np.nan) for state in states], dtype=float)
    figure, axes = plt.subplots(3, 1, figsize=(10, 8), dpi=110, layout="constrained")
    axes[0].plot(times, ".", color="#9aa5b1", markersize=2, label="a frame")
    window = 101
    if len(times) > 2 * window:
        medians = [np.nanmedian(times[max(0, i - 50):i + 51]) for i in range(len(times))]
        axes[0].plot(medians, color="#d95f02", linewidth=1.5, label=f"median of {window}")
    axes[0].set_ylim(0, np.nanpercentile(times, 99.5) * 1.2 if np.isfinite(times).any() else 1)
    axes[0].set(xlabel="frame", ylabel="tracking [ms]")
    axes[0].legend(frameon=False)
    axes[1].plot(trace.seconds, trace.megabytes, color="#1b6ca8")
    axes[1].set(xlabel="time of the run [s]", ylabel="resident memory [MB]")
    axes[1].set_ylim(bottom=0)
    axes[2].plot(np.cumsum([bool(state.get("keyframe")) for state in states]), color="#404040")
    axes[2].set(xlabel="frame", ylabel="keyframes so far")
    for one in axes:
        one.grid(color="#e6e6e6", linewidth=0.7)
        for side in ("top", "right"):
            one.spines[side].set_visible(False)
    figure.savefig(file)
    plt.close(figure)


def parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--source", type=Path, default=REPOSITORY / "../shared/data/warehouse_day",
                        help="EuRoC folder to repeat")
    parser.add_argument("--minutes", type=float, default=5)
    parser.add_argument("--rate", type=float, default=10, help="frames a second")
    parser.add_argument("--airslam", type=Path, default=REPOSITORY / "build/bin/airslam")
    parser.add_argument("--out", type=Path, default=REPOSITORY / "out/growth")
    parser.add_argument("--json", type=Path, help="write a record (benchmarks/records.py)")
    parser.add_argument("extra", nargs="*", help="after --: options of `airslam map`")
    return parser.parse_args()


def main() -> int:
    arguments = parse()
    if not arguments.airslam.exists():
        raise SystemExit(f"growth: {arguments.airslam} is missing; run `make build`")
    about = records.conditions()
    arguments.out.mkdir(parents=True, exist_ok=True)
    sequence, result = arguments.out / "sequence", arguments.out / "result"
    make_long_sequence(arguments.source, sequence, round(arguments.minutes * 60 * arguments.rate),
                       arguments.rate)
    log = arguments.out / "map.log"
    trace = run_sampled([str(arguments.airslam), "map", str(sequence), "--out", str(result),
                         *arguments.extra], log)
    if trace.exit_code != 0:
        raise SystemExit(f"growth: airslam map ended with {trace.exit_code}; see {log}")
    report = json.loads((result / "report.json").read_text())
    measured = measure(report, trace, (result / "map.db").stat().st_size)
    text = summarize(measured)
    if arguments.json:
        command = " ".join(["airslam map SEQUENCE --out FOLDER", *arguments.extra])
        records.write(arguments.json, about, command,
                      f"{arguments.source.name} forth and back, {arguments.minutes:g} minutes at "
                      f"{arguments.rate:g} frames/s, without IMU", measured)
    (arguments.out / "growth.md").write_text(text + "\n")
    draw(arguments.out / "growth.png", report, trace)
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
