#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Maps sequences, locates single images in the maps, and prints recall, errors and cost as markdown.

    .venv/bin/python benchmarks/relocalization.py --root ../shared/data --out out/relocalization \
        [--only night euroc photos] [--refine] [--candidates 3 5 10]

night   map of warehouse_day, queries warehouse_night_queries
euroc   map of three of every four frames of euroc_v101_keyframes (with the IMU), queries the fourth
photos  500 of photos, which show other places, against the map of warehouse_day: none may be located

The world of each component of a map is laid over the ground truth's by SE(3) alignment of its
keyframes; errors are those of the body. A map that lies in --out is used again. With --refine it goes through
`airslam refine` first.
"""

from __future__ import annotations

import argparse
import csv
import re
import sqlite3
import statistics
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

import records

REPOSITORY = Path(__file__).resolve().parent.parent
PROGRAM = REPOSITORY / "build/bin/airslam"
STAGES = ["undistort", "detect", "retrieve", "filter", "verify"]
PHOTOS = 500


@dataclass
class Poses:
    """world_from_body: times in nanoseconds, positions, quaternions x y z w."""

    times: np.ndarray
    positions: np.ndarray
    quaternions: np.ndarray


def read_tum(file: Path) -> Poses:
    rows = [line.split() for line in file.read_text().splitlines() if line and not line.startswith("#")]
    times = np.array([round(float(seconds.split(".")[0])) * 10**9 + int((seconds.split(".") + ["0"])[1][:9].ljust(9, "0"))
                      for seconds, *_ in rows], dtype=np.int64)
    values = np.array([[float(v) for v in row[1:8]] for row in rows]).reshape(-1, 7)
    return Poses(times, values[:, :3], values[:, 3:7])


def read_euroc(file: Path) -> Poses:
    with file.open() as stream:
        rows = [row for row in csv.reader(stream) if row and not row[0].startswith("#")]
    values = np.array([[float(v) for v in row[1:8]] for row in rows])
    return Poses(np.array([int(row[0]) for row in rows], dtype=np.int64), values[:, :3], values[:, [4, 5, 6, 3]])


def at(truth: Poses, times: np.ndarray) -> Poses:
    """Poses at the given times: positions between samples linear, rotations normalised linear (steps are small)."""
    right = np.clip(np.searchsorted(truth.times, times), 1, len(truth.times) - 1)
    left = right - 1
    span = (truth.times[right] - truth.times[left]).astype(float)
    share = np.clip((times - truth.times[left]) / span, 0, 1)[:, None]
    q0, q1 = truth.quaternions[left], truth.quaternions[right]
    q1 = np.where((q0 * q1).sum(1, keepdims=True) < 0, -q1, q1)
    q = (1 - share) * q0 + share * q1
    return Poses(times, (1 - share) * truth.positions[left] + share * truth.positions[right],
                 q / np.linalg.norm(q, axis=1, keepdims=True))


def rotations(quaternions: np.ndarray) -> np.ndarray:
    x, y, z, w = quaternions.T
    return np.stack([np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)], -1),
                     np.stack([2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)], -1),
                     np.stack([2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)], -1)], -2)


def align(source: Poses, target: Poses) -> tuple[np.ndarray, np.ndarray]:
    """R, t with target = R source + t: least squares over positions, of fewer than 10 poses over rotations."""
    a, b = source.positions.mean(0), target.positions.mean(0)
    if len(source.times) >= 10:
        sums = (target.positions - b).T @ (source.positions - a)
    else:
        sums = (rotations(target.quaternions) @ np.swapaxes(rotations(source.quaternions), 1, 2)).sum(0)
    u, _, vt = np.linalg.svd(sums)
    r = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
    return r, b - r @ a


def product(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Of quaternions x y z w, row by row."""
    v, w = p[:, :3], p[:, 3:]
    u, s = q[:, :3], q[:, 3:]
    return np.hstack([w * u + s * v + np.cross(v, u), w * s - (v * u).sum(1, keepdims=True)])


