#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""One command a table of the paper, beside the paper's own numbers.

    .venv/bin/python benchmarks/reproduce.py euroc --root ~/data/euroc
    .venv/bin/python benchmarks/reproduce.py dark-euroc --root ~/data/euroc [--levels 0 6 12]
    .venv/bin/python benchmarks/reproduce.py uma-vi|oivio --root ~/data/…
    .venv/bin/python benchmarks/reproduce.py tartanair-daynight --root ~/data/tartanair

Where each data set is had and how its folder must look stands in docs/datasets.md. Prints a markdown table with
commit, configuration, protocol, coverage and machine, and writes a record of the same (--json). A sequence that is
not in --root is left out and named. Options after `--` go to `airslam map`.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
from dataclasses import asdict, dataclass
from pathlib import Path

import derived_datasets as derived
import numpy as np
import published
import records
import relocalization as localization

REPOSITORY = records.REPOSITORY
TRUTH_FILES = ("mav0/state_groundtruth_estimate0/data.csv", "state_groundtruth_estimate0/data.csv",
               "mav0/groundtruth/data.csv", "groundtruth/data.csv", "groundtruth.csv", "groundtruth.tum",
               "groundtruth.txt", "mav0/mocap0/data.csv")
EUROC_PROTOCOL = (
    "RMSE of the body's position after SE(3) alignment, as `airslam eval`. Without loops: every frame of the online "
    "run's final trajectory. With loops: the keyframes after `airslam refine`. One run, for the same input gives the "
    "same result. Speed: frames of the sequence over the wall time of the whole process, no loops.")
FAILURE_PROTOCOL = (
    "RMSE of the body's position after SE(3) alignment of every frame that has ground truth, as `airslam eval`; no "
    "loop closing. F: lost for more than {lost:g} s at a stretch, or RMSE above {rmse:g} m.")


class Failed(Exception):
    """A step that gave no result; its text goes into the table."""


@dataclass
class Limits:
    """What counts as a failure."""

    lost_seconds: float = float("inf")
    rmse: float = float("inf")


@dataclass
class Result:
    """One row: a sequence, or a level of darkness."""

    name: str
    frames: int = 0
    coverage: float = 0     # of the frames with ground truth, 0 to 1
    rmse: float | None = None
    rmse_loops: float | None = None
    longest_gap: float = 0  # seconds without a pose
    frames_per_second: float = 0
    failure: str = ""


class Program:
    """The airslam program under test."""

    def __init__(self, file: Path, map_options: list[str]):
        self.file, self.map_options = file, map_options

    def run(self, *words: object) -> str:
        """Runs one subcommand; Failed with its last line when it refuses."""
        answer = subprocess.run([str(self.file), *map(str, words)], capture_output=True, text=True, check=False)
        if answer.returncode != 0:
            lines = (answer.stderr or answer.stdout).strip().splitlines()
            raise Failed(f"airslam {words[0]} ended with {answer.returncode}: {lines[-1] if lines else ''}")
        return answer.stdout

    def map(self, dataset: Path, out: Path, *options: str) -> dict:
        """Maps a data set and returns its report."""
        shutil.rmtree(out, ignore_errors=True)
        out.parent.mkdir(parents=True, exist_ok=True)
        self.run("map", dataset, "--out", out, *options, *self.map_options)
        return json.loads((out / "report.json").read_text())

    def evaluate(self, truth: Path, trajectory: Path, *options: object) -> dict:
        """Compares a trajectory with its ground truth."""
        answer = trajectory.with_suffix(".eval.json")
        self.run("eval", truth, trajectory, "--json", answer, *options)
        return json.loads(answer.read_text())


def find_sequence(root: Path, name: str) -> Path | None:
    """The folder of a sequence: in the root or one or two levels below it; itself, or its only subfolder, ASL."""
    for candidate in (root / name, *sorted(root.glob(f"*/{name}")), *sorted(root.glob(f"*/*/{name}"))):
        for folder in (candidate, *sorted(p for p in candidate.glob("*") if p.is_dir())):
            if (folder / "mav0").is_dir() or (folder / "cam0").is_dir():
                return folder
    return None


