# SPDX-License-Identifier: BSD-3-Clause
"""Detector gives the numbers of `airslam detect`."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from bag_writing import asl_images, grey
from stand_ins import PROGRAM, REPOSITORY
from PIL import Image

import airslam


@pytest.fixture(scope="module")
def detector() -> airslam.Detector:
    return airslam.Detector()


@pytest.fixture(scope="module")
def image() -> np.ndarray:
    return grey(asl_images("cam0", 1)[0][1])


def keypoint_table(found: airslam.Detections) -> str:
    return "".join(f"{x:.3f},{y:.3f},{score:.4f}\n" for x, y, score in found.keypoints.tolist())


def line_table(found: airslam.Detections) -> str:
    return "".join("{:.3f},{:.3f},{:.3f},{:.3f},{:.5f}\n".format(*line) for line in found.lines.tolist())


def test_the_programs_numbers(detector: airslam.Detector, image: np.ndarray, tmp_path: Path) -> None:
    pictures = {"whole": image, "part": image[:333, 100:]}  # one of another size, whose rows do not follow each other
    (tmp_path / "in").mkdir()
    for name, pixels in pictures.items():
        Image.fromarray(pixels).save(tmp_path / "in" / f"{name}.png")
    subprocess.run([PROGRAM, "detect", tmp_path / "in", "--out", tmp_path / "out"], check=True, capture_output=True)
    for name, pixels in pictures.items():
        found = detector.detect(pixels)
        assert keypoint_table(found) == (tmp_path / "out" / f"{name}.keypoints.csv").read_text()
        assert line_table(found) == (tmp_path / "out" / f"{name}.lines.csv").read_text()
        assert len(found.keypoints) == 400 and len(found.lines) > 100


def test_arrays_belong_together(detector: airslam.Detector, image: np.ndarray) -> None:
    found = detector.detect(image, max_keypoints=50, min_line_score=0.4)
    assert found.keypoints.shape == (50, 3) and found.descriptors.shape == (50, detector.descriptor_size)
    lines, junctions = len(found.lines), len(found.junctions)
    assert lines > 10 and found.lines.shape == (lines, 5) and found.lines[:, 4].min() >= 0.4
    assert found.junctions.shape == (junctions, 3) and found.line_ends.shape == (lines, 2)
    assert found.junction_descriptors.shape == (junctions, detector.descriptor_size)
    for name in ("keypoints", "descriptors", "lines", "junctions", "junction_descriptors"):
        assert getattr(found, name).dtype == np.float32, name
    np.testing.assert_array_equal(found.junctions[found.line_ends, :2].reshape(-1, 4), found.lines[:, :4])
    for descriptors in (found.descriptors, found.junction_descriptors):
        np.testing.assert_allclose(np.linalg.norm(descriptors, axis=1), 1, atol=1e-5)
    for scores in (found.keypoints[:, 2], found.lines[:, 4]):
        assert np.all(np.diff(scores) <= 0)


def test_what_is_asked_for(detector: airslam.Detector, image: np.ndarray) -> None:
    points = detector.detect(image, lines=False)
    assert points.lines.shape == (0, 5) and points.junctions.shape == (0, 3) and len(points.keypoints) == 400
    assert detector.detect(image, max_keypoints=0).keypoints.shape == (0, 3)
    mask = np.zeros_like(image)
    mask[:, :300] = 255
    masked = detector.detect(image, mask=mask)
    plain = detector.detect(image, line_scale=1.0)
    np.testing.assert_array_equal(plain.keypoints, points.keypoints)
    assert len(plain.lines) > 100 and not np.array_equal(plain.lines[:50], detector.detect(image).lines[:50])
    assert 0 < len(masked.keypoints) and masked.keypoints[:, 0].max() < 300 and len(masked.lines) > 0
    assert masked.lines[:, [0, 2]].max() < 301


def test_a_pack_of_ones_own(detector: airslam.Detector, image: np.ndarray, tmp_path: Path) -> None:
    own = Path(shutil.copytree(REPOSITORY / "models/airslam-fast", tmp_path / "own"))
    for model in (own, str(own)):
        np.testing.assert_array_equal(airslam.Detector(model).detect(image).descriptors, detector.detect(image).descriptors)
    assert detector.model == "airslam-fast" and detector.finds_lines


def test_what_cannot_be_right(detector: airslam.Detector, image: np.ndarray, tmp_path: Path) -> None:
    Image.fromarray(image).save(tmp_path / "a.png")
    with pytest.raises(airslam.Error) as raised:
        airslam.Detector(tmp_path)
    told = subprocess.run([PROGRAM, "detect", tmp_path / "a.png", "--out", tmp_path / "out", "--model", tmp_path],
                          capture_output=True, text=True, check=False).stderr
    assert told == f"airslam: {raised.value}\n"
    with pytest.raises(airslam.Error, match="max_keypoints = -1 must be at least 0"):
        detector.detect(image, max_keypoints=-1)
    with pytest.raises(airslam.Error, match="min_line_score = 1.5 must be between 0 and 1"):
        detector.detect(image, min_line_score=1.5)
    with pytest.raises(airslam.Error, match="line_scale = 0.5 must be between 1 and 4"):
        detector.detect(image, line_scale=0.5)
    with pytest.raises(airslam.Error, match="mask"):
        detector.detect(image, mask=image[:100])
    with pytest.raises(airslam.Error, match="with at least one pixel, not 752x0"):
        detector.detect(image[:0])
    with pytest.raises(TypeError):
        detector.detect(image.astype(np.float32))
    with pytest.raises(TypeError):
        detector.detect(np.stack([image] * 3, axis=2))