def map_poses(map_file: Path) -> dict[int, Poses]:
    """The body's poses at the keyframes of each component of a map."""
    with sqlite3.connect(f"file:{map_file}?mode=ro", uri=True) as database:
        names = ["qx", "qy", "qz", "qw", "tx", "ty", "tz"]
        body = np.array(database.execute("SELECT " + ", ".join(f"body_from_left_{n}" for n in names)
                                         + " FROM calibration").fetchone())
        rows = database.execute("SELECT component, timestamp_ns, " + ", ".join(names)
                                + " FROM keyframes ORDER BY timestamp_ns").fetchall()
    poses = {}
    for component in sorted({row[0] for row in rows}):
        own = [row[1:] for row in rows if row[0] == component]
        values = np.array([row[1:] for row in own])
        inverse = body[:4] * [-1, -1, -1, 1]  # cam_from_body
        q = product(values[:, :4], np.tile(inverse, (len(own), 1)))
        poses[component] = Poses(np.array([row[0] for row in own], dtype=np.int64),
                                 values[:, 4:] - (rotations(q) @ body[4:]), q)
    return poses


def run(*arguments: str | Path) -> str:
    result = subprocess.run([str(run.program), *map(str, arguments)], capture_output=True, text=True, check=False)
    if result.returncode != 0:
        raise SystemExit(f"airslam {arguments[0]} failed: {result.stderr}")
    return result.stdout


run.program = PROGRAM


def make_map(dataset: Path, out: Path, refine: bool) -> Path:
    """The map file of a dataset."""
    if not (out / "map.db").exists():
        run("map", dataset, "--out", out)
    if not refine:
        return out / "map.db"
    refined = out.with_name(out.name + "_refined.db")
    if not refined.exists():
        run("refine", out / "map.db", "--out", refined)
    return refined


def reduced_euroc(dataset: Path, out: Path) -> tuple[Path, Path]:
    """Folders of links: the dataset without every fourth frame, and the left images of those frames."""
    mapping, queries = out / "euroc_three_of_four", out / "euroc_queries"
    queries.mkdir(parents=True, exist_ok=True)
    for camera in ("cam0", "cam1"):
        folder = mapping / "mav0" / camera
        (folder / "data").mkdir(parents=True, exist_ok=True)
        source = dataset / "mav0" / camera
        rows = [row for row in (source / "data.csv").read_text().splitlines() if row]
        frames = [row for row in rows if not row.startswith("#")]
        kept = [row for i, row in enumerate(frames) if i % 4 != 3]
        (folder / "data.csv").write_text("\n".join([rows[0], *kept]) + "\n")
        link(folder / "sensor.yaml", source / "sensor.yaml")
        for i, row in enumerate(frames):
            name = row.split(",")[1].strip()
            if i % 4 != 3:
                link(folder / "data" / name, source / "data" / name)
            elif camera == "cam0":
                link(queries / name, source / "data" / name)
    link(mapping / "mav0/imu0", dataset / "mav0/imu0")
    return mapping, queries


def link(place: Path, target: Path) -> None:
    if not place.is_symlink():
        place.symlink_to(target.resolve())


@dataclass
class Outcome:
    """What one run of `airslam localize` gave."""

    queries: int
    poses: dict[int, Poses]  # of each component that was met
    per_second: float
    stage_ms: dict[str, list[float]]
    lines: list[str]


POSE = re.compile(r"^(\d+)\.\w+: ([-0-9.]+) ([-0-9.]+) ([-0-9.]+) m, q_xyzw ([-0-9.]+) ([-0-9.]+) ([-0-9.]+) ([-0-9.]+),"
                  r".* keyframe \d+(?: of component (\d+))?;")