def find_truth(sequence: Path) -> Path:
    """Its ground truth; Failed where there is none."""
    for name in TRUTH_FILES:
        if (sequence / name).exists():
            return sequence / name
    raise Failed(f"no ground truth: none of {', '.join(TRUTH_FILES)}")


def longest_gap(report: dict, trajectory: Path) -> float:
    """The longest time in seconds within the sequence without a pose of the final trajectory."""
    frames = [state["timestamp_ns"] for state in report["frame_states"]]
    posed = localization.read_tum(trajectory).times
    times = np.sort(np.concatenate([[frames[0], frames[-1]], posed]))
    return float(np.diff(times).max()) * 1e-9


def odometry(program: Program, sequence: Path, out: Path, limits: Limits, loops: bool) -> Result:
    """Maps and evaluates a sequence, with loops once more after `airslam refine`."""
    result = Result(sequence.name)
    try:
        truth = find_truth(sequence)
        report = program.map(sequence, out / "map")
        trajectory = out / "map/trajectory.tum"
        evaluation = program.evaluate(truth, trajectory, "--dataset", sequence)
        result.frames, result.coverage = report["frames"], evaluation["coverage"]
        result.rmse = evaluation["ate_position_m"]["rmse"]
        result.longest_gap = longest_gap(report, trajectory)
        result.frames_per_second = report["frames"] / report["wall_seconds"]
        if loops:
            program.run("refine", out / "map/map.db", "--out", out / "refined.db")
            program.run("export", out / "refined.db", "--tum", out / "refined.tum")
            result.rmse_loops = program.evaluate(truth, out / "refined.tum")["ate_position_m"]["rmse"]
        if result.longest_gap > limits.lost_seconds:
            result.failure = f"lost for {result.longest_gap:.1f} s"
        elif result.rmse > limits.rmse:
            result.failure = f"RMSE {result.rmse:.2f} m"
    except Failed as failure:
        result.failure = str(failure)
    print(f"  {result.name}: {result.failure or f'{result.rmse:.4f} m'}", file=sys.stderr, flush=True)
    return result


def number(value: float | None, digits: int = 3) -> str:
    """A number of the table."""
    return "–" if value is None else f"{value:.{digits}f}"


def average(values: list[float | None]) -> float | None:
    """Mean of those that are known."""
    known = [value for value in values if value is not None]
    return sum(known) / len(known) if known else None


@dataclass
class Table:
    """What a command gives: the table, its protocol, and the same for programs."""

    text: str
    protocol: str
    results: list[dict]


def found_sequences(options: argparse.Namespace, names: list[str]) -> dict[str, Path]:
    """The wanted sequences that are there; the others are named."""
    wanted = options.only or names
    unknown = sorted(set(wanted) - set(names))
    if unknown:
        raise SystemExit(f"reproduce: {unknown[0]} is no sequence of this table: {', '.join(names)}")
    found = {name: folder for name in wanted if (folder := find_sequence(options.root, name))}
    missing = [name for name in wanted if name not in found]
    if missing:
        print(f"  not in {options.root}, left out: {', '.join(missing)}", file=sys.stderr)
    if not found:
        raise SystemExit(f"reproduce: none of the sequences is in {options.root}")
    return found


