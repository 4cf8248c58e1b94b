# SPDX-License-Identifier: BSD-3-Clause
"""Data sets that are made from others: Dark-EuRoC, and TartanAir in a layout that airslam reads."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

# -- Dark-EuRoC -------------------------------------------------------------------------------------

LEVELS = 12


def darkness(level: int) -> tuple[float, float]:
    """A and γ of V_out = A V_in^(1/γ) at a level from 0 to 12.

    The paper lowers both alternately from (1, 1); its values stand only in a figure. Ours: an odd level lowers A
    by 0.13, an even one γ by 0.1, down to A = 0.22, γ = 0.4: a grey of 128 ends at 10, one of 64 at 2 of 255.
    """
    if not 0 <= level <= LEVELS:
        raise ValueError(f"level {level} is not one of 0 to {LEVELS}")
    return round(1 - 0.13 * ((level + 1) // 2), 2), round(1 - 0.1 * (level // 2), 2)


def darken(pixels: np.ndarray, level: int) -> np.ndarray:
    """Grey values 0 to 255 at a level; level 0 is the picture itself."""
    a, gamma = darkness(level)
    table = np.rint(255 * a * (np.arange(256) / 255) ** (1 / gamma)).astype(np.uint8)
    return table[pixels]


def make_dark(source: Path, out: Path, level: int) -> None:
    """Writes a EuRoC folder whose images are darkened; everything else is linked."""
    shutil.rmtree(out, ignore_errors=True)
    (out / "mav0").mkdir(parents=True)
    for entry in sorted((source / "mav0").iterdir()):
        target = out / "mav0" / entry.name
        if entry.name not in ("cam0", "cam1"):
            target.symlink_to(entry.resolve())
            continue
        (target / "data").mkdir(parents=True)
        for file in entry.iterdir():
            if file.is_file():
                (target / file.name).symlink_to(file.resolve())
        for file in sorted((entry / "data").iterdir()):
            pixels = np.asarray(Image.open(file).convert("L"))
            # PNG whatever the source was: compressing darkness as JPEG would erase it. The name stays, for
            # data.csv lists it; readers go by the content.
            with (target / "data" / file.name).open("wb") as stream:
                Image.fromarray(darken(pixels, level)).save(stream, "PNG", compress_level=1)


# -- TartanAir --------------------------------------------------------------------------------------

# Both cameras: 640 x 480, focal length 320 px, no distortion, the right one 0.25 m to the right.
SIZE, FOCAL, BASELINE = (640, 480), 320.0, 0.25
# Poses are those of the left camera with x forward, y right, z down; the optical frame is x right, y down,
# z forward.
BODY_FROM_CAMERA = np.array([[0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]], dtype=float)
FIRST_NS, STEP_NS = 1_800_000_000_000_000_000, 100_000_000  # TartanAir states no times: 10 Hz are assumed


@dataclass
class TartanSequence:
    """One folder P???: images and poses of the left camera (body as above)."""

    folder: Path
    left: list[Path]
    right: list[Path]
    positions: np.ndarray    # (n, 3) metres
    quaternions: np.ndarray  # (n, 4) x y z w

    def times(self) -> np.ndarray:
        """Nanoseconds of each frame."""
        return FIRST_NS + STEP_NS * np.arange(len(self.left), dtype=np.int64)


def read_tartanair(folder: Path) -> TartanSequence:
    """Reads image_left, image_right and pose_left.txt (tx ty tz qx qy qz qw a line)."""
    left, right = (sorted(f for f in (folder / name).iterdir() if f.suffix.lower() in (".png", ".jpg"))
                   for name in ("image_left", "image_right"))
    poses = np.loadtxt(folder / "pose_left.txt", ndmin=2)
    if poses.shape[1] != 7 or not len(left) == len(right) == len(poses):
        raise SystemExit(f"reproduce: {folder} has {len(left)} left and {len(right)} right images and "
                         f"{len(poses)} poses of {poses.shape[1]} numbers; expected as many of each, 7 numbers")
    return TartanSequence(folder, left, right, poses[:, :3], poses[:, 3:])


def _sensor_yaml(base_from_camera: np.ndarray) -> str:
    numbers = ", ".join(f"{v:g}" for v in base_from_camera.ravel())
    return (f"T_BS:\n  cols: 4\n  rows: 4\n  data: [{numbers}]\nresolution: [{SIZE[0]}, {SIZE[1]}]\n"
            f"intrinsics: [{FOCAL}, {FOCAL}, {SIZE[0] / 2}, {SIZE[1] / 2}]\ndistortion_model: none\n"
            "distortion_coefficients: [0, 0, 0, 0]\n")


def make_asl(sequence: TartanSequence, out: Path) -> None:
    """Writes an ASL folder of links with calibration and ground truth. TartanAir v1 has no IMU."""
    shutil.rmtree(out, ignore_errors=True)
    right_pose = BODY_FROM_CAMERA.copy()
    right_pose[1, 3] = BASELINE
    for camera, images, pose in (("cam0", sequence.left, BODY_FROM_CAMERA), ("cam1", sequence.right, right_pose)):
        folder = out / "mav0" / camera
        (folder / "data").mkdir(parents=True)
        (folder / "sensor.yaml").write_text(_sensor_yaml(pose))
        rows = ["#timestamp [ns],filename"]
        for time, image in zip(sequence.times(), images):
            name = f"{time}{image.suffix}"
            (folder / "data" / name).symlink_to(image.resolve())
            rows.append(f"{time},{name}")
        (folder / "data.csv").write_text("\n".join(rows) + "\n")
    truth = out / "mav0/state_groundtruth_estimate0"
    truth.mkdir()
    rows = ["#timestamp, p_x, p_y, p_z, q_w, q_x, q_y, q_z"]
    for time, p, q in zip(sequence.times(), sequence.positions, sequence.quaternions):
        rows.append(",".join([str(time), *(repr(float(v)) for v in (*p, q[3], *q[:3]))]))
    (truth / "data.csv").write_text("\n".join(rows) + "\n")


def near(map_sequence: TartanSequence, other: TartanSequence, metres: float, degrees: float) -> np.ndarray:
    """Rows of `other` within a distance and an angle of any frame of the map's sequence."""
    least_cosine = np.cos(np.radians(degrees) / 2)
    rows = []
    for row, (p, q) in enumerate(zip(other.positions, other.quaternions)):
        close = np.linalg.norm(map_sequence.positions - p, axis=1) < metres
        # |q·q'| is the cosine of half the angle between two rotations.
        if (abs(map_sequence.quaternions[close] @ q) > least_cosine).any():
            rows.append(row)
    return np.array(rows, dtype=int)
