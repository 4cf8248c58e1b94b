#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Runs every benchmark and writes its record to benchmarks/results/, then docs/benchmarks.md.

    .venv/bin/python benchmarks/run_all.py --root ../shared/data [--only odometry inertial ...]

Takes about a quarter of an hour on two idle cores. A record that is not run again stays as it is: each says
for itself on which commit, machine and date it was made.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import records
import render

REPOSITORY = records.REPOSITORY
RUNS = 3  # of each sequence and mode: equal results, but times of a machine with others on it
# Arguments of `airslam map` for each mode of the odometry.
MODES = {
    "odometry_stereo_points": ["--no-imu", "--no-lines"],
    "odometry_stereo_lines": ["--no-imu"],
    "odometry_imu_points": ["--no-lines"],
    "odometry_imu_lines": [],
}


def commands(root: Path, out: Path, airslam: Path, minutes: float) -> dict[str, list[list[str]]]:
    """The commands of each group, in the order in which they run."""
    day, dynamic = root / "warehouse_day", root / "warehouse_dynamic"
    euroc, kitti = root / "euroc_v101_keyframes", root / "kitti_00_first151"

    def program(script: str, record: str, *arguments: object) -> list[str]:
        return [sys.executable, str(REPOSITORY / "benchmarks" / script), "--json",
                str(records.RESULTS / f"{record}.json"), *map(str, arguments)]

    return {
        "odometry": [program("accuracy.py", name, "--runs", RUNS, "--root", root, "--airslam",
                             airslam, "--out", out / name, "--sequences", kitti.name, day.name,
                             dynamic.name, euroc.name, "--", *extra)
                     for name, extra in MODES.items()],
        "inertial": [program("inertial.py", "inertial", "--airslam", airslam, day, dynamic,
                             "--blackout-at", 12),
                     program("inertial.py", "inertial_euroc", "--airslam", airslam,
                             root / "euroc_v101_start", euroc)],
        "ablation": [program("ablation.py", "ablation", "--root", root, "--airslam", airslam, "--out",
                             out / "ablation")],
        "light": [program("lines.py", "light", "--airslam", airslam, day, dynamic)],
        "refine": [program("refine.py", "refine", "--airslam", airslam, "--out", out / "refine",
                           day, dynamic, kitti, euroc)],
        "relocalization": [program("relocalization.py", "relocalization", "--program", airslam,
                                   "--root", root, "--out", out / "relocalization", "--refine")],
        "growth": [program("growth.py", "growth", "--airslam", airslam, "--source", day, "--out",
                           out / "growth", "--minutes", minutes)],
        "refine_growth": refine_growth(program),
    }


def refine_growth(program: Callable) -> list[list[str]]:
    """The C++ program that `make bench` builds, where that was done."""
    build = REPOSITORY / "build-bench"
    if not (build / "build.ninja").exists():
        print("run_all: refine_growth is left out, its record is the old one: run `make bench`")
        return []
    return [["ninja", "-C", str(build), "refine_growth"],
            program("record_table.py", "refine_growth", "--protocol",
                    "Maps of 1, 4 and 16 copies of a simulated building; the query without network",
                    build / "bin/refine_growth", 1, 4, 16)]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--root", type=Path, default=REPOSITORY / "../shared/data",
                        help="folder of the sequences")
    parser.add_argument("--only", nargs="+", help="odometry inertial ablation light refine relocalization "
                                                  "growth refine_growth; all if not given")
    parser.add_argument("--airslam", type=Path, default=REPOSITORY / "build/bin/airslam")
    parser.add_argument("--out", type=Path, default=REPOSITORY / "out/benchmarks",
                        help="emptied first: folder of maps, logs and tables")
    parser.add_argument("--minutes", type=float, default=5, help="length of the growth run")
    arguments = parser.parse_args()
    groups = commands(arguments.root.resolve(), arguments.out.resolve(),
                      arguments.airslam.resolve(), arguments.minutes)
    unknown = sorted(set(arguments.only or []) - set(groups))
    if unknown:
        parser.error(f"no benchmark {unknown[0]}; there are: {', '.join(groups)}")
    shutil.rmtree(arguments.out, ignore_errors=True)  # maps are used again where they lie
    failed = []
    for name in arguments.only or groups:
        for command in groups[name]:
            start = time.monotonic()
            print(f"== {name}: {' '.join(command[1:])}", flush=True)
            if subprocess.run(command, check=False).returncode != 0:
                failed.append(name)
            print(f"   {time.monotonic() - start:.0f} s", flush=True)
    render.PAGE.write_text(render.page())
    print(f"{render.PAGE.relative_to(REPOSITORY)} is written")
    for name in failed:
        print(f"run_all: {name} failed: its record is the old one", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