def euroc(program: Program, options: argparse.Namespace) -> Table:
    """Eleven sequences, with and without loops, and the speed."""
    results, rows = [], []
    for name, folder in found_sequences(options, list(published.EUROC)).items():
        result = odometry(program, folder, options.out / name, Limits(), loops=True)
        result.name = name
        results.append(result)
        paper = published.EUROC[name]
        rows.append([name, *_cells(result), number(paper[0]), number(result.rmse_loops), number(paper[1]),
                     number(result.frames_per_second, 1),
                     str(published.EUROC_FRAMES_PER_SECOND) if name == published.EUROC_SPEED_SEQUENCE else "–"])
    rows.append(["average", "", "", number(average([r.rmse for r in results])),
                 number(average([published.EUROC[r.name][0] for r in results])),
                 number(average([r.rmse_loops for r in results])),
                 number(average([published.EUROC[r.name][1] for r in results])), "", ""])
    head = ["sequence", "frames", "coverage", "no loops [m]", "paper (AirVIO)", "loops [m]", "paper (AirSLAM)",
            "frames/s", "paper (RTX 4080)"]
    return Table(records.markdown(head, rows), EUROC_PROTOCOL, [asdict(r) for r in results])


def _cells(result: Result) -> list[str]:
    """Frames, coverage, and RMSE or F."""
    shown = f"F ({result.failure})" if result.failure else number(result.rmse)
    return [str(result.frames), f"{100 * result.coverage:.1f} %", shown]


def with_failures(numbers: dict[str, float], limits: Limits, program: Program, options: argparse.Namespace) -> Table:
    """Sequences without loops, where long losses and large errors are failures."""
    results, rows = [], []
    for name, folder in found_sequences(options, list(numbers)).items():
        result = odometry(program, folder, options.out / name, limits, loops=False)
        result.name = name
        results.append(result)
        rows.append([name, *_cells(result), number(numbers[name]), number(result.longest_gap, 1),
                     number(result.frames_per_second, 1)])
    good = [r for r in results if not r.failure]
    rows.append([f"average of {len(good)}", "", "", number(average([r.rmse for r in good])),
                 number(average([numbers[r.name] for r in good])), "", ""])
    head = ["sequence", "frames", "coverage", "RMSE [m]", "paper", "longest loss [s]", "frames/s"]
    return Table(records.markdown(head, rows), FAILURE_PROTOCOL.format(lost=limits.lost_seconds, rmse=limits.rmse),
                 [asdict(r) for r in results])


def oivio(program: Program, options: argparse.Namespace) -> Table:
    """Nine sequences in tunnels and mines with a light on board."""
    table = with_failures(published.OIVIO, Limits(10, 10), program, options)
    table.protocol += (" The ground truth is a prism's position: its lever arm to the IMU is in these errors, as in the "
                       "paper's.")
    return table


def uma_vi(program: Program, options: argparse.Namespace) -> Table:
    """Ten sequences with changing light and ground truth at start and end only."""
    table = with_failures(published.UMA_VI, Limits(10, 10), program, options)
    table.protocol += " Ground truth exists at start and end only: the alignment and the RMSE rest on these frames."
    return table


def dark_euroc(program: Program, options: argparse.Namespace) -> Table:
    """One sequence at 13 levels of darkness."""
    name = options.only[0] if options.only else published.DARK_EUROC_SEQUENCE
    source = find_sequence(options.root, name)
    if source is None:
        raise SystemExit(f"reproduce: {name} is not in {options.root}")
    results, rows = [], []
    for level in options.levels:
        a, gamma = derived.darkness(level)
        folder = options.out / f"level_{level:02d}"
        derived.make_dark(source, folder / "dataset", level)
        result = odometry(program, folder / "dataset", folder, Limits(rmse=1.0), loops=True)
        result.name = f"L{level}"
        results.append(result)
        rows.append([result.name, f"{a:.2f}", f"{gamma:.2f}", *_cells(result),
                     "F" if result.failure else number(result.rmse_loops)])
        if not options.keep:
            shutil.rmtree(folder / "dataset")
    good = [r for r in results if not r.failure]
    rows.append([f"average of {len(good)}", "", "", "", "", number(average([r.rmse for r in good])),
                 number(average([r.rmse_loops for r in good]))])
    head = ["level", "A", "γ", "frames", "coverage", "no loops [m]", "loops [m]"]
    protocol = (f"{name}, every grey value V (0 to 1) replaced by A·V^(1/γ); A and γ are our choice (the paper's stand only "
                f"in a figure). F: RMSE above 1 m, or no result. {EUROC_PROTOCOL} The paper states an average of "
                f"{published.DARK_EUROC_AVERAGE} m for V2_01_easy.")
    return Table(records.markdown(head, rows), protocol, [asdict(r) for r in results])


