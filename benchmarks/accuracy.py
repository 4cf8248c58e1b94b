#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Runs `airslam map` on every sequence and prints accuracy and cost as a markdown table.

    .venv/bin/python benchmarks/accuracy.py --root ../shared/data --runs 3 --compare \
        --pages --out out/accuracy

ATE is the RMSE in metres of the body's positions after SE(3) alignment, over every frame of the
trajectory, as `airslam eval` computes it. CPU and memory come from the kernel (wait4) and are of
the whole process. Options after `--` go to `airslam map`.
"""

from __future__ import annotations

import argparse
import json
import os
import shlex
import statistics
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import records

REPOSITORY = Path(__file__).resolve().parent.parent
DEFAULT_SEQUENCES = ["kitti_00_first151", "warehouse_day", "warehouse_dynamic",
                     "euroc_v101_keyframes", "euroc_v101_start"]

PEERS = json.loads((REPOSITORY / "benchmarks/peers.json").read_text())["odometry"]


@dataclass
class Run:
    """One run of `airslam map` on one sequence."""

    sequence: str
    frames: int            # of the sequence
    frames_with_pose: int  # rows of trajectory.tum
    ate: float | None      # metres, trajectory.tum; None without ground truth or result
    ate_online: float | None
    wall_seconds: float
    frames_per_second: float
    cpu_ms: float          # user and system time a frame
    peak_mb: float
    keyframes: int
    components: int
    map_mb: float = 0      # size of map.db
    images_mb: float = 0   # of both images of every frame, uncompressed
    imu: str = ""          # state of the IMU in report.json: "used", or why not
    failure: str = ""


def ground_truth(sequence: Path) -> Path | None:
    """The ground truth file of a sequence folder, if it has one."""
    for candidate in ("mav0/state_groundtruth_estimate0/data.csv", "poses.txt"):
        if (sequence / candidate).exists():
            return sequence / candidate
    return None


def evaluate(airslam: Path, sequence: Path, trajectory: Path) -> dict:
    """What `airslam eval` writes about a trajectory, kept beside it; nothing when it refuses."""
    truth = ground_truth(sequence)
    if truth is None:
        return {}
    answer = trajectory.with_suffix(".eval.json")
    command = [str(airslam), "eval", str(truth), str(trajectory), "--dataset", str(sequence),
               "--json", str(answer)]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    if result.returncode != 0:
        print(f"  {shlex.join(command)}: {result.stderr.strip()}", file=sys.stderr)
        return {}
    return json.loads(answer.read_text())


def run_map(airslam: Path, sequence: Path, out: Path,
            extra: list[str]) -> tuple[int, float, float, float]:
    """Runs `airslam map`: exit code, wall seconds, CPU seconds, peak resident MB."""
    command = [str(airslam), "map", str(sequence), "--out", str(out), *extra]
    out.parent.mkdir(parents=True, exist_ok=True)
    with open(out.with_suffix(".log"), "w") as log:
        start = time.monotonic()
        process = subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT)
        _, status, usage = os.wait4(process.pid, 0)
        wall = time.monotonic() - start
    process.returncode = os.waitstatus_to_exitcode(status)
    return process.returncode, wall, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024


def measure(airslam: Path, sequence: Path, out: Path, extra: list[str]) -> Run:
    """One run with its evaluation."""
    code, wall, cpu, peak = run_map(airslam, sequence, out, extra)
    if code != 0:
        log = out.with_suffix(".log").read_text().strip().splitlines()
        return Run(sequence.name, 0, 0, None, None, wall, 0, 0, peak, 0, 0,
                   failure=f"exit code {code}: {log[-1] if log else ''}")
    report = json.loads((out / "report.json").read_text())
    frames = report["frames"]
    posed = sum(1 for line in (out / "trajectory.tum").read_text().splitlines()
                if line and line[0] != "#")
    info = json.loads(subprocess.run([airslam, "info", out, "--json"], capture_output=True,
                                     check=True).stdout)
    pixels = info["calibration"]["width"] * info["calibration"]["height"]
    ates = [evaluate(airslam, sequence, out / name).get("ate_position_m", {}).get("rmse")
            for name in ("trajectory.tum", "trajectory_online.tum")]
    return Run(sequence.name, frames, posed, ates[0], ates[1], wall, frames / wall,
               1000 * cpu / frames, peak, report["keyframes"], report["components"],
               info["file_bytes"] / 1e6, 2 * frames * pixels / 1e6, report["inertial"]["state"])


def spread(values: list[float | None], digits: int) -> str:
    """Median, and the range where it is not all the same."""
    known = [value for value in values if value is not None]
    if not known:
        return "–"
    text = f"{statistics.median(known):.{digits}f}"
    low, high = f"{min(known):.{digits}f}", f"{max(known):.{digits}f}"
    return text if low == high else f"{text} ({low}–{high})"


def table_row(runs: list[Run], compare: bool) -> list[str]:
    """The cells of one sequence."""
    good = [run for run in runs if not run.failure]
    name = runs[0].sequence
    if not good:
        cells = [name, runs[0].failure] + ["–"] * 7
    else:
        posed = sorted({run.frames_with_pose for run in good})
        tracked = "–".join(str(n) for n in (posed if len(posed) == 1 else (posed[0], posed[-1])))
        cells = [name, f"{tracked}/{good[0].frames}",
                 spread([run.ate for run in good], 4), spread([run.ate_online for run in good], 4),
                 spread([run.wall_seconds for run in good], 1),
                 spread([run.frames_per_second for run in good], 1),
                 spread([run.cpu_ms for run in good], 1),
                 spread([run.peak_mb for run in good], 0),
                 spread([float(run.keyframes) for run in good], 0)]
    if compare:
        peers = PEERS["ATE [m]"].get(name, {})
        cells += [str(peers.get(peer, "–")) for peer in ("ORB-SLAM3", "Basalt")]
    return cells


def markdown(results: dict[str, list[Run]], compare: bool) -> str:
    """The table of all sequences."""
    head = ["sequence", "frames in trajectory", "ATE final [m]", "ATE online [m]", "wall [s]",
            "frames/s", "CPU ms/frame", "peak MB", "keyframes"]
    if compare:
        head += ["ORB-SLAM3 (ATE)", "Basalt (ATE)"]
    return records.markdown(head, [table_row(runs, compare) for runs in results.values()])


def describe(about: dict, command: str, runs: int) -> str:
    """What the numbers hold for: commit, command, machine."""
    changed = " with uncommitted changes in src/ or models/" if about["changed"] else ""
    return "\n".join([
        f"commit {about['commit']}{changed}, {about['date']}",
        f"command: `{command}`, {runs} run(s), median (range)",
        f"machine: {about['machine']}, load average before the start {about['load_before']}",
    ])


def write_page(sequence: Path, result: Path) -> None:
    """The page about one run, report.html in its folder."""
    command = [sys.executable, "-m", "airslam", "report", str(result), "--dataset", str(sequence)]
    subprocess.run(command, check=False, env={**os.environ, "PYTHONPATH": str(REPOSITORY / "build/python")})


def parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--root", type=Path, default=REPOSITORY / "../shared/data",
                        help="folder of the sequences")
    parser.add_argument("--sequences", nargs="+", default=DEFAULT_SEQUENCES)
    parser.add_argument("--runs", type=int, default=1, help="of each sequence")
    parser.add_argument("--airslam", type=Path, default=REPOSITORY / "build/bin/airslam")
    parser.add_argument("--out", type=Path, default=REPOSITORY / "out/accuracy")
    parser.add_argument("--compare", action="store_true", help="columns of the peers")
    parser.add_argument("--pages", action="store_true", help="report.html of each sequence's first run")
    parser.add_argument("--json", type=Path, help="write a record (benchmarks/records.py)")
    parser.add_argument("extra", nargs="*", help="after --: options of `airslam map`")
    return parser.parse_args()


def main() -> int:
    arguments = parse()
    if not arguments.airslam.exists():
        raise SystemExit(f"accuracy: {arguments.airslam} is missing; run `make build`")
    about = records.conditions()
    command = shlex.join(["airslam", "map", "SEQUENCE", "--out", "FOLDER", *arguments.extra])
    results: dict[str, list[Run]] = {}
    for name in arguments.sequences:
        sequence = arguments.root / name
        if not sequence.exists():
            print(f"  {sequence} does not exist: left out", file=sys.stderr)
            continue
        for index in range(arguments.runs):
            out = arguments.out / f"{name}_{index}"
            run = measure(arguments.airslam, sequence, out, arguments.extra)
            results.setdefault(name, []).append(run)
            print(f"  {name} {index + 1}/{arguments.runs}: {run.failure or spread([run.ate], 4)}",
                  file=sys.stderr)
    if not results:
        raise SystemExit(f"accuracy: none of the sequences is in {arguments.root}")
    text = f"{describe(about, command, arguments.runs)}\n\n{markdown(results, arguments.compare)}\n"
    arguments.out.mkdir(parents=True, exist_ok=True)
    (arguments.out / "accuracy.md").write_text(text)
    (arguments.out / "accuracy.json").write_text(json.dumps(
        {name: [asdict(run) for run in runs] for name, runs in results.items()}, indent=2) + "\n")
    if arguments.json:
        records.write(arguments.json, about, command,
                      "ATE: RMSE of the body's positions after SE(3) alignment, every frame of the "
                      "trajectory, no loop closing; CPU and memory of the whole process",
                      {name: [asdict(run) for run in runs] for name, runs in results.items()})
    print(text, end="")
    if arguments.pages:
        for name, runs in results.items():
            if not runs[0].failure and runs[0].frames_with_pose:
                write_page(arguments.root / name, arguments.out / f"{name}_0")
    return 1 if any(run.failure for runs in results.values() for run in runs) else 0


if __name__ == "__main__":
    sys.exit(main())
