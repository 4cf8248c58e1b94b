# SPDX-License-Identifier: BSD-3-Clause
"""Small data sets in the layouts of published ones, cut from examples/warehouse_day."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import numpy as np
import yaml
from bag_writing import EXAMPLE, asl_images, asl_imu, grey
from PIL import Image

from airslam.raw_images import RawCamera

REPOSITORY = EXAMPLE.parents[1]
PROGRAM = Path(os.environ.get("AIRSLAM_PROGRAM", REPOSITORY / "build/bin/airslam"))
TRUTH = "mav0/state_groundtruth_estimate0/data.csv"


def rows_of(csv: Path) -> tuple[str, list[str]]:
    """Head and rows of a csv file."""
    head, *rows = csv.read_text().splitlines()
    return head, rows


def write_asl(out: Path, frames: int, truth: str = TRUTH, first: int = 0) -> Path:
    """The first frames of the example as an ASL folder of links; `truth`: where the ground truth goes."""
    chosen = asl_images("cam0", first + frames)[first:]
    for camera in ("cam0", "cam1"):
        folder = out / "mav0" / camera
        (folder / "data").mkdir(parents=True)
        shutil.copyfile(EXAMPLE / "mav0" / camera / "sensor.yaml", folder / "sensor.yaml")
        images = asl_images(camera, first + frames)[first:]
        for _, file in images:
            (folder / "data" / file.name).symlink_to(file)
        (folder / "data.csv").write_text("\n".join(["#t,name", *(f"{t},{f.name}" for t, f in images)]) + "\n")
    (out / "mav0/imu0").mkdir()
    shutil.copyfile(EXAMPLE / "mav0/imu0/sensor.yaml", out / "mav0/imu0/sensor.yaml")
    begin, end = chosen[0][0], chosen[-1][0]
    for source, target in (("mav0/imu0/data.csv", "mav0/imu0/data.csv"), (TRUTH, truth)):
        head, rows = rows_of(EXAMPLE / source)
        kept = [row for row in rows if begin <= int(row.split(",")[0]) <= end]
        (out / target).parent.mkdir(parents=True, exist_ok=True)
        (out / target).write_text("\n".join([head, *kept]) + "\n")
    return out


def write_kalibr(folder: Path, model: str = "radtan") -> None:
    """Replaces the sensor.yaml files of an ASL folder by Kalibr's camchain and imu in dso/, as TUM-VI has."""
    chain = {}
    for camera in ("cam0", "cam1"):
        fields = yaml.safe_load((folder / "mav0" / camera / "sensor.yaml").read_text())
        pose = np.linalg.inv(np.array(fields["T_BS"]["data"]).reshape(4, 4))
        chain[camera] = {"camera_model": "pinhole", "intrinsics": fields["intrinsics"],
                         "distortion_model": model, "distortion_coeffs": [float(v) for v in fields["distortion_coefficients"]],
                         "resolution": fields["resolution"], "T_cam_imu": pose.tolist()}
        (folder / "mav0" / camera / "sensor.yaml").unlink()
    imu = yaml.safe_load((folder / "mav0/imu0/sensor.yaml").read_text())
    (folder / "mav0/imu0/sensor.yaml").unlink()
    noise = {key: imu[key] for key in imu if key.startswith(("gyroscope", "accelerometer"))}
    (folder / "dso").mkdir()
    (folder / "dso/camchain.yaml").write_text(yaml.safe_dump(chain))
    (folder / "dso/imu_config.yaml").write_text(yaml.safe_dump({**noise, "update_rate": 200.0}))


