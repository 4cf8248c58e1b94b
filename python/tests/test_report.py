# SPDX-License-Identifier: BSD-3-Clause
"""The page about a result folder: what it says is what the files say, and it needs nothing from outside."""

from __future__ import annotations

import json
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
import yaml
from mapped_example import FRAMES, copy_of_result, mapped_example
from stand_ins import EXAMPLE, PROGRAM, TRUTH, write_asl, write_kalibr

import airslam
from airslam import Error, report
from airslam.__main__ import main
from airslam.raw_images import RawCamera, left_images, raw_camera
from airslam.results import align, compare


class Page(HTMLParser):
    """Collects what a page refers to, its text, and whether all its tags are closed."""

    VOID = {"meta", "img", "br"}

    def __init__(self, text: str):
        super().__init__()
        self.references: list[str] = []
        self.open: list[str] = []
        self.text = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.references += [value for name, value in attrs if name in ("src", "href") and value]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


def page_of(folder: Path, **options: object) -> Page:
    file = report.write_report(report.load_subject(folder), **options)
    page = Page(file.read_text())
    assert page.open == []
    assert all(reference.startswith("data:image/") for reference in page.references)
    assert not re.search(r"https?://(?!www\.w3\.org)", re.sub(r"base64,[^\"]*", "", file.read_text()))
    return page


def test_the_page_says_what_the_files_say(tmp_path: Path) -> None:
    dataset, _ = mapped_example()
    folder = copy_of_result(tmp_path)
    page = page_of(folder)
    facts = json.loads((folder / "report.json").read_text())
    rmse = airslam.evaluate(dataset / TRUTH, folder / "trajectory.tum")["ate_position_m"]["rmse"]
    for expected in (f"{FRAMES} / {FRAMES}", f"{1000 * rmse:.1f} mm", str(facts["landmarks"]), "local bundle",
                     "gyroscope bias", "No frame was lost", "max_keypoints: 350", "What the camera saw"):
        assert expected in page.text
    kinds = [reference.split(";")[0] for reference in page.references]
    assert kinds.count("data:image/jpeg") == 6  # keyframes
    assert kinds.count("data:image/svg+xml") == 4  # trajectory, errors, tracking, biases
    assert kinds.count("data:image/png") == 1  # map


def test_the_same_results_give_the_same_page(tmp_path: Path) -> None:
    folder = copy_of_result(tmp_path)
    first = report.write_report(report.load_subject(folder)).read_bytes()
    again = report.write_report(report.load_subject(folder), out=tmp_path / "again.html")
    assert again.read_bytes() == first


def test_without_ground_truth_and_images(tmp_path: Path) -> None:
    folder = copy_of_result(tmp_path)
    facts = json.loads((folder / "report.json").read_text())
    facts["dataset"] = str(tmp_path / "gone")
    facts["lost_intervals"] = [{"from_ns": facts["frame_states"][3]["timestamp_ns"],
                                "to_ns": facts["frame_states"][8]["timestamp_ns"], "frames": 6}]
    for state in facts["frame_states"][3:9]:
        state["state"] = "lost"
    facts["stopped_by"], facts["frames_in_sequence"] = "SIGTERM", 99
    facts["inertial"].update(state="time offset", reason="the IMU is late <by far>")
    (folder / "report.json").write_text(json.dumps(facts))
    page = page_of(folder, pictures=True)
    assert "No ground truth was found or given" in page.text and "What the camera saw" not in page.text
    assert "lost from 0.30 s to 0.80 s: 6 frames" in page.text and "lost: 6" in page.text
    assert f"ended by SIGTERM after {FRAMES} of 99 frames" in page.text
    assert "the IMU is late <by far>" in page.text  # escaped in the file, or the parser had dropped it
    assert {"report.html", "trajectory.png", "map.png"} <= {file.name for file in folder.iterdir()}


