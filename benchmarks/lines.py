#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Lines under changing light: how many of one image are found again in another of the same pose.

    python benchmarks/lines.py ../shared/data/warehouse_day ../shared/data/warehouse_dynamic

Both folders are EuRoC sequences along the same path: frame i of one has the pose of frame i of the
other. Beside PLNet stands OpenCV's LSD with as many lines, its longest (needs cv2; without it PLNet
alone is measured). A line is found again when both of its ends lie within 5 pixels of those of one
line, and, less strictly, when both lie within 5 pixels of such a line that covers half of it. Lines
are matched by the points that they share (feature/line_matching.h, here over), and a match is right
when the two lines satisfy the less strict rule. LSD has no such matches: its companion, the LBD
descriptor, is not in OpenCV 4.6 and 5.0 without contrib, and is left out.
"""

from __future__ import annotations

import argparse
import subprocess
import tempfile
from pathlib import Path

import numpy as np

import records

try:
    import cv2
except ImportError:
    cv2 = None

REPOSITORY = Path(__file__).resolve().parent.parent
RADIUS = 5.0  # pixels


def images(sequence: Path) -> list[Path]:
    rows = [line.strip().split(",") for line in open(sequence / "mav0/cam0/data.csv")]
    return [sequence / "mav0/cam0/data" / row[1].strip() for row in rows if row[0][0] != "#"]


def run(*arguments: object) -> None:
    subprocess.run([run.program, *map(str, arguments)], check=True, stdout=subprocess.DEVNULL)


run.program = REPOSITORY / "build/bin/airslam"


def table(file: Path, columns: int) -> np.ndarray:
    lines = (line for line in file.read_text().splitlines() if line and line[0] not in "#x")
    rows = [[float(value) for value in line.split(",")][:columns] for line in lines]
    return np.array(rows).reshape(-1, columns)


def detect(pictures: tuple[Path, ...], folder: Path,
           min_score: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Lines (n, 4) and keypoints (k, 2) of each picture."""
    folder.mkdir()
    for number, picture in enumerate(pictures):
        (folder / f"{number:05d}{picture.suffix}").symlink_to(picture.resolve())
    out = folder.with_name(folder.name + "_found")
    run("detect", folder, "--out", out, "--line-scale", "1")  # the lines that mapping sees
    result = []
    for number in range(len(pictures)):
        lines = table(out / f"{number:05d}.lines.csv", 5)
        points = table(out / f"{number:05d}.keypoints.csv", 2)
        result.append((lines[lines[:, 4] >= min_score][:, :4], points))
    return result


def lsd(image: Path, count: int) -> np.ndarray:
    found = cv2.createLineSegmentDetector().detect(cv2.imread(str(image), cv2.IMREAD_GRAYSCALE))[0]
    lines = np.empty((0, 4)) if found is None else found.reshape(-1, 4)
    length = np.hypot(lines[:, 2] - lines[:, 0], lines[:, 3] - lines[:, 1])
    return lines[np.argsort(-length, kind="stable")[:count]]


