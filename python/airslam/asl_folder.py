# SPDX-License-Identifier: BSD-3-Clause
"""Writing data sets in EuRoC's ASL layout, which `airslam map` reads."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType

import numpy as np

from . import Error


IMU_HEADER = ("#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
              "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]")
MAX_PAIR_DIFFERENCE_NS = 5_000_000  # as the reader of AirSLAM pairs left and right


@dataclass
class Camera:
    """A calibrated camera as EuRoC's sensor.yaml states it."""

    width: int
    height: int
    intrinsics: tuple[float, float, float, float]  # fx, fy, cx, cy in pixels
    distortion_model: str                          # radial-tangential, equidistant or none
    distortion: tuple[float, ...]                  # 4 coefficients, none without a model
    base_from_camera: np.ndarray                   # 4 x 4, T_BS

    def yaml(self) -> str:
        """The text of sensor.yaml."""
        matrix = ", ".join(repr(float(value)) for value in self.base_from_camera.ravel())
        coefficients = ", ".join(repr(float(value)) for value in self.distortion) or "0, 0, 0, 0"
        return (f"sensor_type: camera\nT_BS:\n  cols: 4\n  rows: 4\n  data: [{matrix}]\n"
                f"resolution: [{self.width}, {self.height}]\ncamera_model: pinhole\n"
                f"intrinsics: [{', '.join(repr(float(v)) for v in self.intrinsics)}]\n"
                f"distortion_model: {self.distortion_model}\n"
                f"distortion_coefficients: [{coefficients}]\n")


@dataclass
class _Images:
    rows: dict[int, str] = field(default_factory=dict)  # time in nanoseconds: file name
    repeated: int = 0


class AslWriter:
    """Writes one folder; used as a context. It appears as a whole at the end, or not at all.

    `out` must not exist, or be a folder that an earlier run of this class has written.
    """

    def __init__(self, out: Path):
        if out.exists() and not (out / "mav0").is_dir():
            raise Error(f"{out} exists and is no ASL folder: it is not replaced")
        self.out, self._partial = out, out.with_name(out.name + ".partial")
        self._images = {"cam0": _Images(), "cam1": _Images()}
        self._imu: list[tuple[int, tuple[float, ...]]] = []

    def __enter__(self) -> AslWriter:
        shutil.rmtree(self._partial, ignore_errors=True)
        for camera in self._images:
            (self.mav0 / camera / "data").mkdir(parents=True)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        if kind is None:
            try:
                self._write_lists()
            except BaseException:
                shutil.rmtree(self._partial)
                raise
            if self.out.exists():
                shutil.rmtree(self.out)
            self._partial.rename(self.out)
        else:
            shutil.rmtree(self._partial, ignore_errors=True)

    @property
    def folder(self) -> Path:
        """The folder while it is being written."""
        return self._partial

    @property
    def mav0(self) -> Path:
        """Its mav0."""
        return self._partial / "mav0"

    def add_image(self, camera: str, time_ns: int, content: bytes, suffix: str) -> None:
        """Adds an image file of cam0 or cam1. A time that was there before is dropped and counted."""
        images = self._images[camera]
        if time_ns in images.rows:
            images.repeated += 1
            return
        name = f"{time_ns}{suffix}"
        (self.mav0 / camera / "data" / name).write_bytes(content)
        images.rows[time_ns] = name

    def add_imu(self, time_ns: int, gyroscope: Sequence[float], acceleration: Sequence[float]) -> None:
        """Adds a reading in rad/s and m/s²."""
        self._imu.append((time_ns, (*gyroscope, *acceleration)))

    def write_camera(self, camera: str, calibration: Camera) -> None:
        """Writes sensor.yaml of cam0 or cam1."""
        (self.mav0 / camera / "sensor.yaml").write_text(calibration.yaml())

    def repeated_images(self) -> int:
        """How many images were dropped because their time was there before."""
        return sum(images.repeated for images in self._images.values())

    def image_counts(self) -> tuple[int, int]:
        """Numbers of left and right images."""
        return len(self._images["cam0"].rows), len(self._images["cam1"].rows)

    def imu_samples(self) -> np.ndarray:
        """All readings so far, (n, 6): angular velocity, acceleration."""
        return np.array([values for _, values in self._imu]).reshape(-1, 6)

    def closest_pair_ns(self) -> tuple[int, int]:
        """How many left images have a right one within 5 ms, and the smallest difference of all."""
        left, right = (np.array(sorted(images.rows)) for images in self._images.values())
        if not len(left) or not len(right):
            return 0, 0
        after = np.clip(np.searchsorted(right, left), 0, len(right) - 1)
        before = np.clip(after - 1, 0, None)
        difference = np.minimum(abs(right[after] - left), abs(right[before] - left))
        return int((difference <= MAX_PAIR_DIFFERENCE_NS).sum()), int(difference.min())

    def _write_lists(self) -> None:
        for camera, images in self._images.items():
            rows = [f"{time},{images.rows[time]}" for time in sorted(images.rows)]
            (self.mav0 / camera / "data.csv").write_text(
                "\n".join(["#timestamp [ns],filename", *rows]) + "\n")
        if self._imu:
            folder = self.mav0 / "imu0"
            folder.mkdir(exist_ok=True)
            rows = [",".join([str(time), *(repr(float(value)) for value in values)])
                    for time, values in self._imu]
            (folder / "data.csv").write_text("\n".join([IMU_HEADER, *rows]) + "\n")
