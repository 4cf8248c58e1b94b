# SPDX-License-Identifier: BSD-3-Clause
"""Feeds images and IMU readings one by one, as a robot's driver would: python 02_frame_by_frame.py [<out>]

Needs pillow to read the images; on a robot they come from the cameras.
"""

import csv
import sys
from pathlib import Path

import numpy as np
from PIL import Image

import airslam

folder = Path(__file__).resolve().parents[1] / "warehouse_day" / "mav0"
out = sys.argv[1] if len(sys.argv) > 1 else "out/example_02"


def rows(file):
    """The rows of an EuRoC csv file, without its head."""
    return [row for row in csv.reader(file.open()) if not row[0].startswith("#")]


def grey(file):
    """uint8, height x width."""
    return np.array(Image.open(file).convert("L"))


# The calibration: of the folder here; airslam.Camera(intrinsics, image_size, ...) makes one of numbers.
rig = airslam.StereoRig.load(folder.parent)
odometry = airslam.Odometry(rig, out=out)

readings = [(int(t), np.array(rest, dtype=float)) for t, *rest in rows(folder / "imu0" / "data.csv")]
images = zip(rows(folder / "cam0" / "data.csv"), rows(folder / "cam1" / "data.csv"))
next_reading = 0
for (time, left), (_, right) in images:
    # Everything in order of time. A frame waits for the first reading after it.
    while next_reading < len(readings) and readings[next_reading][0] <= int(time):
        t, (gx, gy, gz, ax, ay, az) = readings[next_reading]
        odometry.add_imu(t, np.array([gx, gy, gz]), np.array([ax, ay, az]))
        next_reading += 1
    done = odometry.add_frame(int(time), grey(folder / "cam0" / "data" / left), grey(folder / "cam1" / "data" / right))
    for frame in done:  # those that are finished meanwhile
        if frame.is_keyframe:
            print(f"keyframe at frame {frame.index}: {frame.tracked_points} points, at", frame.world_from_body[:3, 3])
for t, reading in readings[next_reading:]:
    odometry.add_imu(t, reading[:3].copy(), reading[3:].copy())

result = odometry.finish()
print(result.map, "IMU:", result.report["inertial"]["state"])
