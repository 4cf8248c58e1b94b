# SPDX-License-Identifier: BSD-3-Clause
"""`python -m airslam convert`: a bag of ROS 1, ROS 2 or MCAP becomes an ASL folder."""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from . import Error
from .asl_folder import AslWriter
from .bag_calibration import copy_calibration, write_from_camera_info
from .bag_images import image_file
from .bags import Bag, Choice, guess_topics, open_bag, parse_topics

GRAVITY = 9.80665  # m/s², one g
ACCELERATION_UNITS = {"m/s2": 1.0, "g": GRAVITY}
GYROSCOPE_UNITS = {"rad/s": 1.0, "deg/s": np.pi / 180}


@dataclass
class Conversion:
    """What was converted."""

    choice: Choice
    guessed: bool
    left: int
    right: int
    pairs: int
    imu: int
    calibration: str
    warnings: list[str] = field(default_factory=list)


def _stamp(message: object, recorded_ns: int) -> tuple[int, bool]:
    """Time of a message in nanoseconds: its header's, or that of recording where there is none."""
    stamp = message.header.stamp
    time_ns = int(stamp.sec) * 10**9 + int(stamp.nanosec)
    return (time_ns, False) if time_ns > 0 else (recorded_ns, True)


def _copy_messages(bag: Bag, choice: Choice, writer: AslWriter, scales: tuple[float, float]) -> int:
    """Copies images and IMU; returns how many messages had no time of their own."""
    camera_of = {choice.left: "cam0", choice.right: "cam1"}
    without_time = 0
    names = [name for name in (choice.left, choice.right, choice.imu) if name]
    for topic, recorded_ns, message in bag.messages(names):
        time_ns, recorded = _stamp(message, recorded_ns)
        without_time += recorded
        if topic in camera_of:
            file = image_file(message, topic)
            writer.add_image(camera_of[topic], time_ns, file.content, file.suffix)
        else:
            w, a = message.angular_velocity, message.linear_acceleration
            writer.add_imu(time_ns, [scales[0] * v for v in (w.x, w.y, w.z)],
                           [scales[1] * v for v in (a.x, a.y, a.z)])
    return without_time


def _check_pairs(writer: AslWriter, choice: Choice) -> int:
    left, right = writer.image_counts()
    for count, topic in ((left, choice.left), (right, choice.right)):
        if count == 0:
            raise Error(f"topic {topic} holds no image")
    pairs, closest = writer.closest_pair_ns()
    if pairs == 0:
        raise Error(f"no image of {choice.left} was taken at the same time as one of {choice.right}: the "
                      f"closest two are {closest / 1e6:.3f} ms apart, 5 ms are allowed")
    return pairs


def _warnings(writer: AslWriter, without_time: int, unit: str) -> list[str]:
    warnings = []
    if without_time:
        warnings.append(f"{without_time} messages have no time in their header: that of recording is taken")
    if writer.repeated_images():
        warnings.append(f"{writer.repeated_images()} images repeat the time of an earlier one and are dropped")
    samples = writer.imu_samples()
    if len(samples):
        gravity = float(np.median(np.linalg.norm(samples[:, 3:], axis=1)))
        if not 0.7 * GRAVITY < gravity < 1.3 * GRAVITY:
            other = "; is it in g? then pass --acceleration-unit g" if unit == "m/s2" and \
                0.7 < gravity < 1.3 else ""
            warnings.append(f"the median acceleration is {gravity:.2f} m/s², far from 9.81{other}")
    return warnings


def convert(bag_path: Path, out: Path, *, topics: list[str] | None = None,
            calibration: list[Path] | None = None, acceleration_unit: str = "m/s2",
            gyroscope_unit: str = "rad/s") -> Conversion:
    """Writes the ASL folder `out`. Without topics they are guessed, without calibration camera_info is read.

    Raises Error with one sentence; `out` then is as it was.
    """
    scales = (GYROSCOPE_UNITS[gyroscope_unit], ACCELERATION_UNITS[acceleration_unit])
    with open_bag(bag_path) as bag:
        choice = parse_topics(topics, bag.topics) if topics else guess_topics(bag.topics)
        with AslWriter(out) as writer:
            said = copy_calibration(calibration, writer) if calibration else \
                write_from_camera_info(bag, choice, writer)
            without_time = _copy_messages(bag, choice, writer, scales)
            pairs = _check_pairs(writer, choice)
            left, right = writer.image_counts()
            return Conversion(choice, not topics, left, right, pairs, len(writer.imu_samples()), said,
                              _warnings(writer, without_time, acceleration_unit))


def describe(result: Conversion) -> list[str]:
    """The lines that say what was done."""
    choice = result.choice
    lines = [f"{'guessed topics' if result.guessed else 'topics'}: left={choice.left} right={choice.right}"
             + (f" imu={choice.imu}" if choice.imu else ", no IMU"),
             f"calibration: {result.calibration}",
             f"{result.left} left and {result.right} right images, {result.pairs} pairs, {result.imu} IMU "
             "readings"]
    return lines + [f"warning: {warning}" for warning in result.warnings]


def list_topics(bag_path: Path) -> list[str]:
    """A line a topic: messages, type, name."""
    with open_bag(bag_path) as bag:
        return [f"{topic.count:8d}  {topic.type:36s}  {topic.name}" for topic in bag.topics]


def add_bag_options(parser: argparse.ArgumentParser) -> None:
    """The options of everything that reads bags."""
    parser.add_argument("--topics", nargs="+", metavar="KEY=TOPIC",
                        help="left=… right=… [imu=…]; guessed from types and names without")
    parser.add_argument("--calib", nargs="+", type=Path, metavar="FILE",
                        help="Kalibr's camchain (and IMU) file, or a folder with these or with EuRoC's "
                             "cam0/sensor.yaml; without, the bag's camera_info (stereo alone)")
    parser.add_argument("--acceleration-unit", choices=list(ACCELERATION_UNITS), default="m/s2",
                        help="of the bag's IMU (default m/s2)")
    parser.add_argument("--gyroscope-unit", choices=list(GYROSCOPE_UNITS), default="rad/s",
                        help="of the bag's IMU (default rad/s)")


def add_parser(subparsers: argparse._SubParsersAction) -> argparse.ArgumentParser:
    """Registers the command."""
    parser = subparsers.add_parser("convert", help="a bag (ROS 1, ROS 2, MCAP) to an ASL folder",
                                   description=__doc__)
    parser.add_argument("bag", type=Path, help=".bag, .mcap or .db3 file, or a ROS 2 folder")
    parser.add_argument("--out", type=Path, help="folder to write")
    parser.add_argument("--list", action="store_true", help="list the topics and end")
    add_bag_options(parser)
    return parser


def main(arguments: argparse.Namespace) -> int:
    """Runs the command."""
    if arguments.list:
        print("\n".join(list_topics(arguments.bag)))
        return 0
    if arguments.out is None:
        raise Error("convert needs --out FOLDER (or --list)")
    result = convert(arguments.bag, arguments.out, topics=arguments.topics, calibration=arguments.calib,
                     acceleration_unit=arguments.acceleration_unit,
                     gyroscope_unit=arguments.gyroscope_unit)
    for line in describe(result):
        print(line, file=sys.stderr if line.startswith("warning") else sys.stdout)
    print(f"written: {arguments.out}")
    return 0
