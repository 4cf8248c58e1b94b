# SPDX-License-Identifier: BSD-3-Clause
"""Options as a dict: those of the program's YAML file, with the program's sentences."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest
import yaml

import airslam
from mapped_example import mapped_example
from stand_ins import PROGRAM, write_asl


@pytest.mark.parametrize("config", [
    {"traking": {"min_tracked": 3}},
    {"tracking": {"min_trackd": 3}},
    {"max_keypoints": "many"},
    {"max_keypoints": 1.5},
    {"max_keypoints": True},
    {"max_keypoints": -3},
    {"max_keypoints": [1, 2]},
    {"tracking": 3},
    {"inertial": {"enabled": "perhaps"}},
    {"tracking": {"pixel_sigma": 0}},
], ids=str)
def test_wrong_ones_are_told_as_by_the_program(config: dict, tmp_path: Path) -> None:
    file, dataset = tmp_path / "c.yaml", mapped_example()[0]
    file.write_text(yaml.safe_dump(config, default_flow_style=None))
    told = subprocess.run([PROGRAM, "map", dataset, "--out", tmp_path / "out", "--config", file], capture_output=True,
                          text=True, check=False).stderr
    with pytest.raises(airslam.Error) as raised:
        airslam.run(dataset, tmp_path / "out", config=config)
    where, sentence = told.removeprefix("airslam: ").rstrip("\n").split(": ", 1)
    assert where.startswith(str(file)) and str(raised.value) == f"config: {sentence}"
    with pytest.raises(airslam.Error) as raised:
        airslam.Odometry(airslam.StereoRig.load(dataset), config=config)
    assert str(raised.value) == f"config: {sentence}"


def test_a_run_with_a_dict_is_that_with_the_file(tmp_path: Path) -> None:
    dataset = write_asl(tmp_path / "asl", 6)
    config = {"max_keypoints": 200, "tracking": {"pixel_sigma": 0.45}, "lines": {"enabled": False}}
    (tmp_path / "c.yaml").write_text(yaml.safe_dump(config))
    subprocess.run([PROGRAM, "map", dataset, "--out", tmp_path / "a", "--config", tmp_path / "c.yaml"], check=True,
                   capture_output=True)
    config["max_keypoints"] = np.int64(200)  # numpy's numbers are numbers
    config["tracking"]["pixel_sigma"] = np.float64(0.45)
    result = airslam.run(dataset, tmp_path / "b", config=config)
    airslam.run(dataset, tmp_path / "c", config=str(tmp_path / "c.yaml"))
    digests = {airslam.info(tmp_path / name)["digest"] for name in "abc"}
    assert len(digests) == 1
    airslam.run(dataset, tmp_path / "d", config={}, lines=False)
    assert airslam.info(tmp_path / "d")["digest"] not in digests  # they did something
    assert len(result.map.lines) == 0


def test_what_is_no_configuration() -> None:
    rig, within = airslam.StereoRig.load(mapped_example()[0]), {}
    within["tracking"] = within
    for config in (3, [("max_keypoints", 3)], {("a", "b"): 3}, within):
        with pytest.raises(TypeError):
            airslam.Odometry(rig, config=config)


def test_localizer_takes_them() -> None:
    dataset, result = mapped_example()
    camera = airslam.Camera.load(dataset / "mav0/cam0/sensor.yaml")
    with pytest.raises(airslam.Error, match="config: unknown option 'candidats'; the nearest known one is 'candidates'"):
        airslam.Localizer(result, camera, config={"candidats": 3})
    with pytest.raises(airslam.Error, match="option candidates is 0"):  # given by itself, it goes before
        airslam.Localizer(result, camera, config={"candidates": 2}, candidates=0)
