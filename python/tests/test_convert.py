# SPDX-License-Identifier: BSD-3-Clause
"""Bags of all three kinds become the folder that their frames came from."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
import yaml
from bag_writing import (EXAMPLE, IMU, LEFT, RIGHT, BagWriter, asl_images, asl_imu, grey, png,
                         write_example)
from PIL import Image

from airslam import Error
from airslam.__main__ import main
from airslam.bag_calibration import left_from_right
from airslam.bag_images import demosaic
from airslam.convert import convert, list_topics

TOPICS = [f"left={LEFT}", f"right={RIGHT}", f"imu={IMU}"]


def images_of(folder: Path, camera: str) -> list[tuple[int, np.ndarray]]:
    with (folder / "mav0" / camera / "data.csv").open() as stream:
        rows = [row for row in csv.reader(stream) if not row[0].startswith("#")]
    return [(int(t), np.asarray(Image.open(folder / "mav0" / camera / "data" / n))) for t, n in rows]


@pytest.mark.parametrize("kind", ["ros1", "ros2", "mcap"])
def test_a_bag_gives_the_folder_it_was_made_from(kind: str, tmp_path: Path) -> None:
    bag = write_example(tmp_path / "bag", kind)
    result = convert(bag, tmp_path / "asl", topics=TOPICS, calibration=[EXAMPLE])
    assert (result.left, result.right, result.pairs, result.warnings) == (4, 4, 4, [])
    for camera in ("cam0", "cam1"):
        expected = asl_images(camera, 4)
        found = images_of(tmp_path / "asl", camera)
        assert [t for t, _ in found] == [t for t, _ in expected]
        for (_, pixels), (_, file) in zip(found, expected):
            assert np.array_equal(pixels, grey(file))
        assert (tmp_path / f"asl/mav0/{camera}/sensor.yaml").read_bytes() == \
            (EXAMPLE / f"mav0/{camera}/sensor.yaml").read_bytes()
    last = asl_images("cam0", 4)[-1][0]
    assert asl_imu(10**19, tmp_path / "asl") == asl_imu(last)
    assert result.imu == len(asl_imu(last))


@pytest.mark.parametrize("kind", ["ros1", "ros2", "mcap"])
def test_a_single_file_of_ros2_and_guessed_topics(kind: str, tmp_path: Path) -> None:
    bag = write_example(tmp_path / "bag", kind)
    file = bag if kind == "ros1" else next(f for f in bag.iterdir() if f.name != "metadata.yaml")
    result = convert(file, tmp_path / "asl", calibration=[EXAMPLE / "mav0"])
    assert result.guessed
    assert (result.choice.left, result.choice.right, result.choice.imu) == (LEFT, RIGHT, IMU)
    assert any(line.split()[1:] == ["sensor_msgs/msg/Imu", IMU] for line in list_topics(file))


def colour_pixels() -> np.ndarray:
    return np.random.default_rng(7).integers(0, 256, (6, 8, 3), dtype=np.uint8)


def stored_as(encoding: str) -> tuple[np.ndarray, np.ndarray, bool]:
    """What a message holds, what must come out, and whether the message is big-endian."""
    rgb = colour_pixels()
    alpha = np.full((6, 8, 1), 9, np.uint8)
    wide = (rgb[:, :, 0].astype(np.uint16) << 4) + 3
    return {"mono8": (rgb[:, :, 0], rgb[:, :, 0], False), "mono16": (wide, wide, False),
            "16UC1": (wide, wide, True), "rgb8": (rgb, rgb, False), "bgr8": (rgb[:, :, ::-1], rgb, False),
            "rgba8": (np.concatenate([rgb, alpha], 2), rgb, False),
            "bgra8": (np.concatenate([rgb[:, :, ::-1], alpha], 2), rgb, False)}[encoding]


@pytest.mark.parametrize("encoding", ["mono8", "mono16", "16UC1", "rgb8", "bgr8", "rgba8", "bgra8"])
def test_raw_encodings_with_padded_rows(encoding: str, tmp_path: Path) -> None:
    stored, expected, big = stored_as(encoding)
    with BagWriter(tmp_path / "bag", "ros2") as bag:
        for topic in (LEFT, RIGHT):
            bag.image(topic, 10**9, encoding, stored, padding=5, big_endian=big)
    convert(bag.path, tmp_path / "asl", calibration=[EXAMPLE])
    (_, pixels), = images_of(tmp_path / "asl", "cam0")
    assert pixels.dtype.itemsize == expected.dtype.itemsize and np.array_equal(pixels, expected)


@pytest.mark.parametrize("pattern", ["rggb", "bggr", "gbrg", "grbg"])
def test_a_mosaic_of_a_smooth_picture_gives_the_picture_back(pattern: str, tmp_path: Path) -> None:
    row, column = np.mgrid[0:12, 0:16]
    rgb = np.stack([100 + 5 * row, 60 + 6 * column, 200 - 3 * row - 2 * column], -1).astype(np.uint8)
    cell = np.array(["rgb".index(c) for c in pattern]).reshape(2, 2)
    mosaic = np.take_along_axis(rgb, cell[row % 2, column % 2][:, :, None], 2)[:, :, 0]
    inside = (slice(1, -1), slice(1, -1))  # at the border there is no sample on one side
    assert abs(demosaic(mosaic, pattern)[inside].astype(int) - rgb[inside]).max() <= 1
    with BagWriter(tmp_path / "bag", "ros1") as bag:
        for topic in (LEFT, RIGHT):
            bag.image(topic, 10**9, f"bayer_{pattern}8", mosaic)
    convert(bag.path, tmp_path / "asl", calibration=[EXAMPLE])
    assert np.array_equal(images_of(tmp_path / "asl", "cam0")[0][1], demosaic(mosaic, pattern))


def test_compressed_images_keep_their_bytes(tmp_path: Path) -> None:
    (time, jpeg), = asl_images("cam0", 1)
    other = png(grey(jpeg))
    with BagWriter(tmp_path / "bag", "mcap") as bag:
        bag.compressed("/left/compressed", time, jpeg.read_bytes(), "mono8; jpeg compressed mono8")
        bag.compressed("/right/compressed", time, other, "png")
    result = convert(bag.path, tmp_path / "asl", calibration=[EXAMPLE])
    assert (result.choice.left, result.choice.right) == ("/left/compressed", "/right/compressed")
    assert (tmp_path / f"asl/mav0/cam0/data/{time}.jpg").read_bytes() == jpeg.read_bytes()
    assert (tmp_path / f"asl/mav0/cam1/data/{time}.png").read_bytes() == other


def test_units_of_the_imu(tmp_path: Path) -> None:
    image = colour_pixels()[:, :, 0]
    with BagWriter(tmp_path / "bag", "ros2") as bag:
        for topic in (LEFT, RIGHT):
            bag.image(topic, 10**9, "mono8", image)
        bag.imu(IMU, 10**9, [180.0, 0.0, -90.0, 0.0, 0.0, 1.0])
    warned = convert(bag.path, tmp_path / "as_is", calibration=[EXAMPLE])
    assert "--acceleration-unit g" in warned.warnings[0]
    result = convert(bag.path, tmp_path / "si", calibration=[EXAMPLE], acceleration_unit="g",
                     gyroscope_unit="deg/s")
    assert result.warnings == []
    assert asl_imu(10**19, tmp_path / "si")[0][1] == pytest.approx([np.pi, 0, -np.pi / 2, 0, 0, 9.80665])


def test_messages_without_time_take_that_of_recording(tmp_path: Path) -> None:
    image = colour_pixels()[:, :, 0]
    with BagWriter(tmp_path / "bag", "ros1") as bag:
        for topic in (LEFT, RIGHT):
            bag.image(topic, 10**9 + 5, "mono8", image, stamp_ns=0)
    result = convert(bag.path, tmp_path / "asl", calibration=[EXAMPLE])
    assert "2 messages have no time" in result.warnings[0]
    assert [time for time, _ in images_of(tmp_path / "asl", "cam0")] == [10**9 + 5]


def kalibr_files(folder: Path) -> tuple[Path, Path]:
    chain, imu = folder / "camchain-x.yaml", folder / "imu-x.yaml"
    identity = np.eye(4).tolist()
    camera = {"camera_model": "pinhole", "intrinsics": [450.0, 450.0, 376.0, 240.0],
              "distortion_model": "equidistant", "distortion_coeffs": [0.1, 0.0, 0.0, 0.0],
              "resolution": [752, 480], "T_cam_imu": identity}
    chain.write_text(yaml.safe_dump({"cam0": camera, "cam1": {**camera, "T_cn_cnm1": identity}}))
    imu.write_text(yaml.safe_dump({"imu0": {"update_rate": 200.0}}))
    return chain, imu


def test_kalibrs_files_are_copied(tmp_path: Path) -> None:
    bag = write_example(tmp_path / "bag", "ros2", frames=1)
    chain, imu = kalibr_files(tmp_path)
    by_file = convert(bag, tmp_path / "a", calibration=[imu, chain])
    by_folder = convert(bag, tmp_path / "b", calibration=[tmp_path])
    alone = convert(bag, tmp_path / "c", calibration=[chain])
    assert by_file.calibration == by_folder.calibration == "Kalibr's camchain and IMU file"
    assert "stereo alone" in alone.calibration and not (tmp_path / "c/imu.yaml").exists()
    for out in ("a", "b"):
        assert (tmp_path / out / "camchain.yaml").read_bytes() == chain.read_bytes()
        assert (tmp_path / out / "imu.yaml").read_bytes() == imu.read_bytes()


def rotation_about_y(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


@pytest.mark.parametrize("kind", ["ros1", "ros2"])
def test_camera_info_gives_the_stereo_rig(kind: str, tmp_path: Path) -> None:
    image = np.zeros((480, 752), np.uint8)
    r_left, r_right = rotation_about_y(0.02), rotation_about_y(-0.01)
    k = np.array([[450.0, 0, 370], [0, 451, 241], [0, 0, 1]])
    p = np.array([[440.0, 0, 375, 0], [0, 440, 240, 0], [0, 0, 1, 0]])
    with BagWriter(tmp_path / "bag", kind) as bag:
        for topic, r, shift in ((LEFT, r_left, 0.0), (RIGHT, r_right, -440 * 0.11)):
            moved = p.copy()
            moved[0, 3] = shift
            bag.image(topic, 10**9, "mono8", image)
            bag.camera_info(topic.replace("image_raw", "camera_info"), 10**9, "plumb_bob",
                            [-0.28, 0.07, 0.001, 0.0, 0.0], k, r, moved)
    result = convert(bag.path, tmp_path / "asl")
    assert "stereo alone" in result.calibration
    left, right = (yaml.safe_load((tmp_path / f"asl/mav0/{c}/sensor.yaml").read_text())
                   for c in ("cam0", "cam1"))
    assert left["intrinsics"] == [450, 451, 370, 241] and left["resolution"] == [752, 480]
    assert left["distortion_coefficients"] == [-0.28, 0.07, 0.001, 0]
    assert left["distortion_model"] == "radial-tangential"
    pose = np.array(right["T_BS"]["data"]).reshape(4, 4)
    # A point straight ahead of both lies on one row after both rectifications, 0.11 m apart.
    in_right = np.array([0.3, -0.2, 4.0])
    in_left = pose[:3, :3] @ in_right + pose[:3, 3]
    assert r_left @ in_left - r_right @ in_right == pytest.approx([0.11, 0, 0], abs=1e-12)


def test_rectified_topics_have_no_rotation_left() -> None:
    p = np.array([[440.0, 0, 375, -44], [0, 440, 240, 0], [0, 0, 1, 0]])
    pose = left_from_right(rotation_about_y(0.1), rotation_about_y(0.2), p, rectified=True)
    assert np.array_equal(pose[:3, :3], np.eye(3)) and pose[0, 3] == pytest.approx(0.1)


def refusal(bag: Path, out: Path, **options: object) -> str:
    """The sentence of a conversion that must fail and leave nothing."""
    with pytest.raises(Error) as failure:
        convert(bag, out, **{"calibration": [EXAMPLE], **options})
    assert not out.exists() and not out.with_name(out.name + ".partial").exists()
    assert "\n" not in str(failure.value)
    return str(failure.value)


def test_what_cannot_be_converted_is_said_in_a_sentence(tmp_path: Path) -> None:
    bag, out = write_example(tmp_path / "bag", "ros2", frames=2), tmp_path / "asl"
    assert "no topic /nope; it has: /cam0/image_raw" in refusal(
        bag, out, topics=["left=/nope", f"right={RIGHT}"])
    assert "topic /imu0 holds sensor_msgs/msg/Imu, but right= needs" in refusal(
        bag, out, topics=[f"left={LEFT}", f"right={IMU}"])
    assert "both left=… and right=…" in refusal(bag, out, topics=[f"left={LEFT}"])
    assert "takes left=…" in refusal(bag, out, topics=["links=/a"])
    assert "no camera_info beside /cam0/image_raw" in refusal(bag, out, calibration=None)
    assert "does not exist" in refusal(tmp_path / "none.bag", out)
    assert "is no bag" in refusal(EXAMPLE, out)
    shifted = write_example(tmp_path / "shifted", "ros2", frames=2, right_shift_ns=40_000_000)
    assert "closest two are 40.000 ms apart, 5 ms are allowed" in refusal(shifted, out)


def test_an_unsupported_encoding_is_named(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag", "ros2") as bag:
        for topic in (LEFT, RIGHT):
            bag.image(topic, 10**9, "yuv422", np.zeros((4, 8, 2), np.uint8))
    said = refusal(bag.path, tmp_path / "asl")
    assert f"the images of topic {LEFT} are yuv422, which is not supported" in said


def test_topics_that_cannot_be_guessed_are_listed(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag", "ros2") as bag:
        for topic in ("/a", "/b", "/c"):
            bag.image(topic, 10**9, "mono8", np.zeros((4, 8), np.uint8))
    assert "cannot be guessed; choose with --topics left=… right=… among: /a" in refusal(
        bag.path, tmp_path / "asl")


@pytest.mark.parametrize("kind", ["ros1", "ros2", "mcap"])
@pytest.mark.parametrize("share", [0.0, 0.02, 0.5, 0.97])
def test_a_bag_that_is_cut_off_is_said_to_be(kind: str, share: float, tmp_path: Path) -> None:
    bag = write_example(tmp_path / "bag", kind)
    file = bag if kind == "ros1" else next(f for f in bag.iterdir() if f.name != "metadata.yaml")
    content = file.read_bytes()
    file.write_bytes(content[:int(share * len(content))])
    assert "cut off, damaged" in refusal(bag, tmp_path / "asl", topics=TOPICS)


def test_something_else_at_out_is_not_replaced(tmp_path: Path) -> None:
    bag = write_example(tmp_path / "bag", "ros1", frames=1)
    precious = tmp_path / "home"
    precious.mkdir()
    with pytest.raises(Error, match="is not replaced"):
        convert(bag, precious, calibration=[EXAMPLE])
    first = convert(bag, tmp_path / "asl", calibration=[EXAMPLE])
    assert convert(bag, tmp_path / "asl", calibration=[EXAMPLE]) == first


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = write_example(tmp_path / "bag", "mcap", frames=1)

    def run(*words: object) -> tuple[int, str, str]:
        code = main(["convert", *map(str, words)])
        return code, *capsys.readouterr()

    code, out, err = run(bag, "--out", tmp_path / "asl", "--calib", EXAMPLE)
    assert code == 0 and "guessed topics: left=/cam0/image_raw" in out and err == ""
    assert run(bag, "--list")[0] == 0
    code, out, err = run(tmp_path / "x.bag", "--list")
    assert code == 1 and err == f"airslam: {tmp_path / 'x.bag'} does not exist\n"
    assert run(bag)[0] == 1
