#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Renders docs/benchmarks.md from the records in benchmarks/results/ (standard library only).

    python3 benchmarks/render.py            # write the page
    python3 benchmarks/render.py --check    # fail when the page is not what the records say
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
from pathlib import Path

import records
from ablation import mean_ratio

REPOSITORY = records.REPOSITORY
PAGE = REPOSITORY / "docs/benchmarks.md"
PEERS = json.loads((REPOSITORY / "benchmarks/peers.json").read_text())
SEQUENCES = {
    "kitti_00_first151": "KITTI 00, first 151",
    "warehouse_day": "warehouse, day",
    "warehouse_dynamic": "warehouse, lamps switched and dimmed",
    "euroc_v101_keyframes": "EuRoC V1_01, 100 frames in 135 s",
}
STARTS = {"euroc_v101_start": "EuRoC V1_01, its first second, at rest"}
MODES = {
    "odometry_stereo_points": "stereo, points",
    "odometry_stereo_lines": "stereo, points and lines",
    "odometry_imu_points": "IMU, points",
    "odometry_imu_lines": "IMU, points and lines",
}
HEAD = """# Benchmarks

This page is rendered from the records in `benchmarks/results/` by `benchmarks/render.py`, and a test holds
it to them. Each section says on which commit, machine and date it was measured, with which command,
and how. To measure all of it again (the data sets are not part of the repository):

    .venv/bin/python benchmarks/run_all.py --root <folder of the sequences>

Findings that explain the figures stand in [odometry](odometry.md), [the IMU](inertial.md),
[refining](refine.md) and [localization](relocalization.md).
"""


def table(head: list[str], rows: list[list[str]]) -> str:
    return records.markdown(head, rows) + "\n"


def provenance(record: dict) -> str:
    changed = " with uncommitted changes" if record["changed"] else ""
    return (f"*Commit `{record['commit']}`{changed}, {record['date']}, {record['machine']}, load "
            f"average before {record['load_before']}. `{record['configuration']}`. "
            f"{record['protocol']}.*\n")


def median(runs: list[dict], key: str) -> float | None:
    known = [run[key] for run in runs if not run["failure"] and run[key] is not None]
    return statistics.median(known) if known else None


def number(value: float | None, digits: int) -> str:
    return "–" if value is None else f"{value:.{digits}f}"


class Odometry:
    """The four records of the odometry, those that there are."""

    def __init__(self, folder: Path):
        self.records = {mode: records.read(mode, folder) for mode in MODES}

    def runs(self, mode: str, sequence: str) -> list[dict]:
        record = self.records.get(mode)
        runs = record["results"].get(sequence, []) if record else []
        if mode.startswith("odometry_imu"):
            return [run for run in runs if run["imu"] == "used"]
        return runs

    def value(self, mode: str, sequence: str, key: str) -> float | None:
        return median(self.runs(mode, sequence), key)

    def accuracy_cell(self, mode: str, sequence: str) -> str:
        runs = self.runs(mode, sequence)
        if not runs:
            return "–"
        if all(run["failure"] for run in runs):
            return "failed"
        cell = number(median(runs, "ate"), 4)
        posed, frames = median(runs, "frames_with_pose"), median(runs, "frames")
        return cell if posed == frames else f"{cell} ({posed:.0f}/{frames:.0f} frames)"


def odometry_section(odometry: Odometry) -> str:
    known = [record for record in odometry.records.values() if record]
    if not known:
        return ""
    configuration = "airslam map SEQUENCE --out FOLDER [--no-imu] [--no-lines]"
    text = ["## Odometry", "", provenance(known[0] | {"configuration": configuration}),
            "ATE in metres, online SLAM without loop closing; every frame has a pose where nothing "
            "else is said.", ""]
    rows = []
    for sequence, name in SEQUENCES.items():
        peers = PEERS["odometry"]["ATE [m]"].get(sequence, {})
        notes = PEERS["odometry"]["notes"].get(sequence, {})
        theirs = [f"{peers[peer]}" + (f" ({notes[peer]})" if peer in notes else "")
                  if peer in peers else "–" for peer in ("ORB-SLAM3", "Basalt")]
        rows.append([name, *(odometry.accuracy_cell(mode, sequence) for mode in MODES), *theirs])
    text += [table(["sequence", *MODES.values(), "ORB-SLAM3, stereo", "Basalt, stereo"], rows),
             PEERS["odometry"]["source"], "", "### Cost", "", "Medians over the runs of the record.", ""]
    rows = [[SEQUENCES[sequence], name,
             *(number(odometry.value(mode, sequence, key), digits) for key, digits in
               (("cpu_ms", 1), ("frames_per_second", 1), ("peak_mb", 0), ("keyframes", 0),
                ("map_mb", 1))), share(odometry, mode, sequence)]
            for sequence in SEQUENCES for mode, name in MODES.items()
            if odometry.runs(mode, sequence)]
    for peer, cost in PEERS["odometry"]["warehouse_day cost"].items():
        rows.append([SEQUENCES["warehouse_day"], peer, number(cost["cpu_ms"], 1),
                     number(cost["frames_per_second"], 1), number(cost["peak_mb"], 0), "–", "–",
                     "–"])
    text.append(table(["sequence", "mode", "core-ms a frame", "frames/s", "peak MB", "keyframes",
                       "map MB", "share of the images"], rows))
    return "\n".join(text)


