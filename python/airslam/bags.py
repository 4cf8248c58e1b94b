# SPDX-License-Identifier: BSD-3-Clause
"""Reading bags: ROS 1 (.bag), ROS 2 (folder, .db3) and MCAP (.mcap), by the `rosbags` package."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from . import Error


RAW, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
IMU, CAMERA_INFO = "sensor_msgs/msg/Imu", "sensor_msgs/msg/CameraInfo"
LEFT_HINTS, RIGHT_HINTS = ("left", "cam0", "infra1", "cam_0"), ("right", "cam1", "infra2", "cam_1")


@dataclass(frozen=True)
class Topic:
    """One topic of a bag."""

    name: str
    type: str
    count: int


@dataclass(frozen=True)
class Choice:
    """The topics to take; imu is empty without one."""

    left: str
    right: str
    imu: str = ""


def is_bag(path: Path) -> bool:
    """Whether a path looks like a bag of one of the three kinds."""
    if path.is_dir():
        return (path / "metadata.yaml").exists()
    return path.suffix in (".bag", ".db3", ".mcap")


class Bag:
    """An open bag; see open_bag."""

    def __init__(self, path: Path, reader: object):
        self._path, self._reader = path, reader

    @property
    def topics(self) -> list[Topic]:
        """All topics with a known type, by name."""
        return [Topic(name, info.msgtype or "of several types", info.msgcount)
                for name, info in sorted(self._reader.topics.items())]

    def messages(self, names: list[str]) -> Iterator[tuple[str, int, object]]:
        """(topic, time of recording in nanoseconds, message) of the topics, in order of recording."""
        connections = [c for c in self._reader.connections if c.topic in names]
        with _damage_as_failure(self._path):
            for connection, time_ns, raw in self._reader.messages(connections=connections):
                yield connection.topic, time_ns, self._reader.deserialize(raw, connection.msgtype)

    def first(self, name: str) -> object | None:
        """The first message of a topic."""
        return next((message for _, _, message in self.messages([name])), None)


@contextmanager
def _damage_as_failure(path: Path) -> Iterator[None]:
    """Turns what `rosbags` raises on a damaged file, of whatever type, into one sentence."""
    try:
        yield
    except (Error, GeneratorExit, KeyboardInterrupt, MemoryError):
        raise
    except FileNotFoundError as error:
        raise Error(f"{path} cannot be read as a bag: {error}") from None
    except Exception as error:  # noqa: BLE001 (struct, apsw, zstd, its own: all mean a damaged file)
        reason = str(error).strip().rstrip(".") or type(error).__name__
        help_ = "; `rosbag reindex` may save what it holds" if path.suffix == ".bag" else \
            "; `mcap recover` may save what it holds" if path.suffix == ".mcap" else ""
        raise Error(f"{path} cannot be read, it is cut off, damaged or of another kind than its name "
                      f"says ({reason}){help_}") from None


@contextmanager
def open_bag(path: Path) -> Iterator[Bag]:
    """Opens a bag of any of the three kinds."""
    if not path.exists():
        raise Error(f"{path} does not exist")
    if not is_bag(path):
        raise Error(f"{path} is no bag: expected a .bag, .db3 or .mcap file, or a folder with "
                      "metadata.yaml")
    try:
        from rosbags.highlevel import AnyReader  # noqa: PLC0415 (optional)
        from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415
    except ImportError:
        raise Error("reading bags needs the package rosbags: pip install rosbags") from None
    with _damage_as_failure(path):
        # Bags of ROS 2 before Iron carry no definitions; those of sensor_msgs have not changed since.
        reader = AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE))
        reader.open()
    try:
        yield Bag(path, reader)
    finally:
        reader.close()


def _hinted(topics: list[Topic], hints: tuple[str, ...]) -> list[Topic]:
    return [topic for topic in topics if any(hint in topic.name.lower() for hint in hints)]


def guess_topics(topics: list[Topic]) -> Choice:
    """Chooses left, right and IMU by type and name; Error when that is ambiguous."""
    for kind in (RAW, COMPRESSED):
        images = [topic for topic in topics if topic.type == kind and topic.count > 0]
        left, right = _hinted(images, LEFT_HINTS), _hinted(images, RIGHT_HINTS)
        if len(images) == 2 and not (len(left) == 1 and len(right) == 1):
            left, right = images[:1], images[1:]
        if len(left) == 1 and len(right) == 1 and left != right:
            break
    else:
        seen = ", ".join(f"{t.name} ({t.type})" for t in topics if t.type in (RAW, COMPRESSED))
        raise Error("which topics are the left and the right camera cannot be guessed; choose with "
                      f"--topics left=… right=… among: {seen or 'none, there is no image topic'}")
    imus = sorted((t for t in topics if t.type == IMU and t.count > 0), key=lambda t: -t.count)
    return Choice(left[0].name, right[0].name, imus[0].name if imus else "")


def parse_topics(words: list[str], topics: list[Topic]) -> Choice:
    """The choice of `left=… right=… [imu=…]`, checked against what the bag holds."""
    chosen: dict[str, str] = {}
    for word in words:
        key, equals, name = word.partition("=")
        if key not in ("left", "right", "imu") or not equals or not name:
            raise Error(f"--topics takes left=…, right=… and imu=…, not \"{word}\"")
        chosen[key] = name
    known = {topic.name: topic for topic in topics}
    for key, name in chosen.items():
        if name not in known:
            raise Error(f"the bag has no topic {name}; it has: {', '.join(known) or 'none'}")
        expected = (IMU,) if key == "imu" else (RAW, COMPRESSED)
        if known[name].type not in expected:
            raise Error(f"topic {name} holds {known[name].type}, but {key}= needs "
                          f"{' or '.join(expected)}")
    if "left" not in chosen or "right" not in chosen:
        raise Error("--topics needs both left=… and right=…")
    return Choice(chosen["left"], chosen["right"], chosen.get("imu", ""))
