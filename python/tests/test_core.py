# SPDX-License-Identifier: BSD-3-Clause
"""The package gives what the program gives, bit for bit, and behaves as Python's users expect."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

import airslam
from mapped_example import mapped_example
from stand_ins import PROGRAM


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, airslam.RunResult, list[airslam.Frame]]:
    """The example's run by the package: its folder, its result, its frames."""
    out, frames = tmp_path_factory.mktemp("package") / "result", []
    result = airslam.run(mapped_example()[0], out, on_frame=frames.append)
    return out, result, frames


def test_run_writes_what_the_program_writes(run: tuple) -> None:
    by_program, (by_package, _, _) = mapped_example()[1], run
    for name in ("trajectory.tum", "trajectory_online.tum", "keyframes.tum"):
        assert (by_package / name).read_bytes() == (by_program / name).read_bytes(), name
        assert (by_package / name).stat().st_size > 0
    told = subprocess.run([PROGRAM, "info", "--json", by_program], check=True, capture_output=True).stdout
    assert airslam.info(by_package) == {**json.loads(told), **{
        k: airslam.info(by_package)[k] for k in ("file_bytes", "bytes_per_keyframe")}}


def test_result_in_memory_is_that_of_the_files(run: tuple) -> None:
    out, result, _ = run
    result.trajectory.save_tum(out / "again.tum")
    assert (out / "again.tum").read_bytes() == (out / "trajectory.tum").read_bytes()
    assert result.report["keyframes"] == len(result.map)
    stored = airslam.Map.load(out)
    for name in ("keyframe_ids", "timestamps_ns", "components", "world_from_body", "landmark_ids", "landmarks",
                 "lines", "observations", "line_observations"):
        np.testing.assert_array_equal(getattr(stored, name), getattr(result.map, name), err_msg=name)


def test_frames_tell_what_happened(run: tuple) -> None:
    _, result, frames = run
    assert [f.index for f in frames] == list(range(result.report["frames"]))
    assert frames[0].state == "initialized" and frames[0].is_keyframe
    assert frames[0].left.dtype == np.uint8 and frames[0].left.shape[::-1] == result.map.calibration.image_size
    assert frames[0].keypoints.shape[1] == 2
    np.testing.assert_allclose(frames[0].world_from_body, np.eye(4), atol=1e-12)
    assert sum(f.is_keyframe for f in frames) == len(result.map)
    with pytest.raises(ValueError, match="read-only"):
        frames[0].left[0, 0] = 0


def test_frames_tell_what_holds_them(run: tuple) -> None:
    _, result, frames = run
    kept = set(result.map.landmark_ids.tolist())
    rows = dict(zip(result.map.timestamps_ns.tolist(), range(len(result.map))))
    last_pixels, shared, motion = {}, 0, []
    for frame in frames:
        assert frame.tracked_pixels.shape == (frame.tracked_points, 2) and frame.tracked_ids.shape == (frame.tracked_points,)
        assert (frame.keyframe is not None) == frame.is_keyframe
        pixels = dict(zip(frame.tracked_ids.tolist(), frame.tracked_pixels))
        assert len(pixels) == frame.tracked_points
        shared += len(kept & pixels.keys())
        motion += [np.linalg.norm(pixel - last_pixels[key]) for key, pixel in pixels.items() if key in last_pixels]
        last_pixels = pixels
        if not frame.is_keyframe:
            continue
        stored = result.map.keyframe(rows[frame.timestamp_ns])
        np.testing.assert_array_equal(frame.keyframe.keypoints, stored.keypoints)
        assert frame.keyframe.id == stored.id and len(frame.keyframe.lines) == 0
    assert shared > 0.8 * sum(f.tracked_points for f in frames)  # bundle adjustment drops some
    assert 0 < np.median(motion) < 30
    # Each keyframe has its lines when the next one is made.
    keyframes, lined = [f.keyframe for f in frames if f.is_keyframe], [f.lined for f in frames if f.lined is not None]
    assert [k.id for k in lined] == [k.id for k in keyframes[:-1]] and not any(f.lined for f in frames if not f.is_keyframe)
    for keyframe in lined:
        np.testing.assert_array_equal(keyframe.lines, result.map.keyframe(rows[keyframe.timestamp_ns]).lines)
        assert len(keyframe.lines) > 10


def test_frames_know_the_imu_once_it_is_initialised(run: tuple) -> None:
    frames = run[2]
    known = [f.gravity is not None for f in frames]
    assert not known[0] and known[-1] and all(known[known.index(True):])
    assert run[1].report["inertial"]["state"] == "used"
    last = frames[-1]
    assert np.linalg.norm(last.gravity) == pytest.approx(9.81, abs=0.1)
    # Gravity is told in the world of the first body; in the result it points down.
    turn = run[1].trajectory.world_from_body[-1] @ np.linalg.inv(last.world_from_body)
    assert turn[:3, :3] @ last.gravity == pytest.approx([0, 0, -np.linalg.norm(last.gravity)], abs=0.2)
    step = (last.world_from_body - frames[-2].world_from_body)[:3, 3] / (1e-9 * (last.timestamp_ns - frames[-2].timestamp_ns))
    assert last.velocity == pytest.approx(step, abs=0.2)
    assert np.abs(last.gyroscope_bias).max() < 0.1 and np.abs(last.accelerometer_bias).max() < 1
    first = frames[0]
    assert first.velocity is None and first.gyroscope_bias is None and first.accelerometer_bias is None


