# SPDX-License-Identifier: BSD-3-Clause
"""Recordings hold what the viewer is to show, read back by rerun itself."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from mapped_example import mapped_example
from recordings import Recorded
from stand_ins import TRUTH

import airslam
from airslam import Error, view
from airslam.scene import frusta, height_colors


def test_a_recording_of_a_map(tmp_path: Path) -> None:
    dataset, result = mapped_example()
    view.view_map(result, save=tmp_path / "map.rrd")
    recorded = Recorded(tmp_path / "map.rrd")
    content = airslam.Map.load(result)
    assert np.array_equal(recorded.last("/world/points", "Points3D:positions"),
                          content.landmarks.astype(np.float32))
    lines = recorded.last("/world/lines", "LineStrips3D:strips")
    assert np.array_equal(lines, content.lines.astype(np.float32))
    path, = recorded.last("/world/trajectory", "LineStrips3D:strips")
    estimate = airslam.Trajectory.load(result / "trajectory.tum").world_from_body[:, :3, 3]
    assert np.array_equal(path, estimate.astype(np.float32))
    assert len(recorded.last("/world/keyframes", "LineStrips3D:strips")) == 3 * len(content)
    # The ground truth that lies in the data set, moved onto the estimate.
    truth, = recorded.last("/world/truth", "LineStrips3D:strips")
    gaps = np.linalg.norm(np.asarray(truth)[:, None] - estimate[None], axis=2).min(axis=0)
    assert gaps.max() < 0.02
    assert recorded.count("/camera/image", "EncodedImage:blob") == len(content)
    seen = int((np.asarray(content.keyframe(2).landmark_ids) >= 0).sum())
    assert len(recorded.nth("/camera/image/map", "Points2D:positions", 2)) == seen
    assert recorded.nth("/plots/tracked", "Scalars:scalars", 2) == [seen]
    for entity in ("/camera/image/keypoints", "/camera/image/lines", "/plots/gyroscope_bias/x",
                   "/plots/accelerometer_bias/z", "/world/current"):
        assert recorded.has(entity)


def test_a_map_file_alone(tmp_path: Path) -> None:
    _, result = mapped_example()
    view.view_map(result / "map.db", save=tmp_path / "map.rrd")
    recorded = Recorded(tmp_path / "map.rrd")
    assert recorded.has("/world/points") and recorded.has("/world/trajectory")
    assert not recorded.has("/world/truth") and not recorded.has("/camera/image")


def test_truth_and_images_can_be_named(tmp_path: Path) -> None:
    dataset, result = mapped_example()
    view.view_map(result / "map.db", save=tmp_path / "map.rrd", truth=dataset / TRUTH, dataset=dataset)
    recorded = Recorded(tmp_path / "map.rrd")
    assert recorded.has("/world/truth") and recorded.has("/camera/image")


def test_failures_are_sentences(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _, result = mapped_example()
    with pytest.raises(Error, match="neither a map file nor a folder"):
        view.view_map(tmp_path / "none", save=tmp_path / "a.rrd")
    with pytest.raises(Error, match="is no folder"):
        view.view_map(result, save=tmp_path / "a.rrd", dataset=tmp_path / "none")
    for variable in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(variable, raising=False)
    with pytest.raises(Error, match="no display .* --save"):
        view.view_map(result)
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(Error, match=r"needs rerun, which is not installed: pip install '\.\[view\]'"):
        view.view_map(result, save=tmp_path / "a.rrd")


def test_a_frustum_opens_along_the_view() -> None:
    matrix = np.array([[100.0, 0, 50], [0, 100, 40], [0, 0, 1]])
    pose = np.eye(4)
    pose[:3, 3] = [1, 2, 3]
    strips = frusta(pose[None], matrix, (100, 80), depth=2.0).reshape(-1, 3)
    assert strips[:, 2].min() == 3 and strips[:, 2].max() == 5
    corners = np.unique(strips[strips[:, 2] == 5], axis=0)
    assert corners == pytest.approx(np.array([[0, 1.2, 5], [0, 2.8, 5], [2, 1.2, 5], [2, 2.8, 5]]))


def test_colors_of_height_are_ordered_and_bounded() -> None:
    colors = height_colors(np.array([-9.0, 0, 0.5, 1, 9]), 0, 1)
    assert np.array_equal(colors[0], colors[1]) and np.array_equal(colors[3], colors[4])
    assert not np.array_equal(colors[1], colors[2])