def share(odometry: Odometry, mode: str, sequence: str) -> str:
    size, images = (odometry.value(mode, sequence, key) for key in ("map_mb", "images_mb"))
    return f"{100 * size / images:.1f} %" if size and images else "–"


def lines_section(odometry: Odometry, ablation: dict | None) -> str:
    rows = []
    for sequence, name in SEQUENCES.items():
        cells = []
        for sensors in ("stereo", "imu"):
            without, with_lines = (odometry.value(f"odometry_{sensors}_{kind}", sequence, "ate")
                                   for kind in ("points", "lines"))
            cells.append("–" if not without or not with_lines else
                         f"{1000 * without:.1f} → {1000 * with_lines:.1f} mm "
                         f"({100 * (with_lines / without - 1):+.0f} %)")
        rows.append([name, *cells])
    low, high = PEERS["paper"]["line_improvement"]
    text = ["## What lines give", "", "ATE without and with lines, from the runs above.", "",
            table(["sequence", "stereo", "with the IMU"], rows),
            f"The paper reports {-100 * low:.0f} to {-100 * high:.0f} % on its data sets.", ""]
    if ablation:
        text += ["One run says little. Pairs of runs at several numbers of keypoints, and the mean of "
                 "ATE with lines / without:", "", provenance(ablation), ablation_table(ablation)]
    return "\n".join(text)


def ablation_table(ablation: dict) -> str:
    rows = []
    for sequence, modes in ablation["results"].items():
        for mode, pairs in modes.items():
            cells = [f"{p['keypoints']}: {1000 * p['points']:.1f} → {1000 * p['lines']:.1f}"
                     + ("" if p["points_poses"] == p["lines_poses"] else
                        f" ({p['points_poses']} → {p['lines_poses']} frames)") for p in pairs]
            rows.append([SEQUENCES.get(sequence, sequence), mode.replace("imu", "with the IMU"),
                         number(mean_ratio(pairs), 2), ", ".join(cells)])
    return table(["sequence", "mode", "mean ratio", "keypoints: ATE without → with lines [mm]"], rows)


def inertial_section(record: dict, others: dict | None) -> str:
    """others: sequences without blackouts."""
    text = ["## The IMU", "", provenance(record)]
    rows, dark = [], []
    names = SEQUENCES | STARTS
    results = record["results"] | (others["results"] if others else {})
    for sequence, r in results.items():
        s = r["states"]
        rows.append([names.get(sequence, sequence), f"{r['frames_in_trajectory']}/{r['frames']}",
                     number(r["ate_stereo_m"], 4), number(r["ate_imu_m"], 4),
                     *([f"{s['initialised_after_s']:.1f} s", f"{s['gravity_deg']:.2f}°",
                        f"{s['gyroscope_rad_s']:.1e} rad/s",
                        f"{s['accelerometer_m_s2']:.3f} m/s²"] if s["state"] == "used"
                       else [s["state"], "–", "–", "–"])])
        dark += [[names.get(sequence, sequence), f"{b['seconds']:g} s", number(b["online_m"], 4),
                  number(b["final_m"], 4), str(b["frames_inertial"]),
                  str(b["frames_without_pose"])] for b in r["blackouts"]]
    text.append(table(["sequence", "frames", "ATE stereo [m]", "with the IMU [m]",
                       "initialised after", "gravity", "gyroscope's bias",
                       "accelerometer's bias"], rows))
    text += ["Blackouts: every image black for so long. Error of the motion since the last image, at "
             "the end of the blackout.", "",
             table(["sequence", "black for", "as first estimated [m]", "in the end [m]",
                    "frames by the IMU", "frames without a pose"], dark)]
    return "\n".join(text)


