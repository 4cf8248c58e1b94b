# SPDX-License-Identifier: BSD-3-Clause
"""What the viewer shows, as entities of a rerun recording.

    world                     metres, z up where gravity is known
    world/truth               ground truth, laid over the estimate
    world/trajectory          of the body
    world/keyframes           frusta of the keyframes
    world/points, world/lines the map
    world/run/…               the same four and the ground truth while a run goes on
    camera/image              the left image, and below it
        keypoints             what was detected
        map                   points of the map: those a keyframe sees (view), where the pose expects them (run)
        motion                how these have moved since the frame before (run)
        lines                 of keyframes
        matches               points that the keyframe before sees as well, from there to here (run)
    plots/…                   scalars over time: stages (ms), tracked points, biases, position error

Times: `time`, seconds since the first frame, and `frame`, its number.
"""

from __future__ import annotations

import io
import os
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
from PIL import Image

from . import Error


ESTIMATE, TRUTH, KEYFRAME = (255, 130, 30), (205, 210, 215), (70, 150, 220)
TRACKED, KEYPOINT, LINE, TRACK, MATCH = (39, 224, 160), (255, 255, 255), (255, 157, 46), (39, 224, 160), (200, 120, 255)
AXIS_COLORS = ((255, 130, 30), (70, 150, 220), (160, 150, 230))
FRUSTUM_DEPTH = 0.25  # metres
MISSING = "the viewer needs rerun, which is not installed: pip install '.[view]' (or rerun-sdk)"


def written(recording: Path) -> str:
    """What the user is told of a recording."""
    return f"written: {recording} ({recording.stat().st_size / 1e6:.1f} MB); open it with `rerun {recording}`"


def load_rerun() -> ModuleType:
    """The rerun package, or one sentence when it is missing."""
    try:
        import rerun  # noqa: PLC0415 (optional)
    except ImportError:
        raise Error(MISSING) from None
    return rerun


def _blueprint(live: bool) -> object:
    """The layout: the map, the image, and the plots that there are."""
    import rerun.blueprint as blueprint  # noqa: PLC0415

    def series(name: str, origin: str) -> object:
        return blueprint.TimeSeriesView(name=name, origin=origin)

    stages = [series("milliseconds a stage", "plots/stages")] if live else []
    return blueprint.Blueprint(
        blueprint.Horizontal(
            blueprint.Spatial3DView(name="map", origin="world", background=[24, 26, 30]),
            blueprint.Vertical(
                blueprint.Spatial2DView(name="left image", origin="camera"),
                blueprint.Tabs(*stages, series("gyroscope bias", "plots/gyroscope_bias"),
                               series("accelerometer bias", "plots/accelerometer_bias")),
                series("points tracked", "plots/tracked"), row_shares=[3, 2, 1.4]),
            column_shares=[3, 2]),
        blueprint.TimePanel(state="collapsed"), blueprint.SelectionPanel(state="collapsed"),
        blueprint.BlueprintPanel(state="collapsed"))


