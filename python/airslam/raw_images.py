# SPDX-License-Identifier: BSD-3-Clause
"""The left images of a data set, and where rectified pixels lie in them.

Maps keep features in pixels of the rectified left image. A report draws them into the image as the camera
took it: a rectified pixel becomes a ray, is turned into the raw camera and distorted by its model.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

from . import Error


IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")


def left_images(dataset: Path) -> dict[int, Path]:
    """Time in nanoseconds: file, of an ASL or KITTI folder; empty when it is neither."""
    mav0 = dataset / "mav0" if (dataset / "mav0").is_dir() else dataset
    folder = mav0 / "cam0"
    if (folder / "data.csv").exists():
        rows = (line.replace(",", " ").split() for line in (folder / "data.csv").read_text().splitlines())
        return {int(row[0]): folder / "data" / row[1] for row in rows if len(row) > 1 and row[0].isdigit()}
    if (folder / "data").is_dir():
        return {int(file.stem): file for file in sorted((folder / "data").iterdir()) if file.stem.isdigit()}
    if (dataset / "times.txt").exists() and (dataset / "image_0").is_dir():
        times = [round(float(word) * 1e9) for word in (dataset / "times.txt").read_text().split()]
        files = sorted(f for f in (dataset / "image_0").iterdir() if f.suffix.lower() in IMAGE_SUFFIXES)
        return dict(zip(times, files))
    return {}


@dataclass
class RawCamera:
    """Maps pixels of the rectified left image to those of the image on disk."""

    rectified: np.ndarray           # 3 x 3 camera matrix
    raw_from_rectified: np.ndarray  # 3 x 3 rotation
    raw: np.ndarray                 # fx, fy, cx, cy
    model: str                      # radial-tangential, equidistant or none
    coefficients: np.ndarray        # 4

    def distort(self, pixels: np.ndarray) -> np.ndarray:
        """(n, 2) rectified pixels to (n, 2) raw ones."""
        homogeneous = np.column_stack([pixels, np.ones(len(pixels))])
        rays = homogeneous @ np.linalg.inv(self.rectified).T @ self.raw_from_rectified.T
        x, y = (rays[:, :2] / rays[:, 2:]).T
        x, y = _distort(self.model, self.coefficients, x, y)
        fx, fy, cx, cy = self.raw
        return np.column_stack([fx * x + cx, fy * y + cy])


LINE_STEPS = 9  # a straight rectified line is slightly bent in the raw image


def bent(segments: np.ndarray, camera: RawCamera | None) -> list[np.ndarray]:
    """Segments n x 4 of the rectified image as strips of raw pixels; straight ones without a camera."""
    share = np.linspace(0, 1, LINE_STEPS)[:, None]
    strips = [(1 - share) * line[:2] + share * line[2:] for line in segments]
    return strips if camera is None else [camera.distort(strip) for strip in strips]


def _distort(model: str, c: np.ndarray, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    r2 = x * x + y * y
    if model == "radial-tangential":
        k1, k2, p1, p2 = c
        radial = 1 + r2 * (k1 + k2 * r2)
        return (x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
                y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y)
    if model == "equidistant":
        r = np.sqrt(r2)
        t = np.arctan(r)
        scaled = t * (1 + t**2 * (c[0] + t**2 * (c[1] + t**2 * (c[2] + t**2 * c[3]))))
        scale = np.where(r > 1e-9, scaled / np.maximum(r, 1e-9), 1.0)
        return x * scale, y * scale
    return x, y


def _matrix(field: object) -> np.ndarray:
    return np.array(field["data"] if isinstance(field, dict) else field, dtype=float).reshape(4, 4)


def _load(file: Path) -> dict:
    text = file.read_text()
    return yaml.safe_load(text.split("\n", 1)[1] if text.startswith("%YAML") else text)


def _euroc(mav0: Path) -> tuple[dict, np.ndarray, str]:
    """The left camera's fields, body_from_camera, and the name of its coefficients."""
    fields = _load(mav0 / "cam0/sensor.yaml")
    pose = _matrix(fields["T_BS"])
    if (mav0 / "imu0/sensor.yaml").exists():
        pose = np.linalg.inv(_matrix(_load(mav0 / "imu0/sensor.yaml")["T_BS"])) @ pose
    return fields, pose, "distortion_coefficients"


def _kalibr(chain: Path) -> tuple[dict, np.ndarray, str]:
    fields = _load(chain)["cam0"]
    pose = np.linalg.inv(_matrix(fields["T_cam_imu"])) if "T_cam_imu" in fields else np.eye(4)
    return fields, pose, "distortion_coeffs"


def raw_camera(dataset: Path, rectified: np.ndarray, body_from_rectified: np.ndarray) -> RawCamera:
    """Reads the left camera of a data set. `rectified` and the 4 x 4 pose are those of the map."""
    mav0 = dataset / "mav0" if (dataset / "mav0").is_dir() else dataset
    if (dataset / "calib.txt").exists():  # KITTI: the images are rectified on disk
        fx, fy, cx, cy = rectified[[0, 1, 0, 1], [0, 1, 2, 2]]
        return RawCamera(rectified, np.eye(3), np.array([fx, fy, cx, cy]), "none", np.zeros(4))
    try:
        if (mav0 / "cam0/sensor.yaml").exists():
            fields, pose, name = _euroc(mav0)
        else:
            chain = next(f for folder in (dataset, mav0, dataset / "dso")
                         for f in sorted(folder.glob("camchain*.yaml")))
            fields, pose, name = _kalibr(chain)
        model = {"radtan": "radial-tangential", "plumb_bob": "radial-tangential"}.get(
            fields["distortion_model"], fields["distortion_model"])
        coefficients = np.zeros(4) if model == "none" else np.array(fields[name][:4], dtype=float)
        return RawCamera(rectified, pose[:3, :3].T @ body_from_rectified[:3, :3],
                         np.array(fields["intrinsics"], dtype=float), model, coefficients)
    except (StopIteration, KeyError, TypeError, ValueError, yaml.YAMLError) as error:
        raise Error(f"the left camera's calibration in {dataset} cannot be read: {error!r}") from None
