# SPDX-License-Identifier: BSD-3-Clause
"""Showing a run while it goes on: what `airslam.run` reports of each frame becomes a Scene."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from . import Error, Map, Trajectory, align
from .frame_pictures import used_lines
from .results import knows_gravity
from .scene import ESTIMATE, KEYPOINT, LINE, MATCH, TRACK, TRACKED, TRUTH, Scene

ALIGN_FROM = 10         # poses, before which the ground truth hangs on the first pose
ALIGN_DISTANCE = 0.3    # metres of path, likewise
MAP_SHARE = 0.1         # of the time may go into reading the growing map
# While the run goes on its world is that of its first body; what has been shown is turned upright at the end.
GOING_ON, FINISHED = "world/run", "world"


class TruthFollower:
    """Lays the ground truth over the estimate while the estimate grows."""

    def __init__(self, truth: Trajectory):
        self.times, self.poses = truth.timestamps_ns, truth.world_from_body
        self._estimate: list[np.ndarray] = []
        self._truth: list[np.ndarray] = []
        self._first: np.ndarray | None = None

    def add(self, time_ns: int, world_from_body: np.ndarray) -> None:
        """Adds a pose of the estimate; poses without ground truth within 10 ms are left out."""
        row = int(np.argmin(np.abs(self.times - time_ns)))
        if abs(int(self.times[row]) - time_ns) > 10_000_000:
            return
        if self._first is None:
            self._first = world_from_body @ np.linalg.inv(self.poses[row])
        self._estimate.append(world_from_body[:3, 3])
        self._truth.append(self.poses[row, :3, 3])

    def restart(self) -> None:
        """Forgets everything: the estimate has begun a new world."""
        self._estimate, self._truth, self._first = [], [], None

    def estimate_from_truth(self) -> np.ndarray | None:
        """The 4 x 4 transform as known so far."""
        path = np.array(self._estimate)
        long_enough = len(path) >= ALIGN_FROM and np.ptp(path, axis=0).max() > ALIGN_DISTANCE
        aligned = align(np.array(self._truth), path) if long_enough else None
        return self._first if aligned is None else aligned


class GrowingMap:
    """What a run has committed to its map file so far."""

    def __init__(self, file: Path):
        self._file = file
        self._next = 0.0
        self.content: Map | None = None

    def refresh(self) -> bool:
        """Reads the file again, unless that would cost more than a tenth of the time; True if it was read."""
        begin = time.monotonic()
        if begin < self._next or not self._file.exists():
            return False
        try:
            self.content = Map.load(self._file)
        except Error:  # before its first commit
            return False
        self._next = time.monotonic() + (time.monotonic() - begin) / MAP_SHARE
        return len(self.content) > 0


class LiveView:
    """Called with every frame of a run; `partial` is the map file that grows meanwhile."""

    def __init__(self, scene: Scene, truth: Trajectory | None, partial: Path):
        self._scene = scene
        self._map = GrowingMap(partial)
        self._truth = TruthFollower(truth) if truth is not None else None
        self._path: list[np.ndarray] = []
        self._poses: dict[int, np.ndarray] = {}  # as first estimated, by time
        self._tracked: dict[int, np.ndarray] = {}  # pixels of the last frame's landmarks, by id
        self._keyframe: object = None              # the last one
        self._frames: dict[int, int] = {}          # time: index of each frame
        scene.world(upright=False)
        scene.series_styles()

    def __call__(self, frame: object) -> None:
        """Logs one frame."""
        self._frames[frame.timestamp_ns] = frame.index
        self._at(frame.timestamp_ns)
        self._image(frame)
        self._pose(frame)
        if frame.lined is not None:
            self._lines(frame.lined, frame.timestamp_ns)
        self._scene.scalar("tracked", frame.tracked_points)
        for stage, milliseconds in frame.stage_ms.items():
            self._scene.scalar(f"stages/{stage.replace(' ', '_')}", milliseconds)
        if frame.gyroscope_bias is not None:
            self._scene.bias(frame.gyroscope_bias, frame.accelerometer_bias)
        if frame.is_keyframe and self._map.refresh():
            self._log_map(GOING_ON, self._map.content, frame.component)

    def _at(self, time_ns: int) -> None:
        start = next(iter(self._frames))
        self._scene.at((time_ns - start) * 1e-9, self._frames[time_ns])

    def _image(self, frame: object) -> None:
        if frame.left is None:
            return
        self._scene.image(frame.left)
        self._scene.pixels("keypoints", frame.keypoints, KEYPOINT, 1.6)
        before, self._tracked = self._tracked, dict(zip(frame.tracked_ids.tolist(), frame.tracked_pixels))
        self._scene.pixels("map", frame.tracked_pixels, TRACKED)
        self._scene.strips("motion", [np.array([before[key], pixel]) for key, pixel in self._tracked.items()
                                      if key in before], TRACK)
        matched, keyframe = [], frame.keyframe
        if keyframe is not None:
            matched = matches(self._keyframe, keyframe) if self._keyframe is not None else []
            self._keyframe = keyframe
        else:
            self._scene.strips("lines", [], LINE)  # they are of a keyframe: not of the frames after it
        self._scene.strips("matches", matched, MATCH, 0.5)

    def _lines(self, keyframe: object, now_ns: int) -> None:
        """Lines come later than their keyframe, and are shown with it."""
        if keyframe.timestamp_ns in self._frames:
            self._at(keyframe.timestamp_ns)
            self._scene.strips("lines", np.asarray(keyframe.lines)[used_lines(keyframe)].reshape(-1, 2, 2), LINE)
            self._at(now_ns)

    def _pose(self, frame: object) -> None:
        if frame.world_from_body is None:
            return
        if frame.state == "initialized" and self._path:  # a new component shares no world with the last
            self._path = []
            if self._truth is not None:
                self._truth.restart()
        self._poses[frame.timestamp_ns] = frame.world_from_body
        self._path.append(frame.world_from_body[:3, 3])
        self._scene.path(f"{GOING_ON}/trajectory", np.array(self._path), ESTIMATE)
        if self._truth is None:
            return
        self._truth.add(frame.timestamp_ns, frame.world_from_body)
        if frame.is_keyframe:
            self._log_truth(GOING_ON, int(self._truth.times[0]), frame.timestamp_ns)

    def _log_truth(self, world: str, begin_ns: int, end_ns: int) -> None:
        truth, move = self._truth, self._truth.estimate_from_truth()
        if move is None:
            return
        seen = (truth.times >= begin_ns) & (truth.times <= end_ns)
        self._scene.path(f"{world}/truth", truth.poses[seen, :3, 3] @ move[:3, :3].T + move[:3, 3], TRUTH, radius=0.008)

    def _log_map(self, world: str, content: Map, component: int, up: int = 1) -> None:
        rows = content.components == component
        self._scene.map(world, content.landmarks[content.landmark_components == component],
                        content.lines[content.line_components == component], up)
        self._scene.keyframes(f"{world}/keyframes", content.world_from_camera[rows],
                              content.calibration.camera_matrix, content.calibration.image_size)

    def _turn(self, estimate: Trajectory) -> None:
        """Takes away what was shown while the run went on, and lays it into the final world for times before."""
        self._scene.clear(GOING_ON)
        for time_ns, pose in zip(estimate.timestamps_ns.tolist(), estimate.world_from_body):
            if time_ns in self._poses:
                self._scene.transform(GOING_ON, pose @ np.linalg.inv(self._poses[time_ns]), static=True)
                return

    def finish(self, result: Path) -> None:
        """Logs the final map and trajectory, with z up where gravity became known, and the final alignment."""
        content = Map.load(result / "map.db")
        if len(content):
            self._lines(content.keyframe(len(content) - 1), max(self._frames))
        self._at(max(self._frames))
        upright = knows_gravity(content)
        self._scene.world(upright)
        estimate = Trajectory.load(result / "trajectory.tum")
        self._turn(estimate)
        self._log_map(FINISHED, content, content.largest_component, 2 if upright else 1)
        self._scene.path(f"{FINISHED}/trajectory", estimate.world_from_body[:, :3, 3], ESTIMATE)
        if self._truth is None or not len(estimate):
            return
        self._truth.restart()
        for time_ns, pose in zip(estimate.timestamps_ns.tolist(), estimate.world_from_body):
            self._truth.add(time_ns, pose)
        self._log_truth(FINISHED, int(estimate.timestamps_ns[0]), int(estimate.timestamps_ns[-1]))


def matches(before: object, keyframe: object) -> np.ndarray:
    """(n, 2, 2): pixels of the points that two keyframes both see, in the first and in the second."""
    ids = [np.asarray(k.landmark_ids) for k in (before, keyframe)]
    _, first, second = np.intersect1d(np.where(ids[0] >= 0, ids[0], -1), np.where(ids[1] >= 0, ids[1], -2),
                                      return_indices=True)
    return np.stack([np.asarray(before.keypoints)[first], np.asarray(keyframe.keypoints)[second]], axis=1)
