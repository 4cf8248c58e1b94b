# SPDX-License-Identifier: BSD-3-Clause
"""Layouts of docs/datasets.md that have no test elsewhere: TUM-VI, and a converted bag, from file to trajectory."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import numpy as np
from bag_writing import grey, write_compressed
from PIL import Image
from stand_ins import EXAMPLE, PROGRAM, write_asl, write_kalibr

from airslam.convert import convert

MOCAP = "mav0/mocap0/data.csv"


def run(*words: object) -> None:
    subprocess.run([str(PROGRAM), *map(str, words)], check=True, capture_output=True)


def test_tum_vi(tmp_path: Path) -> None:
    """Kalibr's files in dso/, 16-bit images, ground truth in mav0/mocap0."""
    folder = write_asl(tmp_path / "dataset-room1_512_16", 25, truth=MOCAP)
    write_kalibr(folder)
    for camera in ("cam0", "cam1"):
        for file in sorted((folder / "mav0" / camera / "data").iterdir()):
            wide = grey(file).astype(np.uint16) * 256
            file.unlink()
            Image.fromarray(wide).save(file.with_suffix(".png"))
        csv = folder / "mav0" / camera / "data.csv"
        csv.write_text(csv.read_text().replace(".jpg", ".png"))
    run("map", folder, "--out", tmp_path / "out")
    run("eval", folder / MOCAP, tmp_path / "out/trajectory.tum", "--json", tmp_path / "eval.json")
    evaluation = json.loads((tmp_path / "eval.json").read_text())
    assert evaluation["compared_poses"] == 25 and evaluation["ate_position_m"]["rmse"] < 0.02
    report = json.loads((tmp_path / "out/report.json").read_text())
    assert report["inertial"]["readings"] > 400


def test_a_bag_gives_the_trajectory_of_its_frames(tmp_path: Path) -> None:
    """Compressed images keep their bytes: the same files, the same trajectory, bit for bit."""
    frames = 15
    original = write_asl(tmp_path / "asl", frames)
    bag = write_compressed(tmp_path / "bag", "mcap", frames)
    convert(bag, tmp_path / "converted", calibration=[EXAMPLE])
    for dataset, out in ((original, "a"), (tmp_path / "converted", "b")):
        run("map", dataset, "--out", tmp_path / out)
    trajectories = [(tmp_path / out / "trajectory.tum").read_bytes() for out in ("a", "b")]
    assert trajectories[0] == trajectories[1] and trajectories[0].count(b"\n") >= frames