def same_ends(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(n, m): whether both ends of a line of `a` lie near those of one of `b`, either way round."""
    def far(p: np.ndarray, q: np.ndarray) -> np.ndarray:
        return np.linalg.norm(p[:, None] - q[None], axis=2)
    straight = np.maximum(far(a[:, :2], b[:, :2]), far(a[:, 2:], b[:, 2:]))
    turned = np.maximum(far(a[:, :2], b[:, 2:]), far(a[:, 2:], b[:, :2]))
    return np.minimum(straight, turned) < RADIUS


def same_line(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(n, m): whether both ends of `a` lie near the endless line of `b`, half of it beside it."""
    start, along = b[:, :2], b[:, 2:] - b[:, :2]
    length = np.maximum(np.linalg.norm(along, axis=1), 1e-9)
    along = along / length[:, None]
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    offsets = np.stack([a[:, :2], a[:, 2:]])[:, :, None] - start[None, None]  # end, n, m, 2
    near = (np.abs((offsets * across).sum(-1)) < RADIUS).all(axis=0)
    places = np.sort((offsets * along).sum(-1), axis=0)
    covered = np.minimum(places[1], length) - np.maximum(places[0], 0)
    return near & (covered >= 0.5 * (places[1] - places[0]))


def owners(points: np.ndarray, lines: np.ndarray) -> np.ndarray:
    """(points, lines): which points belong to which lines (paper, section V-B)."""
    along = lines[:, 2:] - lines[:, :2]
    along = along / np.maximum(np.linalg.norm(along, axis=1), 1e-9)[:, None]
    offset = points[:, None] - lines[None, :, :2]
    distance = np.abs(offset[..., 0] * -along[:, 1] + offset[..., 1] * along[:, 0])
    low, high = np.minimum(lines[:, :2], lines[:, 2:]), np.maximum(lines[:, :2], lines[:, 2:])
    between = ((points[:, None] >= low) & (points[:, None] <= high)).any(-1)
    return (distance < 3) & between


def match(pairs: np.ndarray, lines0: np.ndarray, lines1: np.ndarray, all0: np.ndarray,
          all1: np.ndarray) -> list[tuple[int, int]]:
    """One to one, most shared points first, where S > 0.3 and more than one point is shared."""
    shared = owners(pairs[:, :2], lines0).T.astype(int) @ owners(pairs[:, 2:], lines1).astype(int)
    count = np.minimum(owners(all0, lines0).sum(0)[:, None], owners(all1, lines1).sum(0)[None])
    score = shared / np.maximum(count, 1)
    order = sorted((-shared[m, n], -score[m, n], m, n) for m, n in np.argwhere(
        (shared > 1) & (score > 0.3)))
    taken0, taken1, matches = set(), set(), []
    for _, _, m, n in order:
        if m in taken0 or n in taken1:
            continue
        taken0.add(m), taken1.add(n), matches.append((int(m), int(n)))
    return matches


def measure(pairs: list[tuple[Path, Path]], min_score: float) -> dict[str, list[float]]:
    sums: dict[str, list[float]] = {}

    def add(name: str, *values: float) -> None:
        sums[name] = [a + b for a, b in zip(sums.get(name, [0.0] * len(values)), values)]

    with tempfile.TemporaryDirectory() as folder:
        found = [detect(images_, Path(folder) / name, min_score)
                 for name, images_ in zip(("first", "second"), zip(*pairs))]
    for (day, other), *((lines0, points0), (lines1, points1)) in zip(pairs, *found):
        lines, points = (lines0, lines1), (points0, points1)
        with tempfile.TemporaryDirectory() as folder:
            run("features", day, other, "--csv", Path(folder) / "matches.csv")
            pairs_ = table(Path(folder) / "matches.csv", 4)
        add("PLNet", len(lines[0]), same_ends(*lines).any(1).sum(), same_line(*lines).any(1).sum())
        if cv2 is not None:
            theirs = [lsd(image, len(ours)) for image, ours in zip((day, other), lines)]
            add("LSD", len(theirs[0]), same_ends(*theirs).any(1).sum(),
                same_line(*theirs).any(1).sum())
        matches = match(pairs_, *lines, *points)
        right = same_line(*lines) | same_line(lines[1], lines[0]).T
        add("matches", len(matches), sum(right[m, n] for m, n in matches), right.any(1).sum())
    return sums


def summarize(sums: dict[str, list[float]], pairs: int) -> dict:
    """Means over the pairs, and shares."""
    result = {"pairs": pairs}
    for name in ("PLNet", "LSD"):
        if name in sums:
            total, ends, line = sums[name]
            result[name] = {"lines": float(total / pairs), "same_ends": float(ends / total),
                            "same_line": float(line / total)}
    count, right, possible = sums["matches"]
    result["matches"] = {"count": float(count / pairs), "possible": float(possible / pairs),
                         "right": float(right / max(count, 1))}
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("first", type=Path)
    parser.add_argument("second", type=Path)
    parser.add_argument("--every", type=int, default=10, help="take every n-th frame")
    parser.add_argument("--min-score", type=float, default=0.4)
    parser.add_argument("--airslam", type=Path, default=run.program)
    parser.add_argument("--json", type=Path, help="write a record (benchmarks/records.py)")
    arguments = parser.parse_args()
    run.program = arguments.airslam
    about = records.conditions()
    pairs = list(zip(images(arguments.first), images(arguments.second)))[::arguments.every]
    result = summarize(measure(pairs, arguments.min_score), len(pairs))
    for name in ("PLNet", "LSD"):
        if name in result:
            print(f"{name:6s} {result[name]['lines']:6.1f} lines an image; found again: both ends "
                  f"{result[name]['same_ends']:.3f}, the line {result[name]['same_line']:.3f}")
    matches = result["matches"]
    print(f"matched by points: {matches['count']:.1f} an image of {matches['possible']:.1f} "
          f"that are there, {matches['right']:.3f} of them right")
    if arguments.json:
        records.write(arguments.json, about,
                      "airslam detect --line-scale 1, airslam features; lines of score "
                      f"{arguments.min_score:g} and more",
                      f"{arguments.first.name} and {arguments.second.name} at equal poses, every "
                      f"{arguments.every}th frame; found again: both ends within 5 px", result)


if __name__ == "__main__":
    main()