class Scene:
    """A recording: into a file (`save`) or into a viewer that is started (`save` is None)."""

    def __init__(self, name: str, save: Path | None, *, live: bool = False):
        self._rerun = load_rerun()
        self.stream = self._rerun.RecordingStream(f"airslam {name}")
        layout = _blueprint(live)
        self._in_window = save is None
        if save is not None:
            save.parent.mkdir(parents=True, exist_ok=True)
            self.stream.save(str(save), default_blueprint=layout)
        else:
            if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
                raise Error("there is no display to open the viewer on: record with --save run.rrd and open "
                              "that elsewhere with `rerun run.rrd`")
            self._open_window(layout)

    def _open_window(self, layout: object) -> None:
        """Starts the viewer. Its program lies beside the interpreter, also where no environment was activated."""
        beside = Path(sys.executable).with_name("rerun")
        try:
            self._rerun.spawn(executable_path=str(beside) if beside.exists() else None, default_blueprint=layout,
                              recording=self.stream)
        except RuntimeError as error:
            reason = str(error).strip().partition("\n")[0]
            raise Error(f"the viewer did not start ({reason}): record with --save run.rrd and open that with "
                        "`rerun run.rrd`") from None

    def close(self) -> None:
        """Writes out what is left. A window that was closed meanwhile misses it, and nothing else does."""
        try:
            self.stream.flush()
        except RuntimeError:
            if not self._in_window:
                raise
            print("the viewer was closed before the end", file=sys.stderr)
        self.stream.disconnect()

    def at(self, seconds: float, frame: int) -> None:
        """The time of what is logged next."""
        self.stream.set_time("time", duration=seconds)
        self.stream.set_time("frame", sequence=frame)

    def log(self, path: str, value: object, *, static: bool = False) -> None:
        """Logs one value."""
        self.stream.log(path, value, static=static)

    def world(self, upright: bool) -> None:
        """How the world lies."""
        axes = self._rerun.ViewCoordinates
        self.log("world", axes.RIGHT_HAND_Z_UP if upright else axes.RIGHT_HAND_Y_DOWN, static=True)

    def path(self, entity: str, positions: np.ndarray, color: tuple[int, int, int], *, static: bool = False,
             radius: float = 0.016) -> None:
        """A polyline (n, 3)."""
        self.log(entity, self._rerun.LineStrips3D([positions], colors=[color], radii=[radius]), static=static)

    def transform(self, entity: str, matrix: np.ndarray, *, static: bool = False) -> None:
        """The pose (4 x 4) of an entity in its parent."""
        self.log(entity, self._rerun.Transform3D(translation=matrix[:3, 3], mat3x3=matrix[:3, :3]), static=static)

    def keyframes(self, entity: str, world_from_camera: np.ndarray, camera_matrix: np.ndarray,
                  size: tuple[int, int], *, static: bool = False) -> None:
        """Frusta of cameras (n, 4, 4), as lines."""
        strips = frusta(world_from_camera, camera_matrix, size)
        self.log(entity, self._rerun.LineStrips3D(strips, colors=[KEYFRAME], radii=[0.004]), static=static)

    def map(self, entity: str, points: np.ndarray, lines: np.ndarray, up: int, *, static: bool = False) -> None:
        """Points (n, 3) and lines (m, 2, 3), coloured by the coordinate `up`."""
        low, high = np.percentile(points[:, up], [2, 98]) if len(points) else (0.0, 1.0)
        color = lambda heights: height_colors(heights, float(low), float(high))  # noqa: E731
        self.log(f"{entity}/points", self._rerun.Points3D(points, colors=color(points[:, up]), radii=[0.02]),
                 static=static)
        self.log(f"{entity}/lines", self._rerun.LineStrips3D(
            lines, colors=color(lines[:, :, up].mean(axis=1)), radii=[0.015]), static=static)

    def image(self, pixels: np.ndarray) -> None:
        """The left image (h, w) uint8, as JPEG."""
        stream = io.BytesIO()
        Image.fromarray(pixels).save(stream, "JPEG", quality=80)
        self.encoded_image(stream.getvalue(), "image/jpeg")

    def encoded_image(self, content: bytes, media_type: str) -> None:
        """The left image as the bytes of a file."""
        self.log("camera/image", self._rerun.EncodedImage(contents=content, media_type=media_type))

    def pixels(self, name: str, positions: np.ndarray, color: tuple[int, int, int], radius: float = 2.0) -> None:
        """Points (n, 2) over the image."""
        self.log(f"camera/image/{name}", self._rerun.Points2D(positions, colors=[color], radii=[radius]))

    def strips(self, name: str, strips: list | np.ndarray, color: tuple[int, int, int], radius: float = 1.0) -> None:
        """Polylines over the image."""
        self.log(f"camera/image/{name}", self._rerun.LineStrips2D(strips, colors=[color], radii=[radius]))

    def scalar(self, path: str, value: float) -> None:
        """One value of a plot."""
        self.log(f"plots/{path}", self._rerun.Scalars([float(value)]))

    def bias(self, gyroscope: np.ndarray, accelerometer: np.ndarray) -> None:
        """Biases (3,) in rad/s and m/s²."""
        for name, values in (("gyroscope_bias", gyroscope), ("accelerometer_bias", accelerometer)):
            for axis, value in zip("xyz", values):
                self.scalar(f"{name}/{axis}", value)

    def series_styles(self) -> None:
        """Names and colours of the plots' axes."""
        for name in ("gyroscope_bias", "accelerometer_bias"):
            for axis, color in zip("xyz", AXIS_COLORS):
                self.log(f"plots/{name}/{axis}", self._rerun.SeriesLines(colors=[color], names=[axis]), static=True)
        self.log("plots/tracked", self._rerun.SeriesLines(colors=[KEYFRAME], names=["points tracked"]), static=True)

    def clear(self, entity: str) -> None:
        """Removes an entity and what is below it from now on."""
        self.log(entity, self._rerun.Clear(recursive=True))


def frusta(world_from_camera: np.ndarray, camera_matrix: np.ndarray, size: tuple[int, int],
           depth: float = FRUSTUM_DEPTH) -> np.ndarray:
    """(2 n, 5, 3): a polyline centre–two corners–centre and the rest of each frustum."""
    width, height = size
    corners = np.array([[0, 0, 1], [width, 0, 1], [width, height, 1], [0, height, 1]]) @ \
        np.linalg.inv(camera_matrix).T * depth
    zero = np.zeros(3)
    a, b, c, d = corners
    shape = np.array([[a, b, c, d, a], [a, zero, b, zero, c], ])
    shape = np.concatenate([shape, [[c, zero, d, zero, a]]])
    moved = np.einsum("nij,skj->nski", world_from_camera[:, :3, :3], shape) + \
        world_from_camera[:, None, None, :3, 3]
    return moved.reshape(-1, 5, 3)


def height_colors(heights: np.ndarray, low: float, high: float) -> np.ndarray:
    """(n, 3) uint8: from blue over green to orange."""
    stops = np.array([[90, 110, 220], [50, 180, 190], [110, 205, 110], [250, 190, 80]], dtype=float)
    share = np.clip((np.asarray(heights) - low) / max(high - low, 1e-9), 0, 1) * (len(stops) - 1)
    left = np.minimum(share.astype(int), len(stops) - 2)
    return (stops[left] + (share - left)[:, None] * (stops[left + 1] - stops[left])).astype(np.uint8)
