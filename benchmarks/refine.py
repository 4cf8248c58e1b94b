#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Maps and refines sequences: ATE of keyframes before and after, loops checked against the truth.

    .venv/bin/python benchmarks/refine.py ../shared/data/warehouse_day ../shared/data/euroc_v101_keyframes \
        --out out/refine

Each sequence is mapped with and, where it has one, without its IMU. ATE is the RMSE in metres of the
keyframes' body after SE(3) alignment, as `airslam eval` computes it. A loop is false when its relative
pose is more than half a metre or 5 degrees from the truth's. Prints a markdown table.
"""

from __future__ import annotations

import argparse
import json
import subprocess
from pathlib import Path

import numpy as np

import records

REPOSITORY = Path(__file__).resolve().parent.parent
FALSE_METRES, FALSE_DEGREES = 0.5, 5.0


def matrix(position: np.ndarray, xyzw: np.ndarray) -> np.ndarray:
    """The 4 x 4 transform of a position and a quaternion."""
    x, y, z, w = xyzw / np.linalg.norm(xyzw)
    result = np.eye(4)
    result[:3, :3] = [[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                      [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                      [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]
    result[:3, 3] = position
    return result


class Truth:
    """world_from_body of a EuRoC or KITTI folder."""

    def __init__(self, sequence: Path):
        euroc = sequence / "mav0/state_groundtruth_estimate0/data.csv"
        if euroc.exists():
            self.file = euroc
            rows = [line.split(",") for line in open(euroc) if line[0] != "#"]
            self.times = np.array([int(row[0]) for row in rows])
            values = np.array([[float(x) for x in row[1:8]] for row in rows])
            self.poses = [matrix(v[:3], v[[4, 5, 6, 3]]) for v in values]
        else:
            self.file = sequence / "poses.txt"
            self.times = np.round(1e9 * np.loadtxt(sequence / "times.txt")).astype(np.int64)
            self.poses = [np.vstack([m, [0, 0, 0, 1]])
                          for m in np.loadtxt(self.file).reshape(-1, 3, 4)]

    def at(self, time: int) -> np.ndarray:
        return self.poses[int(np.argmin(abs(self.times - time)))]


def false_loops(truth: Truth, airslam: Path, map_file: Path, loops: list) -> tuple[int, float]:
    """How many loops are false, and the largest error of the others in metres."""
    info = json.loads(subprocess.run([airslam, "info", map_file, "--json"], check=True,
                                     capture_output=True).stdout)
    mount = info["calibration"]["body_from_left"]
    body_from_cam = matrix(np.array(mount["translation_m"]), np.array(mount["quaternion_xyzw"]))
    false, largest = 0, 0.0
    for loop in loops:
        earlier, later = (truth.at(loop[k]) @ body_from_cam
                          for k in ("earlier_timestamp_ns", "later_timestamp_ns"))
        pose = loop["earlier_from_later"]
        found = matrix(np.array(pose["translation_m"]), np.array(pose["quaternion_xyzw"]))
        error = np.linalg.inv(np.linalg.inv(earlier) @ later) @ found
        metres = np.linalg.norm(error[:3, 3])
        degrees = np.degrees(np.arccos(np.clip((np.trace(error[:3, :3]) - 1) / 2, -1, 1)))
        if metres > FALSE_METRES or degrees > FALSE_DEGREES:
            false += 1
            print(f"  false: {loop['earlier']} {loop['later']}: {metres:.2f} m, {degrees:.1f} deg")
        else:
            largest = max(largest, metres)
    return false, largest


def evaluate(airslam: Path, truth: Truth, map_file: Path) -> dict:
    poses, answer = map_file.with_suffix(".tum"), map_file.with_suffix(".json")
    subprocess.run([airslam, "export", map_file, "--tum", poses], check=True, capture_output=True)
    subprocess.run([airslam, "eval", truth.file, poses, "--json", answer], check=True,
                   capture_output=True)
    return json.loads(answer.read_text())


def refine(airslam: Path, sequence: Path, out: Path, arguments: list[str], model: list[str],
           name: str) -> dict:
    """Maps and refines one sequence."""
    truth = Truth(sequence)
    subprocess.run([airslam, "map", sequence, "--out", out / "map", *arguments, *model], check=True,
                   capture_output=True)
    refined, report_file = out / "refined.db", out / "report.json"
    subprocess.run([airslam, "refine", out / "map/map.db", "--out", refined, "--report",
                    report_file, *model], check=True, capture_output=True)
    report = json.loads(report_file.read_text())
    before = evaluate(airslam, truth, out / "map/map.db")
    after = evaluate(airslam, truth, refined)
    loops = next((s.get("loops", []) for s in report["steps"] if s["name"] == "loop_closure"), [])
    false, largest = false_loops(truth, airslam, refined, loops)
    return {"name": name, "keyframes": report["after"]["keyframes"],
            "path_m": before["path_length_m"], "before_m": before["ate_position_m"]["rmse"],
            "after_m": after["ate_position_m"]["rmse"], "loops": len(loops), "false": false,
            "largest_loop_error_m": float(largest),
            "seconds": {step["name"]: step["seconds"] for step in report["steps"]},
            "peak_mib": report["memory_peak_mib"]}


def row(result: dict) -> str:
    """One row of the table."""
    times = ", ".join(f"{seconds:.1f}" for seconds in result["seconds"].values())
    return (f"| {result['name']} | {result['keyframes']} | {result['path_m']:.1f} | "
            f"{result['before_m']:.4f} | {result['after_m']:.4f} | "
            f"{100 * result['after_m'] / result['path_m']:.2f} | {result['loops']} | "
            f"{result['false']} | {result['largest_loop_error_m']:.3f} | "
            f"{times} | {result['peak_mib']:.0f} |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("sequences", nargs="+", type=Path)
    parser.add_argument("--out", type=Path, default=REPOSITORY / "out/refine")
    parser.add_argument("--model", help="model pack: a name or a folder")
    parser.add_argument("--airslam", type=Path, default=REPOSITORY / "build/bin/airslam")
    parser.add_argument("--json", type=Path, help="write a record (benchmarks/records.py)")
    arguments = parser.parse_args()
    about = records.conditions()
    results = []
    for sequence in arguments.sequences:
        modes = [("stereo", ["--no-imu"])]
        if (sequence / "mav0/imu0").exists():
            modes.append(("IMU", []))
        model = ["--model", arguments.model] if arguments.model else []
        for mode, options in modes:
            out = arguments.out / f"{sequence.name}_{mode}"
            out.mkdir(parents=True, exist_ok=True)
            results.append(refine(arguments.airslam, sequence, out, options, model,
                                  f"{sequence.name}, {mode}"))
            print(row(results[-1]), flush=True)
    print("| sequence | keyframes | path, m | ATE before, m | after, m | after, % of path | loops | "
          "false | largest loop error, m | seconds a step | peak, MiB |")
    print("|" + "---|" * 11)
    print("\n".join(map(row, results)))
    if arguments.json:
        records.write(arguments.json, about, "airslam map [--no-imu], airslam refine",
                      "RMSE of keyframe positions after SE(3) alignment, before and after; a loop is "
                      "false when half a metre or 5 degrees from the truth's relative pose", results)


if __name__ == "__main__":
    main()