def localize(map_file: Path, queries: Path, camera: Path, *options: str) -> Outcome:
    text = run("localize", map_file, queries, "--camera", camera, *options)
    lines = text.splitlines()
    stage_ms = {stage: [float(v) for v in re.findall(rf"\b{stage} ([0-9.]+)", text)] for stage in STAGES}
    per_second = float(re.search(r"([0-9.]+) queries/s", lines[-1])[1])
    found: dict[int, list] = {}
    for match in filter(None, map(POSE.match, lines)):
        found.setdefault(int(match[9] or 0), []).append([int(match[1])] + [float(match[i]) for i in range(2, 9)])
    poses = {}
    for component, rows in found.items():
        values = np.array([row[1:] for row in rows])
        q = values[:, 3:] / np.linalg.norm(values[:, 3:], axis=1, keepdims=True)
        poses[component] = Poses(np.array([row[0] for row in rows], dtype=np.int64), values[:, :3], q)
    return Outcome(len(lines) - 1, poses, per_second, stage_ms, lines[:-1])


def errors(found: Poses, truth: Poses, r: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Metres and degrees of the poses, moved into the truth's world, from the truth at their times."""
    expected = at(truth, found.times)
    metres = np.linalg.norm(found.positions @ r.T + t - expected.positions, axis=1)
    difference = rotations(expected.quaternions) - r @ rotations(found.quaternions)  # Frobenius norm: sqrt(8) sin(angle / 2)
    sines = np.clip(np.linalg.norm(difference, axis=(1, 2)) / np.sqrt(8), 0, 1)
    return metres, np.degrees(2 * np.arcsin(sines))


def report(name: str, map_truth: Poses, truth: Poses, map_file: Path, queries: Path, camera: Path, out: Path,
           candidates: list[int], threads: int) -> list[dict]:
    results = []
    worlds = {component: align(poses, at(map_truth, poses.times)) for component, poses in map_poses(map_file).items()}
    print(f"\n### {name}\n")
    print("| candidates | structure graph | ≤ 0.25 m, 2° | ≤ 2 m, 15° | wrong (> 2 m) | refused | median error | queries/s |"
          " ms: " + " / ".join(STAGES) + " |")
    print("|---|---|---|---|---|---|---|---|---|")
    for count in candidates:
        for graph in (True, False):
            options = ["--candidates", str(count), "--threads", str(threads)] + ([] if graph else ["--no-structure-graph"])
            outcome = localize(map_file, queries, camera, *options)
            (out / f"{name}_{count}_{'graph' if graph else 'words'}.txt").write_text("\n".join(outcome.lines) + "\n")
            both = [errors(poses, truth, *worlds[component]) for component, poses in outcome.poses.items()]
            metres = np.concatenate([m for m, _ in both] or [np.zeros(0)])
            degrees = np.concatenate([d for _, d in both] or [np.zeros(0)])
            near = int(((metres <= 0.25) & (degrees <= 2)).sum())
            far = int(((metres <= 2) & (degrees <= 15)).sum())
            n = outcome.queries
            stage_ms = {stage: statistics.median(outcome.stage_ms[stage]) for stage in STAGES}
            results.append({"candidates": count, "structure_graph": graph, "queries": n, "near": near, "far": far,
                            "wrong": int((metres > 2).sum()), "refused": n - len(metres),
                            "median_m": float(np.median(metres)) if len(metres) else None,
                            "median_deg": float(np.median(degrees)) if len(metres) else None,
                            "queries_per_second": outcome.per_second, "stage_ms": stage_ms})
            median = f"{np.median(metres):.3f} m, {np.median(degrees):.2f}°" if len(metres) else "–"
            stages = " / ".join(f"{ms:.2f}" for ms in stage_ms.values())
            print(f"| {count} | {'yes' if graph else 'no'} | {near / n:.1%} | {far / n:.1%} | {int((metres > 2).sum())} |"
                  f" {n - len(metres)} | {median} | {outcome.per_second:.1f} | {stages} |", flush=True)
    return results


def night(root: Path, out: Path, options: argparse.Namespace) -> list[dict]:
    map_file = make_map(root / "warehouse_day", out / "warehouse_day", options.refine)
    queries = root / "warehouse_night_queries"
    return report("night", read_euroc(root / "warehouse_day/mav0/state_groundtruth_estimate0/data.csv"),
                  read_tum(queries / "poses.tum"), map_file, queries / "data", queries / "sensor.yaml", out,
                  options.candidates, options.threads)


def euroc(root: Path, out: Path, options: argparse.Namespace) -> list[dict]:
    dataset = root / "euroc_v101_keyframes"
    mapping, queries = reduced_euroc(dataset, out)
    map_file = make_map(mapping, out / "euroc", options.refine)
    truth = read_euroc(dataset / "mav0/state_groundtruth_estimate0/data.csv")
    return report("euroc", truth, truth, map_file, queries, dataset / "mav0/cam0/sensor.yaml", out, options.candidates,
                  options.threads)


def photos(root: Path, out: Path, options: argparse.Namespace) -> dict:
    """Photos, cut and scaled to the size of the warehouse's images, as if seen by a camera without distortion."""
    map_file = make_map(root / "warehouse_day", out / "warehouse_day", options.refine)
    folder = out / "photos"
    folder.mkdir(exist_ok=True)
    files = sorted((root / "photos").glob("*.jpg"))
    for file in files[:: max(1, len(files) // PHOTOS)][:PHOTOS]:
        place = folder / f"{file.stem}.png"
        if place.exists():
            continue
        image = Image.open(file).convert("L")
        scale = max(752 / image.width, 480 / image.height)
        image = image.resize((int(np.ceil(image.width * scale)), int(np.ceil(image.height * scale))), Image.BICUBIC)
        left, top = (image.width - 752) // 2, (image.height - 480) // 2
        image.crop((left, top, left + 752, top + 480)).save(place)
    camera = out / "photo_camera.yaml"
    camera.write_text("resolution: [752, 480]\nintrinsics: [458.654, 457.296, 367.215, 248.375]\ndistortion_model: none\n")
    outcome = localize(map_file, folder, camera, "--threads", str(options.threads))
    (out / "photos.txt").write_text("\n".join(outcome.lines) + "\n")
    inliers = [int(m[1]) for m in (re.search(r"refused at verify: (\d+) of", line) for line in outcome.lines) if m]
    located = sum(len(p.times) for p in outcome.poses.values())
    print(f"\n### photos\n\n{located} of {outcome.queries} located (must be 0); largest number of inliers"
          f" of a refusal: {max(inliers)}")
    return {"queries": outcome.queries, "located": located, "most_inliers": max(inliers)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--root", type=Path, default=REPOSITORY.parent / "shared/data")
    parser.add_argument("--out", type=Path, default=REPOSITORY / "out/relocalization")
    parser.add_argument("--only", nargs="+", default=["night", "euroc", "photos"])
    parser.add_argument("--candidates", nargs="+", type=int, default=[3, 5, 10])
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--program", type=Path, default=PROGRAM)
    parser.add_argument("--refine", action="store_true")
    parser.add_argument("--json", type=Path, help="write a record (benchmarks/records.py)")
    options = parser.parse_args()
    about = records.conditions()
    run.program = options.program
    options.out.mkdir(parents=True, exist_ok=True)
    results = {name: {"night": night, "euroc": euroc, "photos": photos}[name](options.root, options.out, options)
               for name in options.only}
    if options.json:
        refined = ", airslam refine" if options.refine else ""
        records.write(options.json, about, f"airslam map{refined}, airslam localize --threads {options.threads}",
                      "night: map of warehouse_day, queries warehouse_night_queries; euroc: map of three of every four "
                      "frames of euroc_v101_keyframes, queries the fourth; photos: of other places, none may be located; "
                      "each component of a map aligned to the ground truth by its keyframes", results)


if __name__ == "__main__":
    main()
