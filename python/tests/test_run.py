# SPDX-License-Identifier: BSD-3-Clause
"""`python -m airslam run`: the result of `airslam map`, shown or not, of a folder or of a bag."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
from bag_writing import write_compressed
from mapped_example import mapped_example
from recordings import Recorded
from stand_ins import EXAMPLE, PROGRAM, write_asl

import airslam
from airslam.__main__ import main


def same_result(first: Path, second: Path) -> bool:
    """Trajectories byte by byte, and the digests of the maps."""
    files = ("trajectory.tum", "trajectory_online.tum", "keyframes.tum")
    return all((first / f).read_bytes() == (second / f).read_bytes() for f in files) and \
        airslam.info(first)["digest"] == airslam.info(second)["digest"]


def test_a_recorded_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    dataset, expected = mapped_example()
    assert main(["run", str(dataset), "--out", str(tmp_path / "out"), "--save", str(tmp_path / "run.rrd")]) == 0
    assert same_result(tmp_path / "out", expected)
    said = capsys.readouterr().out
    assert "40 of 40 frames with a pose" in said and "run.rrd" in said
    recorded = Recorded(tmp_path / "run.rrd")
    assert recorded.count("/camera/image", "EncodedImage:blob") == 40
    for entity in ("/camera/image/keypoints", "/camera/image/map", "/camera/image/motion", "/camera/image/lines",
                   "/camera/image/matches", "/world/points", "/world/lines", "/world/keyframes", "/world/trajectory",
                   "/world/truth", "/plots/tracked", "/plots/stages/track", "/plots/stages/detect_left",
                   "/plots/gyroscope_bias/x", "/plots/accelerometer_bias/z"):
        assert recorded.has(entity), entity
    for bias in ("gyroscope_bias/x", "accelerometer_bias/z"):  # from the IMU's initialisation on
        assert 0 < recorded.count(f"/plots/{bias}", "Scalars:scalars") < 40
    assert recorded.count("/world/run/points", "Points3D:positions") >= 2  # it grew


def test_a_bag_gives_the_result_of_its_frames(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    frames = 12
    folder = write_asl(tmp_path / "asl", frames)
    bag = write_compressed(tmp_path / "recording", "ros1", frames)
    subprocess.run([PROGRAM, "map", folder, "--out", tmp_path / "expected"], check=True, capture_output=True)
    assert main(["run", str(bag), "--calib", str(EXAMPLE), "--out", str(tmp_path / "results/a")]) == 0
    assert same_result(tmp_path / "results/a", tmp_path / "expected")
    assert [f.name for f in (tmp_path / "results").iterdir()] == ["a"]  # the converted folder is gone
    assert "guessed topics: left=/left/compressed" in capsys.readouterr().err


def test_options_reach_the_run(tmp_path: Path) -> None:
    dataset = write_asl(tmp_path / "asl", 6)
    assert main(["run", str(dataset), "--out", str(tmp_path / "a"), "--no-imu", "--no-lines"]) == 0
    subprocess.run([PROGRAM, "map", dataset, "--out", tmp_path / "b", "--no-imu", "--no-lines"], check=True,
                   capture_output=True)
    assert same_result(tmp_path / "a", tmp_path / "b")


def test_failures_are_sentences(tmp_path: Path, capsys: pytest.CaptureFixture[str],
                                monkeypatch: pytest.MonkeyPatch) -> None:
    def run(*words: object) -> str:
        assert main(["run", *map(str, words), "--out", str(tmp_path / "out")]) == 1
        assert not (tmp_path / "out").exists()
        return capsys.readouterr().err.splitlines()[-1]

    assert "are for bags, but" in run(EXAMPLE, "--topics", "left=/a", "right=/b")
    assert str(tmp_path / "none.bag") in run(tmp_path / "none.bag")
    assert "airslam: " in run(tmp_path)  # neither layout
    for variable in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(variable, raising=False)
    assert "no display" in run(EXAMPLE, "--view")
