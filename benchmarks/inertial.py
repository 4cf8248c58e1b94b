#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""What the IMU gives: ATE beside stereo alone, gravity, biases and velocities against the truth,
and the position's error after a blackout. Needs EuRoC folders with ground truth.

    .venv/bin/python benchmarks/inertial.py ../shared/data/warehouse_day --blackout-at 12

Gravity: angle between up as the estimate has it and as the truth has it, seen from the body, mean of
all frames. Blackout: images replaced by black ones; the error is that of the motion from the last
frame before it to its last frame, as first estimated and in the end.
"""

from __future__ import annotations

import argparse
import json
import re
import sqlite3
import struct
import subprocess
import tempfile
import zlib
from pathlib import Path

import numpy as np

import records

REPOSITORY = Path(__file__).resolve().parent.parent


def black_png(width: int, height: int) -> bytes:
    def chunk(name: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header)
            + chunk(b"IDAT", zlib.compress(bytes(width + 1) * height)) + chunk(b"IEND", b""))


def with_blackout(sequence: Path, folder: Path, begin: float, seconds: float) -> None:
    """A copy of links in which the images of a stretch are black."""
    mav0 = sequence / "mav0"
    for part in mav0.iterdir():
        target = folder / "mav0" / part.name
        if part.name not in ("cam0", "cam1"):
            target.parent.mkdir(parents=True, exist_ok=True)
            target.symlink_to(part.resolve())
            continue
        (target / "data").mkdir(parents=True)
        for file in ("sensor.yaml", "data.csv"):
            (target / file).symlink_to((part / file).resolve())
        found = re.search(r"resolution:\s*\[(\d+),\s*(\d+)\]", (part / "sensor.yaml").read_text())
        size = int(found[1]), int(found[2])
        lines = [line.strip().split(",") for line in open(part / "data.csv") if line[0] != "#"]
        for time, name in lines:
            source = part / "data" / name
            if begin <= 1e-9 * (int(time) - int(lines[0][0])) < begin + seconds:
                (target / "data" / name).write_bytes(black_png(*size))
            else:
                (target / "data" / name).symlink_to(source.resolve())


def rotations(q: np.ndarray) -> np.ndarray:
    """Matrices of rows (x, y, z, w)."""
    x, y, z, w = (q / np.linalg.norm(q, axis=1, keepdims=True)).T
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]
                    ).transpose(2, 0, 1)


class Truth:
    def __init__(self, sequence: Path):
        file = sequence / "mav0/state_groundtruth_estimate0/data.csv"
        self.file = file
        self.rows = np.loadtxt(file, delimiter=",", comments="#")
        self.times = np.array([int(line.split(",")[0]) for line in open(file) if line[0] != "#"])
        self.rotation = rotations(self.rows[:, [5, 6, 7, 4]])

    def at(self, times: np.ndarray) -> np.ndarray:
        return np.array([int(np.argmin(abs(self.times - t))) for t in times])


def read_tum(file: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times in nanoseconds, positions, rotations."""
    rows = [line.split() for line in open(file)]
    times = [int(r[0].split(".")[0]) * 10**9 + int((r[0].split(".")[1] + "0" * 9)[:9]) for r in rows]
    values = np.array([[float(x) for x in r[1:]] for r in rows])
    return np.array(times), values[:, :3], rotations(values[:, 3:])


def run(airslam: Path, sequence: Path, out: Path, *arguments: str) -> dict:
    subprocess.run([airslam, "map", sequence, "--out", out, *arguments], check=True,
                   capture_output=True)
    return json.loads((out / "report.json").read_text())


def ate(airslam: Path, truth: Truth, out: Path) -> float:
    answer = out / "eval.json"
    subprocess.run([airslam, "eval", truth.file, out / "trajectory.tum", "--json", answer],
                   check=True, capture_output=True)
    return json.loads(answer.read_text())["ate_position_m"]["rmse"]


def states(truth: Truth, out: Path, report: dict) -> dict:
    """How far gravity, biases and speed are from the truth; why the IMU was not used, if so."""
    inertial = report["inertial"]
    if inertial["state"] != "used":
        return {"state": inertial["state"], "reason": inertial["reason"]}
    times, _, rotation = read_tum(out / "trajectory.tum")
    index = truth.at(times)
    cosine = np.clip((rotation[:, 2, :] * truth.rotation[index][:, 2, :]).sum(1), -1, 1)
    gyroscope, accelerometer, velocity = [], [], []
    for time, blob in sqlite3.connect(out / "map.db").execute(
            "SELECT timestamp_ns, inertial_state FROM keyframes WHERE inertial_state NOT NULL"):
        state, row = np.frombuffer(blob, "<f8"), truth.rows[truth.at([time])[0]]
        gyroscope.append(np.linalg.norm(state[3:6] - row[11:14]))
        accelerometer.append(np.linalg.norm(state[6:9] - row[14:17]))
        velocity.append(abs(np.linalg.norm(state[:3]) - np.linalg.norm(row[8:11])))
    return {"state": "used", "initialised_after_s": inertial["starts"][0]["seconds"],
            "gravity_deg": float(np.degrees(np.arccos(cosine)).mean()),
            "gyroscope_rad_s": float(max(gyroscope)),
            "accelerometer_m_s2": float(max(accelerometer)),
            "speed_rms_m_s": float(np.sqrt(np.mean(np.square(velocity))))}


