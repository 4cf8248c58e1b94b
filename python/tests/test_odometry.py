# SPDX-License-Identifier: BSD-3-Clause
"""Odometry fed frame by frame: the program's results bit for bit, and clear words for what cannot be right."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import airslam
from mapped_example import mapped_example


def _rows(file: Path) -> list[list[str]]:
    return [row for row in csv.reader(file.open()) if not row[0].startswith("#")]


def _frames(dataset: Path) -> list[tuple[int, np.ndarray, np.ndarray]]:
    cameras = [dataset / "mav0" / name for name in ("cam0", "cam1")]
    listed = zip(*(_rows(camera / "data.csv") for camera in cameras), strict=True)
    return [(int(left[0]), *(np.array(Image.open(camera / "data" / file).convert("L"))
                             for camera, (_, file) in zip(cameras, (left, right), strict=True)))
            for left, right in listed]


def _readings(dataset: Path) -> list[tuple[int, np.ndarray, np.ndarray]]:
    rows = _rows(dataset / "mav0/imu0/data.csv")
    return [(int(t), np.array(v[:3], dtype=float), np.array(v[3:], dtype=float)) for t, *v in rows]


@pytest.mark.parametrize("lead_ns", [0, 300_000_000])
def test_frame_by_frame_is_the_program_bit_for_bit(lead_ns: int, tmp_path: Path) -> None:
    dataset, expected = mapped_example()
    odometry = airslam.Odometry(airslam.StereoRig.load(dataset), out=tmp_path / "out")
    readings, done = iter(_readings(dataset)), []
    reading = next(readings, None)
    for time, left, right in _frames(dataset):
        while reading is not None and reading[0] <= time + lead_ns:
            odometry.add_imu(*reading)
            reading = next(readings, None)
        done += odometry.add_frame(time, left, right)
        left[:], right[:] = 0, 0  # it has copies
    while reading is not None:
        odometry.add_imu(*reading)
        reading = next(readings, None)
    result = odometry.finish()
    done += odometry.take_done()
    for name in ("trajectory.tum", "trajectory_online.tum", "keyframes.tum"):
        assert (tmp_path / "out" / name).read_bytes() == (expected / name).read_bytes(), name
    assert airslam.info(tmp_path / "out")["digest"] == airslam.info(expected)["digest"]
    assert [frame.index for frame in done] == list(range(result.report["frames"]))
    with pytest.raises(airslam.Error, match="finished already"):
        odometry.finish()


def test_a_rig_of_numbers_is_that_of_the_files() -> None:
    dataset, expected = mapped_example()
    loaded = airslam.StereoRig.load(dataset)
    cameras = [airslam.Camera(c.intrinsics, c.image_size, c.model, c.distortion, c.body_from_camera)
               for c in (loaded.left, loaded.right)]
    odometry = airslam.Odometry(airslam.StereoRig(*cameras), lines=False)
    for time, left, right in _frames(dataset)[:8]:
        odometry.add_frame(time, left, right)
    result = odometry.finish()
    assert len(result.trajectory) == 8 and result.report["inertial"]["state"] == "no calibration"
    calibration = airslam.Map.load(expected).calibration
    np.testing.assert_array_equal(result.map.calibration.camera_matrix, calibration.camera_matrix)
    assert result.map.calibration.baseline == calibration.baseline


def test_what_cannot_be_right_is_said_and_nothing_is_lost() -> None:
    dataset = mapped_example()[0]
    odometry = airslam.Odometry(airslam.StereoRig.load(dataset), lines=False)
    frames, zero = _frames(dataset)[:5], np.zeros(3)
    for time, left, right in frames[:4]:
        odometry.add_imu(time, zero, zero)
        odometry.add_frame(time, left, right)
    time, left, right = frames[4]
    with pytest.raises(airslam.Error, match="not after the last one"):
        odometry.add_frame(frames[3][0], left, right)
    with pytest.raises(airslam.Error, match="right image has 100x480 pixels, but the calibration says 752x480"):
        odometry.add_frame(time, left, right[:, :100])
    with pytest.raises(airslam.Error, match="not after the last one"):
        odometry.add_imu(frames[3][0], zero, zero)
    with pytest.raises(airslam.Error, match="not finite"):
        odometry.add_imu(time, np.array([0, np.nan, 0]), zero)
    with pytest.raises(TypeError):
        odometry.add_frame(time, left.astype(float), right)
    with pytest.raises(airslam.Error, match="side by side"):
        odometry.add_frame(time, left[:, ::-1], right)
    odometry.end_imu()
    odometry.add_frame(time, left, right)
    assert odometry.finish().report["frames"] == 5


def test_an_odometry_that_goes_away_leaves_no_result(tmp_path: Path) -> None:
    dataset = mapped_example()[0]
    odometry = airslam.Odometry(airslam.StereoRig.load(dataset), out=tmp_path / "out", imu=False)
    for time, left, right in _frames(dataset)[:3]:
        odometry.add_frame(time, left, right)
    del odometry
    assert not (tmp_path / "out").exists() and (tmp_path / "out.partial/map.db").exists()


def test_calibrations_that_cannot_be_right() -> None:
    good = {"intrinsics": [400, 400, 320, 240], "image_size": (640, 480)}
    for change, sentence in (({"intrinsics": [400, 400]}, "fx, fy, cx, cy"),
                             ({"intrinsics": [0, 400, 320, 240]}, "above 0"),
                             ({"model": "fov"}, "distortion model 'fov' is unknown"),
                             ({"model": "radtan", "distortion": [0.1]}, "has 4 coefficients, not 1"),
                             ({"body_from_camera": 2 * np.eye(4)}, "no rigid transform")):
        with pytest.raises(airslam.Error, match=sentence):
            airslam.Camera(**{**good, **change})
    camera = airslam.Camera(**good)
    with pytest.raises(airslam.Error):  # no baseline
        airslam.StereoRig(camera, camera)
    with pytest.raises(airslam.Error, match="noise figures"):
        airslam.ImuNoise(gyroscope_noise_density=0, gyroscope_random_walk=1, accelerometer_noise_density=1,
                         accelerometer_random_walk=1, rate_hz=200)