def light_section(record: dict) -> str:
    r = record["results"]
    rows = [[name, number(r[key]["lines"], 1), number(r[key]["same_ends"], 2),
             number(r[key]["same_line"], 2)]
            for key, name in (("PLNet", "PLNet"), ("LSD", "OpenCV's LSD, as many, its longest"))
            if key in r]
    m = r["matches"]
    return "\n".join([
        "## Lines under changing light", "", provenance(record),
        table(["detector", "lines an image", "found again: both ends", "the line"], rows),
        f"Matched by shared points: {m['count']:.1f} an image of {m['possible']:.1f} that are in "
        f"both, {100 * m['right']:.0f} % of them right.", ""])


def refine_section(record: dict) -> str:
    rows = [[r["name"].replace("_", " "), str(r["keyframes"]), number(r["path_m"], 1),
             number(r["before_m"], 4), number(r["after_m"], 4),
             number(100 * r["after_m"] / r["path_m"], 2), str(r["loops"]), str(r["false"]),
             ", ".join(f"{r['seconds'].get(step, 0):.1f}"
                       for step in ("loop_closure", "global_bundle")), number(r["peak_mib"], 0)]
            for r in record["results"]]
    return "\n".join(["## Refining", "", provenance(record), table(
        ["sequence", "keyframes", "path [m]", "before [m]", "after [m]", "after, % of path", "loops",
         "false loops", "seconds: loops, bundle", "peak MiB"], rows)])


def relocalization_section(record: dict) -> str:
    rows = []
    for key, name in (("night", "warehouse by day, queries at night"),
                      ("euroc", "EuRoC V1_01, every fourth frame")):
        for r in record["results"].get(key, []):
            rows.append([name, str(r["candidates"]), "yes" if r["structure_graph"] else "no",
                         f"{100 * r['near'] / r['queries']:.0f} %",
                         f"{100 * r['far'] / r['queries']:.0f} %", str(r["wrong"]),
                         str(r["refused"]), f"{number(r['median_m'], 3)} m, "
                         f"{number(r['median_deg'], 2)}°", number(r["queries_per_second"], 1),
                         " / ".join(f"{ms:.1f}" for ms in r["stage_ms"].values())])
    text = ["## Localization", "", provenance(record), table(
        ["map and queries", "candidates", "structure graph", "within 0.25 m, 2°", "2 m, 15°",
         "wrong", "refused", "median error", "queries/s",
         "ms: undistort / detect / retrieve / filter / verify"], rows)]
    if "photos" in record["results"]:
        p = record["results"]["photos"]
        text += [f"Photos of other places located: {p['located']} of {p['queries']}; the most "
                 f"inliers that one of them had: {p['most_inliers']}.", ""]
    return "\n".join(text)


def growth_section(record: dict) -> str:
    r = record["results"]
    rows = [[name, number(first, 1), number(last, 1), f"{100 * (last / first - 1):+.0f} %"]
            for name, (first, last) in r["thirds"].items()]
    return "\n".join([
        "## A long run", "", provenance(record),
        f"{r['frames']} frames, {r['tracked']} tracked, {r['wall_seconds']:.0f} s, "
        f"{r['frames_per_second']:.1f} frames/s; {r['keyframes']} keyframes, {r['landmarks']} "
        f"landmarks, map of {r['map_mb']:.1f} MB, peak {r['peak_mb']:.0f} MB.", "",
        table(["", "first third", "last third", "change"], rows)])


def refine_growth_section(record: dict) -> str:
    results = record["results"]
    return "\n".join(["## Growth of refining", "", provenance(record),
                      table([name.replace("_", " ") for name in results["head"]],
                            results["rows"])])


def line_detection() -> list[list[float | str]]:
    """Method and sAP10 on YorkUrban, from the table that training/ writes."""
    text = (REPOSITORY / "training/results/lines.md").read_text()
    cells = [[cell.strip() for cell in line.split("|")[1:-1]] for line in text.splitlines()]
    return [[row[1], float(row[3])] for row in cells
            if len(row) == 6 and row[0].startswith("YorkUrban")]