def test_map_arrays_belong_together(run: tuple) -> None:
    m = run[1].map
    assert m.world_from_body.shape == (len(m), 4, 4)
    assert m.landmarks.shape == (len(m.landmark_ids), 3) and m.lines.shape == (len(m.line_ids), 2, 3)
    pixel_errors = []
    intrinsics = m.calibration.camera_matrix
    for keyframe, keypoint, landmark in m.observations:
        seen_by = m.keyframe(int(keyframe))
        assert seen_by.landmark_ids[keypoint] == m.landmark_ids[landmark]
        if keyframe > 2:
            continue
        in_camera = np.linalg.inv(seen_by.world_from_camera) @ np.append(m.landmarks[landmark], 1)
        pixel = intrinsics @ in_camera[:3] / in_camera[2]
        pixel_errors.append(np.linalg.norm(pixel[:2] - seen_by.keypoints[keypoint]))
    assert np.median(pixel_errors) < 1
    with pytest.raises(IndexError, match="keyframes"):
        m.keyframe(len(m))


def test_other_threads_go_on_during_a_run(tmp_path: Path) -> None:
    """Fails, and does not hang, where the global interpreter lock is held: the run waits for the other thread."""
    frame_seen, answered = threading.Event(), threading.Event()

    def answer() -> None:
        if frame_seen.wait(60):
            answered.set()

    other = threading.Thread(target=answer)
    other.start()
    before = sys.getswitchinterval()
    sys.setswitchinterval(1000)  # the other thread runs only where the lock is given away
    seen = []
    try:
        airslam.run(mapped_example()[0], tmp_path / "out",
                    on_frame=lambda frame: (frame_seen.set(), seen.append(answered.is_set())))
    finally:
        sys.setswitchinterval(before)
        frame_seen.set()
        other.join()
    assert not seen[0] and seen[-1]


def test_what_the_callback_raises_ends_the_run_and_leaves_no_result(tmp_path: Path) -> None:
    def stop(frame: airslam.Frame) -> None:
        if frame.index == 3:
            raise LookupError("enough")

    with pytest.raises(LookupError, match="enough"):
        airslam.run(mapped_example()[0], tmp_path / "out", on_frame=stop)
    assert not (tmp_path / "out").exists()


def test_ctrl_c_ends_a_run(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        airslam.run(mapped_example()[0], tmp_path / "out",
                    on_frame=lambda frame: signal.raise_signal(signal.SIGINT) if frame.index == 2 else None)
    assert not (tmp_path / "out").exists()


def test_errors_are_the_programs_sentences(tmp_path: Path) -> None:
    nowhere = tmp_path / "nowhere"
    for call, arguments in ((lambda: airslam.run(nowhere, tmp_path / "out"), ["map", nowhere, "--out", tmp_path / "out"]),
                            (lambda: airslam.info(nowhere), ["info", nowhere]),
                            (lambda: airslam.evaluate(nowhere, nowhere), ["eval", nowhere, nowhere])):
        told = subprocess.run([PROGRAM, *arguments], capture_output=True, text=True, check=False).stderr
        with pytest.raises(airslam.Error) as raised:
            call()
        assert told == f"airslam: {raised.value}\n"


def test_evaluate_is_airslam_eval(run: tuple, tmp_path: Path) -> None:
    dataset, (out, result, _) = mapped_example()[0], run
    truth = dataset / "mav0" / "state_groundtruth_estimate0" / "data.csv"
    subprocess.run([PROGRAM, "eval", truth, out / "trajectory.tum", "--json", tmp_path / "eval.json"], check=True,
                   capture_output=True)
    expected = json.loads((tmp_path / "eval.json").read_text())
    told = airslam.evaluate(truth, out / "trajectory.tum")
    assert told == {k: v for k, v in expected.items() if k in told}
    from_memory = airslam.evaluate(truth, result.trajectory)
    assert from_memory["ate_position_m"]["rmse"] == pytest.approx(told["ate_position_m"]["rmse"], abs=1e-6)
    with pytest.raises(airslam.Error, match="alignment 'x' is unknown"):
        airslam.evaluate(truth, result.trajectory, alignment="x")


def test_trajectory_from_arrays() -> None:
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, 0, 3] = [0, 1, 2]
    trajectory = airslam.Trajectory.from_arrays(np.array([1, 2, 3]), poses)
    np.testing.assert_array_equal(trajectory.world_from_body, poses)
    with pytest.raises(airslam.Error, match="2 times and 3 poses"):
        airslam.Trajectory.from_arrays(np.array([1, 2]), poses)
    with pytest.raises(airslam.Error, match="not after the one before"):
        airslam.Trajectory.from_arrays(np.array([1, 3, 2]), poses)
    poses[1, 0, 0] = np.nan
    with pytest.raises(airslam.Error, match="pose 1 .* not finite"):
        airslam.Trajectory.from_arrays(np.array([1, 2, 3]), poses)