def print_states(result: dict) -> None:
    if result["state"] != "used":
        print(f"  IMU not used: {result['state']}: {result['reason']}")
        return
    print(f"  initialised after {result['initialised_after_s']:.1f} s, gravity "
          f"{result['gravity_deg']:.3f} deg, at keyframes: gyroscope bias "
          f"{result['gyroscope_rad_s']:.5f} rad/s, accelerometer bias "
          f"{result['accelerometer_m_s2']:.3f} m/s^2 (largest), "
          f"speed {result['speed_rms_m_s']:.4f} m/s (rms)")


def blackout_error(truth: Truth, file: Path, begin: float, seconds: float) -> float:
    times, position, rotation = read_tum(file)
    passed = 1e-9 * (times - times[0])
    before = np.flatnonzero(passed < begin)[-1]
    last = np.flatnonzero(passed < begin + seconds)[-1]
    i, j = truth.at(times[[before, last]])
    moved = rotation[before].T @ (position[last] - position[before])
    really = truth.rotation[i].T @ (truth.rows[j, 1:4] - truth.rows[i, 1:4])
    return float(np.linalg.norm(moved - really))


def blackout(airslam: Path, sequence: Path, truth: Truth, folder: Path, begin: float,
             seconds: float, extra: list[str]) -> dict:
    dark, result = folder / f"dark{seconds}", folder / f"result{seconds}"
    with_blackout(sequence, dark, begin, seconds)
    report = run(airslam, dark, result, *extra)
    online, final = (blackout_error(truth, result / name, begin, seconds)
                     for name in ("trajectory_online.tum", "trajectory.tum"))
    return {"seconds": seconds, "online_m": online, "final_m": final,
            "frames_inertial": report["frames_inertial"],
            "frames_without_pose": report["frames"] - report["frames_with_pose"]}


def measure(sequence: Path, arguments: argparse.Namespace) -> dict:
    """Stereo beside stereo with IMU, and the blackouts that were asked for."""
    truth, airslam = Truth(sequence), arguments.airslam
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        run(airslam, sequence, out / "stereo", "--no-imu", *arguments.extra)
        report = run(airslam, sequence, out / "imu", *arguments.extra)
        result = {"frames": report["frames"], "frames_in_trajectory": report["frames_in_trajectory"],
                  "ate_stereo_m": ate(airslam, truth, out / "stereo"),
                  "ate_imu_m": ate(airslam, truth, out / "imu"),
                  "states": states(truth, out / "imu", report), "blackouts": []}
        print(f"{sequence.name}: ATE {result['ate_stereo_m']:.4f} m stereo, "
              f"{result['ate_imu_m']:.4f} m with the IMU")
        print_states(result["states"])
        for seconds in arguments.blackouts if arguments.blackout_at is not None else []:
            dark = blackout(airslam, sequence, truth, out, arguments.blackout_at, seconds,
                            arguments.extra)
            result["blackouts"].append(dark)
            print(f"  black for {seconds} s: {dark['online_m']:.4f} m at its end, "
                  f"{dark['final_m']:.4f} m finally; {dark['frames_inertial']} frames by the IMU, "
                  f"{dark['frames_without_pose']} without a pose")
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("sequences", nargs="+", type=Path)
    parser.add_argument("--airslam", type=Path, default=REPOSITORY / "build/bin/airslam")
    parser.add_argument("--blackout-at", type=float, help="seconds from the first frame")
    parser.add_argument("--blackouts", type=float, nargs="*", default=[0.5, 1, 2, 4])
    parser.add_argument("--no-lines", dest="extra", action="store_const", const=["--no-lines"],
                        default=[], help="map without lines")
    parser.add_argument("--json", type=Path, help="write a record (benchmarks/records.py)")
    arguments = parser.parse_args()
    about = records.conditions()
    results = {sequence.name: measure(sequence, arguments) for sequence in arguments.sequences}
    if arguments.json:
        at = f"; images black from {arguments.blackout_at:g} s on" if arguments.blackout_at else ""
        records.write(arguments.json, about,
                      " ".join(["airslam map SEQUENCE --out FOLDER", *arguments.extra]),
                      "ATE: RMSE of the body after SE(3) alignment, all frames; gravity: mean angle "
                      "over all frames; biases: the largest error at any keyframe" + at, results)


if __name__ == "__main__":
    main()
