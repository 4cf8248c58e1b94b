# SPDX-License-Identifier: BSD-3-Clause
"""What is shown of a run while it goes on."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import rerun
from mapped_example import mapped_example
from recordings import Recorded
from stand_ins import TRUTH

import airslam
from airslam.live import GrowingMap, LiveView, TruthFollower, matches
from airslam.scene import Scene


def pose(position: np.ndarray, degrees: float = 0) -> np.ndarray:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    matrix = np.eye(4)
    matrix[:3, :3] = [[c, -s, 0], [s, c, 0], [0, 0, 1]]
    matrix[:3, 3] = position
    return matrix


def path(count: int) -> np.ndarray:
    """A bent path, metres."""
    t = np.linspace(0, 2, count)
    return np.column_stack([t, np.sin(2 * t), 0.3 * t**2])


def test_truth_hangs_on_the_first_pose_and_is_aligned_later() -> None:
    world = pose([4, -2, 1], 35)  # estimate from truth
    poses = np.stack([pose(p, 5 * i) for i, p in enumerate(path(30))])
    times = np.arange(30) * 10**8
    follower = TruthFollower(airslam.Trajectory.from_arrays(times, poses))
    assert follower.estimate_from_truth() is None
    follower.add(5 * 10**7, np.eye(4))  # no ground truth near
    assert follower.estimate_from_truth() is None
    error = pose([0, 0, 0], 3)  # the first orientation is estimated with an error, positions are not
    for i, (time, truth) in enumerate(zip(times, poses)):
        estimate = world @ truth
        estimate[:3, :3] = estimate[:3, :3] @ error[:3, :3]
        follower.add(int(time), estimate)
        if i == 0:
            assert follower.estimate_from_truth() == pytest.approx(estimate @ np.linalg.inv(truth))
    assert follower.estimate_from_truth() == pytest.approx(world, abs=1e-9)
    follower.restart()
    assert follower.estimate_from_truth() is None


def frame(index: int, **changes: object) -> SimpleNamespace:
    """A frame as airslam.run reports it."""
    values = {"index": index, "timestamp_ns": 10**18 + index * 10**8, "state": "tracked" if index else "initialized",
              "world_from_body": pose(path(30)[index % 30]), "left": np.full((48, 64), index, np.uint8),
              "keypoints": np.array([[1.0, 2], [3, 4], [5, 6]]), "tracked_points": 2, "component": 0,
              "is_keyframe": index % 4 == 0, "stage_ms": {"track": 2.0 + index, "detect left": 9.0}, "keyframe": None,
              "lined": None,
              "tracked_ids": np.array([7, 10 + index]), "tracked_pixels": np.array([[10.0 + index, 5], [20, 30]]),
              "gyroscope_bias": None, "accelerometer_bias": None}
    return SimpleNamespace(**{**values, **changes})


def record(tmp_path: Path, frames: list[SimpleNamespace], truth: airslam.Trajectory | None = None,
           partial: Path = Path("/nowhere/map.db")) -> Recorded:
    scene = Scene("test", tmp_path / "live.rrd", live=True)
    view = LiveView(scene, truth, partial)
    for each in frames:
        view(each)
    scene.close()
    return Recorded(tmp_path / "live.rrd")


def test_each_frame_is_recorded(tmp_path: Path) -> None:
    recorded = record(tmp_path, [frame(i) for i in range(6)])
    assert recorded.count("/camera/image", "EncodedImage:blob") == 6
    assert [recorded.nth("/plots/stages/track", "Scalars:scalars", i)[0] for i in range(6)] == [2, 3, 4, 5, 6, 7]
    assert recorded.has("/plots/stages/detect_left")
    strip, = recorded.last("/world/run/trajectory", "LineStrips3D:strips")
    assert strip == pytest.approx(path(30)[:6], abs=1e-6)
    assert not recorded.has("/world/run/points") and not recorded.has("/world/run/truth")
    assert recorded.last("/camera/image/map", "Points2D:positions") == pytest.approx(np.array([[15.0, 5], [20, 30]]))
    motion, = recorded.last("/camera/image/motion", "LineStrips2D:strips")  # of the one that the frame before shows too
    assert np.asarray(motion) == pytest.approx(np.array([[14.0, 5], [15, 5]]))


def test_frames_without_image_or_pose_are_no_error(tmp_path: Path) -> None:
    lost = {"world_from_body": None, "component": -1}
    recorded = record(tmp_path, [frame(0), frame(1, left=None, state="skipped", **lost),
                                 frame(2, state="lost", **lost), frame(3)])
    assert recorded.count("/camera/image", "EncodedImage:blob") == 3
    strip, = recorded.last("/world/run/trajectory", "LineStrips3D:strips")
    assert len(strip) == 2


def test_a_new_component_begins_a_new_path(tmp_path: Path) -> None:
    recorded = record(tmp_path, [frame(0), frame(1), frame(2), frame(3, state="initialized"), frame(4)])
    strip, = recorded.last("/world/run/trajectory", "LineStrips3D:strips")
    assert strip == pytest.approx(path(30)[3:5], abs=1e-6)


def test_truth_and_the_growing_map(tmp_path: Path) -> None:
    """Frames of a run beside the map that it left, as if that had been there from the beginning."""
    dataset, result = mapped_example()
    content = airslam.Map.load(result)
    estimate = airslam.Trajectory.load(result / "trajectory.tum")
    times = content.timestamps_ns.tolist()
    rows = {t: row for row, t in enumerate(times)}
    frames = [frame(i, timestamp_ns=int(t), world_from_body=p, is_keyframe=int(t) in times,
                    keyframe=content.keyframe(rows[t]) if t in rows else None,
                    lined=content.keyframe(rows[t] - 1) if rows.get(t) else None,
                    gyroscope_bias=np.full(3, 0.1) if i > 9 else None, accelerometer_bias=np.full(3, 0.2))
              for i, (t, p) in enumerate(zip(estimate.timestamps_ns, estimate.world_from_body))]
    recorded = record(tmp_path, frames, airslam.Trajectory.load(dataset / TRUTH), result / "map.db")
    assert np.array_equal(recorded.last("/world/run/points", "Points3D:positions"), content.landmarks.astype(np.float32))
    assert recorded.has("/world/run/keyframes") and recorded.has("/world/run/lines")
    truth, = recorded.last("/world/run/truth", "LineStrips3D:strips")
    last = max(i for i, each in enumerate(frames) if each.is_keyframe)
    gaps = np.linalg.norm(np.asarray(truth)[:, None] - estimate.world_from_body[None, :last, :3, 3], axis=2)
    assert gaps.min(axis=0).max() < 0.02
    # Lines and matches stand at their keyframes' times; the frames after them have none. Biases from when they are known.
    strips = [recorded.nth("/camera/image/lines", "LineStrips2D:strips", i) for i in range(recorded.count(
        "/camera/image/lines", "LineStrips2D:strips"))]
    assert sum(len(s) > 0 for s in strips) == len(times) - 1 and sum(len(s) == 0 for s in strips) >= 20
    assert len(strips) == len(frames) - 1 and len(strips[0]) > 0  # of the last keyframe the lines are still to come
    assert recorded.count("/plots/accelerometer_bias/y", "Scalars:scalars") == len(frames) - 10
    second = [each.is_keyframe for each in frames].index(True, 1)
    matched = recorded.nth("/camera/image/matches", "LineStrips2D:strips", second)
    assert len(matched) == len(matches(content.keyframe(0), content.keyframe(1))) > 0


def test_the_growing_map_is_not_read_all_the_time() -> None:
    growing = GrowingMap(mapped_example()[1] / "map.db")
    assert growing.content is None and growing.refresh() and len(growing.content) > 0
    assert not growing.refresh()  # not again so soon


def test_matches_are_what_both_keyframes_see() -> None:
    first = SimpleNamespace(landmark_ids=np.array([5, -1, 7, 9]), keypoints=np.arange(8.0).reshape(4, 2))
    second = SimpleNamespace(landmark_ids=np.array([-1, 9, 3, 5]), keypoints=10 + np.arange(8.0).reshape(4, 2))
    assert matches(first, second).tolist() == [[[0, 1], [16, 17]], [[6, 7], [12, 13]]]


def test_the_end_shows_what_the_run_has_left(tmp_path: Path) -> None:
    dataset, result = mapped_example()
    estimate = airslam.Trajectory.load(result / "trajectory.tum")
    scene = Scene("test", tmp_path / "live.rrd", live=True)
    view = LiveView(scene, airslam.Trajectory.load(dataset / TRUTH), tmp_path / "none.db")
    for i, time in enumerate(estimate.timestamps_ns.tolist()):
        view(frame(i, timestamp_ns=time))
    view.finish(result)
    scene.close()
    recorded = Recorded(tmp_path / "live.rrd")
    strip, = recorded.last("/world/trajectory", "LineStrips3D:strips")
    assert np.array_equal(strip, estimate.world_from_body[:, :3, 3].astype(np.float32))
    assert recorded.has("/world/points") and recorded.has("/world/keyframes")
    # What was shown before is gone now, and was turned into the final world.
    assert recorded.has("/world/run/trajectory") and recorded.count("/world/run", "Clear:is_recursive") == 1
    turn = np.eye(4)
    turn[:3, :3] = recorded.last("/world/run", "Transform3D:mat3x3").reshape(3, 3).T  # column by column
    turn[:3, 3] = recorded.last("/world/run", "Transform3D:translation").ravel()
    assert turn @ pose(path(30)[0]) == pytest.approx(estimate.world_from_body[0], abs=1e-6)
    truth, = recorded.last("/world/truth", "LineStrips3D:strips")
    gaps = np.linalg.norm(np.asarray(truth)[:, None] - estimate.world_from_body[None, :, :3, 3], axis=2)
    assert gaps.min(axis=0).max() < 0.02


def in_window(monkeypatch: pytest.MonkeyPatch, spawn: Callable[..., None]) -> Scene:
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(rerun, "spawn", spawn)
    return Scene("test", None, live=True)


def test_the_window_needs_no_activated_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: dict = {}
    in_window(monkeypatch, lambda **options: asked.update(options))
    assert Path(asked["executable_path"]) == Path(sys.executable).with_name("rerun")
    assert Path(asked["executable_path"]).exists()


def test_a_window_that_does_not_open_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    def spawn(**_: object) -> None:
        raise RuntimeError("Failed to find the viewer.\nA page of advice.")

    with pytest.raises(airslam.Error, match=r"did not start \(Failed to find the viewer\.\): record with --save"):
        in_window(monkeypatch, spawn)


def test_a_window_that_is_closed_ends_no_run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture) -> None:
    def flush() -> None:
        raise RuntimeError("gRPC connection severed")

    scene = in_window(monkeypatch, lambda **_: None)
    scene.stream = SimpleNamespace(flush=flush, disconnect=lambda: None)
    scene.close()
    assert "closed before the end" in capsys.readouterr().err
