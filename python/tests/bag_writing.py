# SPDX-License-Identifier: BSD-3-Clause
"""Bags for the tests, written from frames of an ASL folder by the `rosbags` package."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin, Writer as Writer2
from rosbags.typesys import Stores, get_typestore

EXAMPLE = Path(__file__).resolve().parents[2] / "examples/warehouse_day"
KINDS = {"ros1": ".bag", "ros2": "", "mcap": ""}
LEFT, RIGHT, IMU = "/cam0/image_raw", "/cam1/image_raw", "/imu0"


def asl_images(camera: str, count: int, folder: Path = EXAMPLE) -> list[tuple[int, Path]]:
    """(time in nanoseconds, file) of the first images of cam0 or cam1."""
    with (folder / "mav0" / camera / "data.csv").open() as stream:
        rows = [row for row in csv.reader(stream) if not row[0].startswith("#")]
    return [(int(t), folder / "mav0" / camera / "data" / name.strip()) for t, name in rows[:count]]


def asl_imu(last_ns: int, folder: Path = EXAMPLE) -> list[tuple[int, list[float]]]:
    """(time, six values) of the readings up to a time."""
    with (folder / "mav0/imu0/data.csv").open() as stream:
        rows = [row for row in csv.reader(stream) if not row[0].startswith("#")]
    return [(int(r[0]), [float(v) for v in r[1:7]]) for r in rows if int(r[0]) <= last_ns]


def grey(file: Path) -> np.ndarray:
    """The pixels of a grey image file."""
    return np.asarray(Image.open(file))


class BagWriter:
    """Writes one bag of one of the three kinds; used as a context."""

    def __init__(self, path: Path, kind: str):
        self.ros1 = kind == "ros1"
        self.store = get_typestore(Stores.ROS1_NOETIC if self.ros1 else Stores.ROS2_HUMBLE)
        self.path = path.with_name(path.name + KINDS[kind])
        plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
        self._writer = Writer1(self.path) if self.ros1 else \
            Writer2(self.path, version=9, storage_plugin=plugin)
        self._connections: dict[str, object] = {}

    def __enter__(self) -> BagWriter:
        self._writer.open()
        return self

    def __exit__(self, *error: object) -> None:
        self._writer.close()

    def type(self, name: str) -> Callable[..., object]:
        return self.store.types[name]

    def header(self, time_ns: int, frame: str = "") -> object:
        stamp = self.type("builtin_interfaces/msg/Time")(sec=time_ns // 10**9, nanosec=time_ns % 10**9)
        extra = {"seq": 0} if self.ros1 else {}
        return self.type("std_msgs/msg/Header")(stamp=stamp, frame_id=frame, **extra)

    def write(self, topic: str, type_name: str, time_ns: int, message: object) -> None:
        if topic not in self._connections:
            self._connections[topic] = self._writer.add_connection(topic, type_name, typestore=self.store)
        raw = self.store.serialize_ros1(message, type_name) if self.ros1 else \
            self.store.serialize_cdr(message, type_name)
        self._writer.write(self._connections[topic], time_ns, raw)

    def image(self, topic: str, time_ns: int, encoding: str, pixels: np.ndarray, *, padding: int = 0,
              big_endian: bool = False, stamp_ns: int | None = None) -> None:
        stored = pixels.astype(pixels.dtype.newbyteorder(">")) if big_endian else pixels
        rows = np.ascontiguousarray(stored).view(np.uint8).reshape(pixels.shape[0], -1)
        rows = np.pad(rows, ((0, 0), (0, padding)))
        name = "sensor_msgs/msg/Image"
        self.write(topic, name, time_ns, self.type(name)(
            header=self.header(time_ns if stamp_ns is None else stamp_ns), height=pixels.shape[0],
            width=pixels.shape[1], encoding=encoding, is_bigendian=int(big_endian), step=rows.shape[1],
            data=rows.ravel()))

    def compressed(self, topic: str, time_ns: int, content: bytes, format_: str) -> None:
        name = "sensor_msgs/msg/CompressedImage"
        self.write(topic, name, time_ns, self.type(name)(
            header=self.header(time_ns), format=format_, data=np.frombuffer(content, np.uint8)))

    def imu(self, topic: str, time_ns: int, values: list[float]) -> None:
        vector = self.type("geometry_msgs/msg/Vector3")
        name = "sensor_msgs/msg/Imu"
        self.write(topic, name, time_ns, self.type(name)(
            header=self.header(time_ns),
            orientation=self.type("geometry_msgs/msg/Quaternion")(x=0.0, y=0.0, z=0.0, w=1.0),
            orientation_covariance=np.zeros(9), angular_velocity=vector(*values[:3]),
            angular_velocity_covariance=np.zeros(9), linear_acceleration=vector(*values[3:]),
            linear_acceleration_covariance=np.zeros(9)))

    def camera_info(self, topic: str, time_ns: int, model: str, d: list[float], k: np.ndarray,
                    r: np.ndarray, p: np.ndarray) -> None:
        name = "sensor_msgs/msg/CameraInfo"
        keys = {key.upper() if self.ros1 else key: np.asarray(value, dtype=float).ravel()
                for key, value in (("d", d), ("k", k), ("r", r), ("p", p))}
        roi = self.type("sensor_msgs/msg/RegionOfInterest")(
            x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
        self.write(topic, name, time_ns, self.type(name)(
            header=self.header(time_ns), height=480, width=752, distortion_model=model, binning_x=0,
            binning_y=0, roi=roi, **keys))


def png(pixels: np.ndarray) -> bytes:
    """The bytes of a PNG file."""
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "PNG")
    return stream.getvalue()


def write_compressed(path: Path, kind: str, frames: int) -> Path:
    """The first frames of the example sequence as the files that they are, with its IMU; returns the bag's path."""
    left, right = asl_images("cam0", frames), asl_images("cam1", frames)
    with BagWriter(path, kind) as bag:
        for (time, file), (_, other) in zip(left, right):
            bag.compressed("/left/compressed", time, file.read_bytes(), "jpeg")
            bag.compressed("/right/compressed", time, other.read_bytes(), "jpeg")
        for time, values in asl_imu(left[-1][0]):
            bag.imu("/imu", time, values)
    return bag.path


def write_example(path: Path, kind: str, frames: int = 4, right_shift_ns: int = 0) -> Path:
    """The first frames of the example sequence, raw mono8, with its IMU; returns the bag's path."""
    with BagWriter(path, kind) as bag:
        left, right = asl_images("cam0", frames), asl_images("cam1", frames)
        for time, values in asl_imu(left[-1][0]):
            bag.imu(IMU, time, values)
        for (time, left_file), (right_time, right_file) in zip(left, right):
            bag.image(LEFT, time, "mono8", grey(left_file))
            right_ns = right_time + right_shift_ns
            bag.image(RIGHT, right_ns, "mono8", grey(right_file))
    return bag.path