def test_the_command_sums_up(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = copy_of_result(tmp_path)
    assert main(["report", str(folder)]) == 0
    said = capsys.readouterr().out
    assert f"frames       {FRAMES}, lost 0" in said and "ATE RMSE" in said and "report.html (" in said


def test_failures_are_sentences(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def run(*words: object) -> str:
        assert main(["report", *map(str, words)]) == 1
        said = capsys.readouterr().err
        assert said.startswith("airslam: ") and said.count("\n") == 1
        return said

    assert "report.json is missing" in run(tmp_path)
    folder = copy_of_result(tmp_path)
    assert "is no folder" in run(folder, "--dataset", tmp_path / "none")
    assert str(tmp_path / "none.csv") in run(folder, "--truth", tmp_path / "none.csv")
    (tmp_path / "other.tum").write_text("".join(f"{i}.0 0 0 0 0 0 0 1\n" for i in range(9)))
    assert "fewer than three poses" in run(folder, "--truth", tmp_path / "other.tum")
    (folder / "map.db").write_bytes(b"no map")
    assert "map.db" in run(folder)


def test_rectified_pixels_land_where_the_camera_saw_them(tmp_path: Path) -> None:
    """A world point seen by the rectified camera, and by the raw camera through its model, is one point."""
    dataset, result = mapped_example()
    calibration = airslam.Map.load(result).calibration
    camera = raw_camera(dataset, calibration.camera_matrix, calibration.body_from_camera)
    fields = yaml.safe_load((EXAMPLE / "mav0/cam0/sensor.yaml").read_text())
    body_from_raw = np.array(fields["T_BS"]["data"]).reshape(4, 4)
    # Far away, for the rectified camera may stand elsewhere than it looks from by rounding only.
    points = np.array([[1.0, 0.3, 5], [-2, 1, 6], [0, 0, 4], [2.5, -1.5, 7]])
    pixels = points @ calibration.camera_matrix.T
    found = camera.distort(pixels[:, :2] / pixels[:, 2:])
    raw = points @ calibration.body_from_camera[:3, :3].T @ body_from_raw[:3, :3]
    x, y = raw[:, 0] / raw[:, 2], raw[:, 1] / raw[:, 2]
    k1, k2, p1, p2 = map(float, fields["distortion_coefficients"])
    r2 = x**2 + y**2
    radial = 1 + k1 * r2 + k2 * r2**2
    fx, fy, cx, cy = fields["intrinsics"]
    expected = np.column_stack([fx * (x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2)) + cx,
                                fy * (y * radial + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y) + cy])
    assert found == pytest.approx(expected, abs=1e-9)
    assert abs(found - pixels[:, :2] / pixels[:, 2:]).max() > 3  # they do differ


def test_kalibrs_calibration_gives_the_same_camera(tmp_path: Path) -> None:
    folder = write_asl(tmp_path / "asl", 2)
    matrix, pose = np.array([[430.0, 0, 370], [0, 430, 250], [0, 0, 1]]), np.eye(4)
    first = raw_camera(folder, matrix, pose)
    write_kalibr(folder)
    second = raw_camera(folder, matrix, pose)
    assert second.raw_from_rectified == pytest.approx(first.raw_from_rectified)
    assert (second.model, second.raw.tolist()) == (first.model, first.raw.tolist())
    (folder / "dso/camchain.yaml").write_text("cam0: {}")
    with pytest.raises(Error, match="left camera's calibration"):
        raw_camera(folder, matrix, pose)


def test_equidistant_pixels_follow_the_angle() -> None:
    matrix = np.array([[100.0, 0, 0], [0, 100, 0], [0, 0, 1]])
    camera = RawCamera(matrix, np.eye(3), np.array([100.0, 100, 0, 0]), "equidistant", np.array([0.1, 0, 0, 0]))
    angle = np.radians([10.0, 40, 60])
    pixels = np.column_stack([100 * np.tan(angle), np.zeros(3)])
    assert camera.distort(pixels)[:, 0] == pytest.approx(100 * (angle + 0.1 * angle**3))
    assert camera.distort(np.zeros((1, 2))).tolist() == [[0, 0]]


def test_images_of_each_layout(tmp_path: Path) -> None:
    asl = write_asl(tmp_path / "asl", 3)
    expected = left_images(asl)
    assert len(expected) == 3 and all(file.exists() for file in expected.values())
    (asl / "mav0/cam0/data.csv").unlink()
    assert left_images(asl) == expected
    kitti = tmp_path / "kitti/image_0"
    kitti.mkdir(parents=True)
    for name in ("000001.png", "000000.png"):
        (kitti / name).touch()
    (tmp_path / "kitti/times.txt").write_text("0.0\n0.1\n")
    assert left_images(tmp_path / "kitti") == {0: kitti / "000000.png", 100_000_000: kitti / "000001.png"}
    assert left_images(tmp_path) == {}


def test_comparison_is_that_of_eval(tmp_path: Path) -> None:
    dataset, folder = mapped_example()
    truth, estimate = (airslam.Trajectory.load(f) for f in (dataset / TRUTH, folder / "trajectory.tum"))
    comparison = compare(truth, estimate)
    stated = airslam.evaluate(dataset / TRUTH, folder / "trajectory.tum")["ate_position_m"]
    assert comparison.rmse == pytest.approx(stated["rmse"], rel=1e-9) and len(comparison.times_ns) == FRAMES
    assert comparison.rotation_errors.max() < 0.5


def test_alignment_undoes_a_transform() -> None:
    random = np.random.default_rng(3)
    source = random.normal(size=(20, 3))
    q, _ = np.linalg.qr(random.normal(size=(3, 3)))
    rotation = q * np.sign(np.linalg.det(q))
    moved = align(source, source @ rotation.T + [1, 2, 3])
    assert moved[:3, :3] == pytest.approx(rotation) and moved[:3, 3] == pytest.approx([1, 2, 3])


def test_the_program_is_there() -> None:
    assert PROGRAM.exists()
