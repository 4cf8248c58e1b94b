# SPDX-License-Identifier: BSD-3-Clause
"""The calibration of a converted bag: files of Kalibr or EuRoC as they are, or camera_info.

camera_info states the two cameras and, through their rectifications, how the right one stands to the left:
x_rectified = R x_raw in both, and P of the right camera holds −fx·baseline. It says nothing of an IMU:
a folder made from it is stereo alone.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import yaml

from . import Error
from .asl_folder import AslWriter, Camera
from .bags import CAMERA_INFO, Bag, Choice

MODELS = {"plumb_bob": "radial-tangential", "equidistant": "equidistant", "fisheye": "equidistant"}


def copy_calibration(files: list[Path], writer: AslWriter) -> str:
    """Copies calibration files into the folder being written; says in words what they were."""
    for file in files:
        if not file.exists():
            raise Error(f"the calibration {file} does not exist")
    if len(files) == 1 and files[0].is_dir():
        return _copy_folder(files[0], writer)
    chains = [file for file in files if _is_camchain(file)]
    others = [file for file in files if file not in chains]
    if len(chains) != 1 or len(others) > 1:
        raise Error("--calib takes a Kalibr camchain file (and its IMU file), or a folder that holds "
                      f"these or EuRoC's cam0/sensor.yaml; it got {', '.join(map(str, files))}")
    return _copy_kalibr(chains[0], others[0] if others else None, writer)


def _is_camchain(file: Path) -> bool:
    try:
        content = yaml.safe_load(file.read_text())
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise Error(f"{file} is not valid YAML: {' '.join(str(error).split())}") from None
    return isinstance(content, dict) and "cam0" in content


def _copy_folder(folder: Path, writer: AslWriter) -> str:
    mav0 = folder / "mav0" if (folder / "mav0").is_dir() else folder
    if (mav0 / "cam0/sensor.yaml").exists():
        for sensor in ("cam0", "cam1", "imu0"):
            source = mav0 / sensor / "sensor.yaml"
            if source.exists():
                (writer.mav0 / sensor).mkdir(exist_ok=True)
                shutil.copyfile(source, writer.mav0 / sensor / "sensor.yaml")
            elif sensor != "imu0":
                raise Error(f"the calibration {source} is missing")
        return "EuRoC's sensor.yaml"
    for place in (folder, mav0, folder / "dso"):
        chain = sorted(place.glob("camchain*.yaml"))
        if chain:
            imu = sorted(place.glob("imu*.yaml"))
            return _copy_kalibr(chain[0], imu[0] if imu else None, writer)
    raise Error(f"{folder} holds neither cam0/sensor.yaml (EuRoC) nor camchain*.yaml (Kalibr)")


def _copy_kalibr(chain: Path, imu: Path | None, writer: AslWriter) -> str:
    shutil.copyfile(chain, writer.folder / "camchain.yaml")
    if imu is None:
        return "Kalibr's camchain (without an IMU file: stereo alone)"
    shutil.copyfile(imu, writer.folder / "imu.yaml")
    return "Kalibr's camchain and IMU file"


def write_from_camera_info(bag: Bag, choice: Choice, writer: AslWriter) -> str:
    """Writes both sensor.yaml from the camera_info topics beside the image topics."""
    infos = [_info_beside(bag, topic) for topic in (choice.left, choice.right)]
    rectified = [_is_rectified(topic) for topic in (choice.left, choice.right)]
    left, right = (_camera(info, topic, flat) for info, topic, flat
                   in zip(infos, (choice.left, choice.right), rectified))
    right.base_from_camera = left_from_right(*(np.asarray(_field(i, "r")).reshape(3, 3) for i in infos),
                                             _field(infos[1], "p"), any(rectified))
    writer.write_camera("cam0", left)
    writer.write_camera("cam1", right)
    return "camera_info, which says nothing of an IMU: stereo alone"


def _info_beside(bag: Bag, image_topic: str) -> object:
    """The first camera_info in the namespace of an image topic (compressed ones lie one level deeper)."""
    parts = image_topic.split("/")
    known = {topic.name for topic in bag.topics if topic.type == CAMERA_INFO}
    for depth in (1, 2):
        name = "/".join([*parts[:-depth], "camera_info"])
        if name in known and (info := bag.first(name)) is not None:
            return info
    raise Error(f"the bag has no camera_info beside {image_topic}: give the calibration with --calib "
                  "(Kalibr's camchain, or a folder with EuRoC's cam0/sensor.yaml)")


def _is_rectified(image_topic: str) -> bool:
    return any("rect" in part for part in image_topic.split("/")[-2:])


def _field(info: object, name: str) -> np.ndarray:
    """A matrix of camera_info: upper case in ROS 1, lower case in ROS 2."""
    return np.asarray(getattr(info, name, None) if hasattr(info, name) else getattr(info, name.upper()),
                      dtype=float)


def _camera(info: object, topic: str, rectified: bool) -> Camera:
    p, k, d = _field(info, "p"), _field(info, "k"), _field(info, "d")
    matrix = p.reshape(3, 4) if rectified else k.reshape(3, 3)
    intrinsics = tuple(float(matrix[i, j]) for i, j in ((0, 0), (1, 1), (0, 2), (1, 2)))
    if intrinsics[0] <= 0 or intrinsics[1] <= 0:
        raise Error(f"the camera_info of {topic} is not calibrated: its focal length is not positive")
    size = (int(info.width), int(info.height))
    if rectified or not d.any():
        return Camera(*size, intrinsics, "none", (), np.eye(4))
    if info.distortion_model not in MODELS:
        raise Error(f"the camera_info of {topic} has distortion model \"{info.distortion_model}\"; "
                      f"supported are {', '.join(MODELS)}: calibrate with Kalibr and give --calib")
    if len(d) > 4 and d[4:].any():
        raise Error(f"the camera_info of {topic} has a fifth distortion coefficient, k3 = {d[4]:g}, "
                      "which is not supported: calibrate with k3 fixed at 0, or with Kalibr and --calib")
    return Camera(*size, intrinsics, MODELS[info.distortion_model], tuple(map(float, d[:4])), np.eye(4))


def left_from_right(r_left: np.ndarray, r_right: np.ndarray, p_right: np.ndarray,
                    rectified: bool) -> np.ndarray:
    """4 x 4 pose of the right camera in the left one, from R of both and P of the right."""
    p = p_right.reshape(3, 4)
    if p[0, 0] <= 0 or p[0, 3] >= 0:
        raise Error("the right camera's camera_info states no baseline (P[3] must be −fx·baseline): give "
                      "the calibration with --calib")
    center = np.array([-p[0, 3] / p[0, 0], 0, 0])
    pose = np.eye(4)
    if rectified:
        pose[:3, 3] = center
        return pose
    pose[:3, :3] = r_left.T @ r_right
    pose[:3, 3] = r_left.T @ center
    return pose
