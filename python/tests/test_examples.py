# SPDX-License-Identifier: BSD-3-Clause
"""Every numbered example runs, in their order, and says what it should; so do localizer and refusals."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import airslam
from mapped_example import mapped_example
from stand_ins import PROGRAM, REPOSITORY

EXAMPLES = REPOSITORY / "examples/python"
TRUTH = "mav0/state_groundtruth_estimate0/data.csv"


def run_example(number: str, *arguments: object, folder: Path) -> str:
    """What the example prints."""
    (script,) = EXAMPLES.glob(f"{number}_*.py")
    done = subprocess.run([sys.executable, script, *map(str, arguments)], cwd=folder, capture_output=True, text=True,
                          check=False, env={**os.environ, "AIRSLAM_PROGRAM": str(PROGRAM)})
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def refined(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The example's map, refined by example 04: the file, and what the example printed."""
    folder = tmp_path_factory.mktemp("refined")
    said = run_example("04", mapped_example()[1], folder / "refined.db", folder=folder)
    return folder / "refined.db", said


def test_each_example_is_tested() -> None:
    assert [f.name[:2] for f in sorted(EXAMPLES.glob("*.py"))] == [f"{n:02}" for n in range(1, 9)]


def test_01_and_02_agree(tmp_path: Path) -> None:
    assert "poses" in run_example("01", folder=tmp_path)
    assert "IMU: used" in run_example("02", folder=tmp_path)
    first, second = (tmp_path / "out" / name for name in ("example_01", "example_02"))
    assert airslam.info(first)["digest"] == airslam.info(second)["digest"]
    assert (first / "trajectory.tum").read_bytes() == (second / "trajectory.tum").read_bytes()


def test_03(tmp_path: Path) -> None:
    assert "median re-projection error 0." in run_example("03", mapped_example()[1], folder=tmp_path)


def test_04(refined: tuple[Path, str]) -> None:
    assert "keyframes moved by" in refined[1] and refined[1].startswith("loop_closure")


def test_05(refined: tuple[Path, str], tmp_path: Path) -> None:
    said = run_example("05", refined[0], folder=tmp_path)
    assert "points" in said.splitlines()[0]  # the map holds the example's first frames
    assert len(said.splitlines()) == 7


def test_06(tmp_path: Path) -> None:
    dataset, result = mapped_example()
    assert said_millimetres(run_example("06", dataset / TRUTH, result / "trajectory.tum", folder=tmp_path)) < 20


def test_07(tmp_path: Path) -> None:
    said = run_example("07", folder=tmp_path)
    assert int(said.splitlines()[1].split()[0]) > 50  # matches
    assert Image.open(tmp_path / "out/example_07.png").size == (752, 480)


def test_08(tmp_path: Path) -> None:
    result = mapped_example()[1]
    said = run_example("08", result, result, tmp_path / "joined", folder=tmp_path)
    assert said.startswith("2 components, then 1:")
    assert said.splitlines()[1] == ("joined.db joined.ply keyframes.tum sparse/0/cameras.txt sparse/0/images.txt "
                                    "sparse/0/points3D.txt")


def said_millimetres(text: str) -> float:
    """The number of `ATE 1.2 mm ...`."""
    return float(text.split()[1])


def test_localizer_answers_or_says_why_not(refined: tuple[Path, str]) -> None:
    dataset = mapped_example()[0]
    camera = airslam.Camera.load(dataset / "mav0/cam0/sensor.yaml")
    localizer = airslam.Localizer(refined[0], camera)
    truth = airslam.Map.load(refined[0])
    file = dataset / "mav0/cam0/data" / f"{truth.timestamps_ns[1]}.jpg"
    found = localizer.localize(np.array(Image.open(file).convert("L")))
    assert found and found.inliers > 20 and found.refusal == "" and found.stage == "verify"
    np.testing.assert_allclose(found.world_from_body, truth.world_from_body[1], atol=0.02)
    assert found.covariance.shape == (6, 6) and np.all(np.linalg.eigvalsh(found.covariance) > 0)
    nothing = localizer.localize(np.zeros((480, 752), dtype=np.uint8))
    assert not nothing and nothing.world_from_body is None and nothing.refusal
    with pytest.raises(airslam.Error, match="640x480"):
        localizer.localize(np.zeros((480, 640), dtype=np.uint8))
    with pytest.raises(airslam.Error):
        airslam.Localizer(dataset / "nowhere.db", camera)
