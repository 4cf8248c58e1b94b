# SPDX-License-Identifier: BSD-3-Clause
"""`python -m airslam run`: maps a data set or a bag, and shows or records the run.

A bag is converted into a folder beside --out that is removed at the end; its result is that of the converted folder.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from . import Error, Trajectory, run
from .bags import is_bag
from .convert import add_bag_options, convert, describe
from .results import find_truth


@contextmanager
def _dataset(arguments: argparse.Namespace, beside: Path) -> Iterator[Path]:
    """The folder to map: the given one, or that of the converted bag for as long as it is needed."""
    if not is_bag(arguments.dataset):
        if arguments.topics or arguments.calib:
            raise Error(f"--topics and --calib are for bags, but {arguments.dataset} is none")
        yield arguments.dataset
        return
    beside.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".bag-", dir=beside) as folder:
        place = Path(folder) / arguments.dataset.stem
        result = convert(arguments.dataset, place, topics=arguments.topics, calibration=arguments.calib,
                         acceleration_unit=arguments.acceleration_unit,
                         gyroscope_unit=arguments.gyroscope_unit)
        for line in describe(result):
            print(line, file=sys.stderr)
        yield place


def _run(arguments: argparse.Namespace, dataset: Path, out: Path) -> object:
    """Maps the folder, with a viewer where one is asked for."""
    options = {"config": arguments.config, "imu": not arguments.no_imu, "lines": not arguments.no_lines}
    if arguments.model:
        options["model"] = arguments.model
    if not arguments.view and arguments.save is None:
        return run(dataset, out, **options)
    from .live import LiveView  # noqa: PLC0415 (needs pillow and rerun)
    from .scene import Scene  # noqa: PLC0415

    truth_file = arguments.truth or find_truth(dataset)
    truth = Trajectory.load(truth_file) if truth_file is not None else None
    scene = Scene(dataset.name, arguments.save, live=True)
    view = LiveView(scene, truth, out.with_name(out.name + ".partial") / "map.db")
    try:
        result = run(dataset, out, on_frame=view, **options)
        view.finish(out)
    finally:
        scene.close()
    return result


def add_parser(subparsers: argparse._SubParsersAction) -> argparse.ArgumentParser:
    """Registers the command."""
    parser = subparsers.add_parser("run", help="map a data set or a bag, and show or record the run",
                                   description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", type=Path, help="EuRoC or KITTI folder, or a bag (ROS 1, ROS 2, MCAP)")
    parser.add_argument("--out", type=Path, default=Path("result"), help="folder of results (result)")
    shown = parser.add_mutually_exclusive_group()
    shown.add_argument("--view", action="store_true", help="show it in the viewer")
    shown.add_argument("--save", type=Path, metavar="FILE.rrd", help="record what the viewer would show")
    parser.add_argument("--truth", type=Path, help="ground truth to show; found in the data set by itself")
    parser.add_argument("--config", type=Path, help="YAML file of options")
    parser.add_argument("--model", help="model pack: a name or a folder")
    parser.add_argument("--no-imu", action="store_true", help="stereo alone")
    parser.add_argument("--no-lines", action="store_true", help="points alone")
    add_bag_options(parser)
    return parser


def main(arguments: argparse.Namespace) -> int:
    """Runs the command."""
    out = arguments.out.resolve()
    with _dataset(arguments, out.parent) as dataset:
        result = _run(arguments, dataset, out)
    report = result.report
    print(f"{report['frames_with_pose']} of {report['frames']} frames with a pose, {report['keyframes']} keyframes, "
          f"{report['landmarks']} points, {report['lines']['landmarks']} lines, "
          f"{report['frames_per_second']:.1f} frames/s\nwritten: {arguments.out}")
    if arguments.save is not None:
        from .scene import written  # noqa: PLC0415

        print(written(arguments.save))
    return 0