def rectify(file: Path, camera: str, rotation: np.ndarray) -> np.ndarray:
    """An image as TartanAir's pinhole camera would have taken it; rotation: body from that camera."""
    fields = yaml.safe_load((EXAMPLE / "mav0" / camera / "sensor.yaml").read_text())
    body_from_raw = np.array(fields["T_BS"]["data"]).reshape(4, 4)[:3, :3]
    pinhole = np.array([[320.0, 0, 320], [0, 320, 240], [0, 0, 1]])
    mapping = RawCamera(pinhole, body_from_raw.T @ rotation, np.array(fields["intrinsics"], dtype=float), "radial-tangential",
                        np.array(fields["distortion_coefficients"], dtype=float))
    row, column = np.mgrid[0:480, 0:640]
    x, y = mapping.distort(np.column_stack([column.ravel(), row.ravel()]).astype(float)).T
    image = grey(file).astype(float)
    inside = (x > 0) & (x < image.shape[1] - 1.001) & (y > 0) & (y < image.shape[0] - 1.001)
    x, y = np.where(inside, x, 0), np.where(inside, y, 0)
    i, j = y.astype(int), x.astype(int)
    u, v = x - j, y - i
    values = ((1 - v) * ((1 - u) * image[i, j] + u * image[i, j + 1])
              + v * ((1 - u) * image[i + 1, j] + u * image[i + 1, j + 1]))
    return np.where(inside, values, 0).reshape(480, 640).astype(np.uint8)


def rectified_axes() -> tuple[np.ndarray, float]:
    """Rotation body from rectified cameras (x along the baseline), and the baseline in metres."""
    poses = [np.array(yaml.safe_load((EXAMPLE / "mav0" / c / "sensor.yaml").read_text())["T_BS"]["data"])
             .reshape(4, 4) for c in ("cam0", "cam1")]
    baseline = poses[1][:3, 3] - poses[0][:3, 3]
    x = baseline / np.linalg.norm(baseline)
    y = np.cross(poses[0][:3, 2], x)
    y /= np.linalg.norm(y)
    return np.column_stack([x, y, np.cross(x, y)]), float(np.linalg.norm(baseline))


def _quaternion(r: np.ndarray) -> np.ndarray:
    """x y z w of a rotation."""
    w = np.sqrt(max(0, 1 + np.trace(r))) / 2
    if w > 1e-3:
        return np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], 4 * w * w]) / (4 * w)
    values, vectors = np.linalg.eigh((r + r.T) / 2)
    return np.array([*vectors[:, values.argmax()], 0.0])


def write_tartanair(folder: Path, rows: list[int], darken: float = 1.0) -> None:
    """Frames of the example as a folder of TartanAir; darken: exponent of the grey values.

    TartanAir's baseline is 0.25 m and ours is not: the world is scaled so that it is.
    """
    from derived_datasets import BASELINE, BODY_FROM_CAMERA

    rotation, baseline = rectified_axes()
    left_yaml = yaml.safe_load((EXAMPLE / "mav0/cam0/sensor.yaml").read_text())
    camera_in_body = np.array(left_yaml["T_BS"]["data"]).reshape(4, 4)[:3, 3]
    truth = {int(row.split(",")[0]): np.array(row.split(",")[1:8], dtype=float)
             for row in rows_of(EXAMPLE / TRUTH)[1]}
    poses = []
    for camera, name in (("cam0", "left"), ("cam1", "right")):
        (folder / f"image_{name}").mkdir(parents=True)
        images = asl_images(camera, max(rows) + 1)
        for index, row in enumerate(rows):
            pixels = rectify(images[row][1], camera, rotation)
            Image.fromarray((255 * (pixels / 255) ** darken).astype(np.uint8)).save(
                folder / f"image_{name}/{index:06d}_{name}.png")
    for row in rows:
        p, (w, x, y, z) = np.split(truth[asl_images("cam0", row + 1)[row][0]], [3])
        body = np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                         [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                         [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])
        position = (p + body @ camera_in_body) * BASELINE / baseline
        # TartanAir's body is the camera with x forward: world_from_camera · camera_from_that_body.
        tartan = body @ rotation @ BODY_FROM_CAMERA[:3, :3].T
        poses.append([*position, *_quaternion(tartan)])
    np.savetxt(folder / "pose_left.txt", np.array(poses))


__all__ = ["EXAMPLE", "PROGRAM", "REPOSITORY", "TRUTH", "asl_imu", "write_asl", "write_kalibr", "write_tartanair"]
