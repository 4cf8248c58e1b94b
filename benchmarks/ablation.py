#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""What lines give, free of chance: `airslam map` with and without them at several numbers of keypoints.

    .venv/bin/python benchmarks/ablation.py --root ../shared/data [--keypoints 400 350 300]

One run says little: another number of keypoints alone changes the error of one sequence by up to a
third. So each number is a pair of runs, and of all pairs of a sequence the geometric mean of
ATE with lines / ATE without is taken (below 1: lines help).
"""

from __future__ import annotations

import argparse
import math
import statistics
import sys
from pathlib import Path

import accuracy
import records

SEQUENCES = [name for name in accuracy.DEFAULT_SEQUENCES if name != "euroc_v101_start"]
MODES = {"stereo": ["--no-imu"], "imu": []}
COMMAND = "airslam map SEQUENCE --out FOLDER --config KEYPOINTS.yaml [--no-imu] [--no-lines]"


def pair(airslam: Path, sequence: Path, out: Path, keypoints: int, extra: list[str]) -> dict | None:
    """ATE and poses without and with lines; nothing where a run failed or there is no ground truth."""
    out.mkdir(parents=True, exist_ok=True)
    config = out / f"{keypoints}.yaml"
    config.write_text(f"max_keypoints: {keypoints}\n")
    row: dict = {"keypoints": keypoints}
    for kind, lines in (("points", ["--no-lines"]), ("lines", [])):
        run = accuracy.measure(airslam, sequence, out / kind,
                               ["--config", str(config), *extra, *lines])
        if run.failure or run.ate is None:
            print(f"  {sequence.name} {keypoints} {kind}: {run.failure or 'no ATE'}", file=sys.stderr)
            return None
        row |= {kind: run.ate, f"{kind}_poses": run.frames_with_pose, "imu": run.imu}
    return row


def mean_ratio(rows: list[dict]) -> float | None:
    """Geometric mean of ATE with lines / without, over pairs that track the same number of frames."""
    logs = [math.log(row["lines"] / row["points"]) for row in rows
            if row["lines_poses"] == row["points_poses"]]
    return math.exp(statistics.mean(logs)) if logs else None


def parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--root", type=Path, default=records.REPOSITORY / "../shared/data",
                        help="folder of the sequences")
    parser.add_argument("--sequences", nargs="+", default=SEQUENCES)
    parser.add_argument("--keypoints", nargs="+", type=int, default=[400, 350, 300])
    parser.add_argument("--airslam", type=Path, default=records.REPOSITORY / "build/bin/airslam")
    parser.add_argument("--out", type=Path, default=records.REPOSITORY / "out/ablation")
    parser.add_argument("--json", type=Path, help="write a record (benchmarks/records.py)")
    return parser.parse_args()


def main() -> int:
    arguments = parse()
    about = records.conditions()
    results: dict[str, dict[str, list[dict]]] = {}
    for name in arguments.sequences:
        sequence = arguments.root / name
        if not sequence.exists():
            print(f"  {sequence} does not exist: left out", file=sys.stderr)
            continue
        for mode, extra in MODES.items():
            pairs = [pair(arguments.airslam, sequence, arguments.out, n, extra)
                     for n in arguments.keypoints]
            rows = [row for row in pairs if row and (mode == "stereo" or row["imu"] == "used")]
            if not rows:
                continue
            results.setdefault(name, {})[mode] = rows
            ratio = mean_ratio(rows)
            print(f"{name}, {mode}: {'–' if ratio is None else f'{ratio:.3f}'} of "
                  + ", ".join(f"{r['keypoints']}: {r['points']:.4f} → {r['lines']:.4f} "
                              f"({r['points_poses']}, {r['lines_poses']} poses)" for r in rows),
                  flush=True)
    if not results:
        raise SystemExit(f"ablation: none of the sequences is in {arguments.root}")
    if arguments.json:
        records.write(arguments.json, about, COMMAND,
                      "ATE with lines / ATE without, geometric mean over the numbers of keypoints at "
                      "which both track the same frames", results)
    return 0


if __name__ == "__main__":
    sys.exit(main())