def tartan_sequences(root: Path, scene: str, difficulty: str) -> dict[str, Path]:
    """P??? folders of a scene, named as on disk (abandonedfactory) or as in the paper (abandoned_factory)."""
    found = {}
    for folder in sorted(root.rglob("P[0-9][0-9][0-9]")):
        parts = [part.replace("_", "") for part in folder.relative_to(root).parts]
        difficulties = {"Easy", "Hard"} & set(parts)
        if scene.replace("_", "") in parts and (not difficulties or difficulty in difficulties) \
                and (folder / "image_left").is_dir():
            found.setdefault(folder.name, folder)
    return found


def write_queries(map_sequence: derived.TartanSequence, night: list[derived.TartanSequence], folder: Path,
                  every: int) -> localization.Poses:
    """Links the night images near any map image into a folder; returns their poses in order of their names."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    positions, quaternions, times = [], [], []
    for sequence in night:
        for row in derived.near(map_sequence, sequence, 3.0, 15.0)[::every]:
            time = derived.FIRST_NS + derived.STEP_NS * len(times)  # unique: names of two sequences coincide
            (folder / f"{time}{sequence.left[row].suffix}").symlink_to(sequence.left[row].resolve())
            times.append(time)
            positions.append(sequence.positions[row])
            quaternions.append(sequence.quaternions[row])
    return localization.Poses(np.array(times, dtype=np.int64), np.array(positions).reshape(-1, 3),
                              np.array(quaternions).reshape(-1, 4))


def locate(program: Program, name: str, map_sequence: derived.TartanSequence,
           night: list[derived.TartanSequence], options: argparse.Namespace) -> dict:
    """Maps a day sequence, refines the map, and locates the night images near it."""
    out = options.out / name
    derived.make_asl(map_sequence, out / "dataset")
    truth = write_queries(map_sequence, night, out / "queries", options.every)
    result = {"name": name, "map_frames": len(map_sequence.left), "queries": len(truth.times), "failure": ""}
    if len(truth.times) == 0:
        return {**result, "failure": "no night image within 3 m and 15°"}
    try:
        program.map(out / "dataset", out / "map")
        program.run("refine", out / "map/map.db", "--out", out / "refined.db")
    except Failed as failure:
        return {**result, "failure": str(failure)}
    localization.run.program = program.file
    day_truth = localization.read_euroc(out / "dataset/mav0/state_groundtruth_estimate0/data.csv")
    worlds = {component: localization.align(poses, localization.at(day_truth, poses.times))
              for component, poses in localization.map_poses(out / "refined.db").items()}
    outcome = localization.localize(out / "refined.db", out / "queries", out / "dataset/mav0/cam0/sensor.yaml",
                                    "--candidates", "3")
    both = [localization.errors(poses, truth, *worlds[component])
            for component, poses in outcome.poses.items()]
    metres, degrees = (np.concatenate([pair[i] for pair in both] or [np.zeros(0)]) for i in (0, 1))
    good = int(((metres < 2) & (degrees < 15)).sum())
    return {**result, "recall": 100 * good / len(truth.times), "wrong": len(metres) - good,
            "refused": len(truth.times) - len(metres), "queries_per_second": outcome.per_second}


def tartanair(program: Program, options: argparse.Namespace) -> Table:
    """Maps by day, queries by night."""
    day = tartan_sequences(options.root, "abandoned_factory", options.difficulty)
    night_folders = tartan_sequences(options.root, "abandoned_factory_night", options.difficulty)
    if not day or not night_folders:
        raise SystemExit(f"reproduce: no {'night ' if day else ''}sequence P??? with image_left was found below "
                         f"{options.root}/abandoned_factory{'_night' if day else ''}")
    night = [derived.read_tartanair(folder) for folder in night_folders.values()]
    results, rows = [], []
    for name, folder in day.items():
        if options.only and name not in options.only:
            continue
        result = locate(program, name, derived.read_tartanair(folder), night, options)
        results.append(result)
        print(f"  {name}: {result.get('failure') or result['recall']}", file=sys.stderr, flush=True)
        found = [f"F ({result['failure']})", "–", "–", "–"] if result["failure"] else [
            f"{result['recall']:.1f}", str(result["wrong"]), str(result["refused"]),
            f"{result['queries_per_second']:.1f}"]
        rows.append([name, str(result["map_frames"]), str(result["queries"]), *found[:1],
                     number(published.TARTANAIR_RECALL.get(name), 1), *found[1:]])
    rows.append(["average", "", "", number(average([r.get("recall") for r in results]), 1),
                 number(average([published.TARTANAIR_RECALL.get(r["name"]) for r in results]), 1), "", "", ""])
    head = ["map", "map frames", "queries", "recall [%]", "paper", "wrong", "refused",
            f"queries/s (paper, RTX 4080: {published.TARTANAIR_QUERIES_PER_SECOND})"]
    protocol = ("Maps of abandoned_factory after `airslam refine`; queries are the images of abandoned_factory_night within "
                f"3 m and 15° of any map image (every {options.every} of them), located one by one without a prior; 400 keypoints, 3 "
                "candidates. Success: within 2 m and 15° of the truth, the map laid over it by SE(3) on its keyframes. "
                f"Difficulty {options.difficulty}, where the folders say one.")
    return Table(records.markdown(head, rows), protocol, results)


COMMANDS = {"euroc": euroc, "dark-euroc": dark_euroc, "uma-vi": uma_vi, "oivio": oivio,
            "tartanair-daynight": tartanair}


def parse(words: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("table", choices=COMMANDS)
    parser.add_argument("--root", type=Path, required=True, help="folder of the data set")
    parser.add_argument("--out", type=Path, help="working folder (out/reproduce/TABLE)")
    parser.add_argument("--airslam", type=Path, default=REPOSITORY / "build/bin/airslam")
    parser.add_argument("--json", type=Path, help="record of the table to write")
    parser.add_argument("--only", nargs="+", help="sequences; for dark-euroc the one to darken")
    parser.add_argument("--levels", nargs="+", type=int, default=list(range(derived.LEVELS + 1)),
                        choices=range(derived.LEVELS + 1), metavar="LEVEL", help="of dark-euroc (0 to 12)")
    parser.add_argument("--keep", action="store_true", help="keep the darkened images")
    parser.add_argument("--every", type=int, default=1, help="take every n-th query of tartanair-daynight")
    parser.add_argument("--difficulty", choices=["Easy", "Hard"], default="Easy", help="of tartanair-daynight")
    words = sys.argv[1:] if words is None else words
    end = words.index("--") if "--" in words else len(words)
    options = parser.parse_args(words[:end])
    options.extra = words[end + 1:]
    return options


def main(words: list[str] | None = None) -> int:
    options = parse(words)
    if not options.airslam.exists():
        raise SystemExit(f"reproduce: {options.airslam} is missing; run `make build`")
    if not options.root.is_dir():
        raise SystemExit(f"reproduce: {options.root} is no folder")
    options.out = options.out or REPOSITORY / "out/reproduce" / options.table
    about = records.conditions()
    table = COMMANDS[options.table](Program(options.airslam, options.extra), options)
    configuration = " ".join(["model pack airslam-fast, default options", *options.extra])
    print(f"commit {about['commit']}{' with changes' if about['changed'] else ''}, {about['date']}\n"
          f"machine: {about['machine']}, load before {about['load_before']}\n"
          f"configuration: {configuration}\nprotocol: {table.protocol}\n\n{table.text}")
    if options.json:
        records.write(options.json, about, configuration, table.protocol, table.results)
    return 1 if any(result["failure"] for result in table.results) else 0


if __name__ == "__main__":
    sys.exit(main())
