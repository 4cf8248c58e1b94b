# SPDX-License-Identifier: BSD-3-Clause
"""`python -m airslam view`: a map or a result folder in the viewer, or as a recording (--save)."""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from . import Error, Map, Trajectory
from .frame_pictures import used_lines
from .raw_images import RawCamera, bent, left_images, raw_camera
from .results import compare, dataset_of, find_truth, knows_gravity
from .scene import ESTIMATE, KEYPOINT, LINE, TRACKED, TRUTH, Scene, written

MEDIA = {".jpg": "image/jpeg", ".jpeg": "image/jpeg", ".png": "image/png"}


@dataclass
class MapView:
    """What is shown: the largest component of a map, and what is known of the run that made it."""

    map: Map
    rows: np.ndarray        # of its keyframes
    trajectory: Trajectory  # of the run, else of the keyframes
    report: dict
    upright: bool

    @property
    def up(self) -> int:
        """The coordinate that is coloured as height (y points down where gravity is not known)."""
        return 2 if self.upright else 1


def load_view(path: Path) -> MapView:
    """Reads a map file or a result folder."""
    file = path / "map.db" if path.is_dir() else path
    if not file.exists():
        raise Error(f"{path} is neither a map file nor a folder that holds map.db")
    content = Map.load(file)
    if not len(content):
        raise Error(f"{file} holds no keyframe")
    rows = np.flatnonzero(content.components == content.largest_component)
    report_file = path / "report.json"
    report = json.loads(report_file.read_text()) if path.is_dir() and report_file.exists() else {}
    trajectory = Trajectory.load(path / "trajectory.tum") if report else \
        Trajectory.from_arrays(content.timestamps_ns[rows], content.world_from_body[rows])
    return MapView(content, rows, trajectory, report, knows_gravity(content, rows))


def _log_world(scene: Scene, view: MapView, truth: Path | None) -> None:
    content, component = view.map, view.map.largest_component
    scene.world(view.upright)
    scene.map("world", content.landmarks[content.landmark_components == component],
              content.lines[content.line_components == component], view.up, static=True)
    scene.keyframes("world/keyframes", content.world_from_camera[view.rows], content.calibration.camera_matrix,
                    content.calibration.image_size, static=True)
    scene.path("world/trajectory", view.trajectory.world_from_body[:, :3, 3], ESTIMATE, static=True)
    if truth is None:
        return
    known = Trajectory.load(truth)
    comparison = compare(known, view.trajectory)
    if comparison is None:
        raise Error(f"fewer than three poses have ground truth in {truth}")
    move = np.linalg.inv(comparison.truth_from_estimate)
    times = known.timestamps_ns
    during = (times >= comparison.times_ns[0]) & (times <= comparison.times_ns[-1])
    positions = known.world_from_body[during, :3, 3] @ move[:3, :3].T + move[:3, 3]
    scene.path("world/truth", positions, TRUTH, static=True, radius=0.008)


def _log_keyframe(scene: Scene, keyframe: object, file: Path | None, camera: RawCamera | None) -> None:
    """A keyframe's image with what it saw, in the pixels of the image on disk."""
    if file is not None and file.suffix.lower() in MEDIA:
        scene.encoded_image(file.read_bytes(), MEDIA[file.suffix.lower()])
    points = np.asarray(keyframe.keypoints, dtype=float)
    if camera is not None:
        points = camera.distort(points)
    seen = np.asarray(keyframe.landmark_ids) >= 0
    scene.pixels("keypoints", points[~seen], KEYPOINT, 1.6)
    scene.pixels("map", points[seen], TRACKED)
    scene.strips("lines", bent(np.asarray(keyframe.lines, dtype=float)[used_lines(keyframe)], camera), LINE)
    scene.scalar("tracked", int(seen.sum()))


def _log_keyframes(scene: Scene, view: MapView, dataset: Path | None) -> None:
    content = view.map
    images = left_images(dataset) if dataset is not None else {}
    camera = raw_camera(dataset, content.calibration.camera_matrix, content.calibration.body_from_camera) \
        if images else None
    start = int(view.trajectory.timestamps_ns[0])
    for number, row in enumerate(view.rows):
        time = int(content.timestamps_ns[row])
        scene.at((time - start) * 1e-9, number)
        _log_keyframe(scene, content.keyframe(int(row)), images.get(time), camera)
        scene.keyframes("world/current", content.world_from_camera[row][None], content.calibration.camera_matrix,
                        content.calibration.image_size)
        if np.isfinite(content.gyroscope_biases[row]).all():
            scene.bias(content.gyroscope_biases[row], content.accelerometer_biases[row])


def view_map(path: Path, *, truth: Path | None = None, dataset: Path | None = None,
             save: Path | None = None) -> None:
    """Shows a map in the viewer, or writes it as a recording. Ground truth and images are found by themselves."""
    view = load_view(path)
    if dataset is not None and not dataset.is_dir():
        raise Error(f"the data set {dataset} is no folder")
    dataset = dataset or dataset_of(view.report)
    scene = Scene(path.name, save)
    scene.series_styles()
    _log_world(scene, view, truth or find_truth(dataset))
    _log_keyframes(scene, view, dataset)
    scene.close()


def add_parser(subparsers: argparse._SubParsersAction) -> argparse.ArgumentParser:
    """Registers the command."""
    parser = subparsers.add_parser("view", help="a map in the viewer, or as a recording", description=__doc__)
    parser.add_argument("map", type=Path, help="map.db, or the folder of airslam map")
    parser.add_argument("--truth", type=Path, help="ground truth; found in the data set by itself")
    parser.add_argument("--dataset", type=Path, help="the images' folder, where it has moved since the run")
    parser.add_argument("--save", type=Path, metavar="FILE.rrd", help="write a recording instead of opening a "
                                                                      "window")
    return parser


def main(arguments: argparse.Namespace) -> int:
    """Runs the command."""
    view_map(arguments.map, truth=arguments.truth, dataset=arguments.dataset, save=arguments.save)
    if arguments.save is not None:
        print(written(arguments.save))
    return 0