def verdict(ours: float, theirs: float, less_is_better: bool) -> str:
    if ours == theirs:
        return "equal"
    return "ahead" if (ours < theirs) == less_is_better else "**behind**"


def standing(odometry: Odometry, relocalization: dict | None) -> str:
    """Where we are ahead of peers and aims, and where behind."""
    rows = []

    def add(what: str, ours: float | None, other: str, theirs: float, digits: int, unit: str,
            less: bool = True) -> None:
        if ours is not None:
            shown = round(ours, digits)  # as many digits as are known of theirs
            rows.append([what, f"{shown:.{digits}f}{unit}", f"{theirs:.{digits}f}{unit}", other,
                         verdict(shown, theirs, less)])

    best = "odometry_stereo_lines"
    for sequence, peers in PEERS["odometry"]["ATE [m]"].items():
        for peer, ate in peers.items():
            add(f"ATE, {SEQUENCES[sequence]}, stereo with lines",
                odometry.value(best, sequence, "ate"), peer, ate, 2 if ate >= 0.1 else 3, " m")
    for peer, cost in PEERS["odometry"]["warehouse_day cost"].items():
        for key, name, digits, unit, less in (
                ("cpu_ms", "core-ms a frame", 0, "", True),
                ("frames_per_second", "frames/s", 0, "", False),
                ("peak_mb", "peak memory", 0, " MB", True)):
            add(f"{name}, warehouse by day, with lines", odometry.value(best, "warehouse_day", key),
                peer, cost[key], digits, unit, less)
    paper = PEERS["paper"]
    for mode in ("odometry_stereo_points", best):
        add(f"frames/s at 752×480, {MODES[mode]}",
            odometry.value(mode, "warehouse_day", "frames_per_second"),
            "the paper, on an RTX 4080", paper["frames_per_second"], 0, "", False)
    size, images = (odometry.value(best, "warehouse_day", key) for key in ("map_mb", "images_mb"))
    if size and images:
        add("map with lines, share of the raw images", 100 * size / images, "the paper, OIVIO",
            100 * paper["map_share"], 1, " %")
    first = next((r for r in (relocalization or {"results": {}})["results"].get("night", [])
                  if r["structure_graph"]), None)
    if first:
        add("night queries within 2 m, 15°", 100 * first["far"] / first["queries"],
            "the paper, TartanAir", 100 * paper["night_recall"], 1, " %", False)
        add("night queries/s", first["queries_per_second"], "aim", paper["queries_per_second"], 0,
            "", False)
        add("filtering by junctions", first["stage_ms"]["filter"], "the paper",
            paper["structure_graph_ms"], 1, " ms")
    methods = dict(line_detection())
    ours = methods["ours (`airslam detect`)"]
    for method in ("M-LSD large", "OpenCV LSD"):
        add("sAP10 of lines, YorkUrban, 51 images", ours, method, methods[method], 1, "", False)
    add("sAP10 of lines, YorkUrban (the paper: 102 images)", ours, "the paper",
        paper["plnet_yorkurban_sap10"], 1, "", False)
    return "\n".join(["## Where we stand", "", table(
        ["what", "ours", "theirs", "who", ""], rows),
        f"{paper['source']} Line detection: training/results/lines.md.", ""])


def page(folder: Path = records.RESULTS) -> str:
    odometry = Odometry(folder)
    relocalization = records.read("relocalization", folder)
    parts = [HEAD, standing(odometry, relocalization), odometry_section(odometry),
             lines_section(odometry, records.read("ablation", folder))]
    inertial = records.read("inertial", folder)
    if inertial:
        parts.append(inertial_section(inertial, records.read("inertial_euroc", folder)))
    for name, section in (("light", light_section), ("refine", refine_section),
                          ("relocalization", relocalization_section), ("growth", growth_section),
                          ("refine_growth", refine_growth_section)):
        record = records.read(name, folder)
        if record:
            parts.append(section(record))
    return "\n".join(part.rstrip("\n") + "\n" for part in parts if part)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true")
    arguments = parser.parse_args()
    if not arguments.check:
        PAGE.write_text(page())
        return 0
    if PAGE.read_text() == page():
        return 0
    print("docs/benchmarks.md is not what benchmarks/results/ says: run "
          "`python3 benchmarks/render.py`", file=sys.stderr)
    return 1


if __name__ == "__main__":
    sys.exit(main())
