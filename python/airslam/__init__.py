# SPDX-License-Identifier: BSD-3-Clause
"""AirSLAM: stereo and stereo-inertial SLAM with points and lines.

Poses are 4x4 float64 matrices named b_from_a, lengths in metres; times are integer nanoseconds; pixels
are x right, y down, integer at pixel centres; images are uint8 arrays of height x width. What goes wrong
with the input raises airslam.Error with one sentence. Long calls release the GIL.
"""

import os as _os

# Ctrl-C and numpy's threads are Python's; everything else is the core's.
try:
    from airslam._core import (
        Calibration,
        Camera,
        Detections,
        Detector,
        Error,
        Frame,
        ImuNoise,
        Keyframe,
        Localizer,
        Location,
        Map,
        Odometry,
        RunResult,
        StereoRig,
        Trajectory,
        __version__,
        align,
        associate,
        evaluate,
        export,
        info,
        merge,
        refine,
        run,
        set_quiet,
    )
except ImportError as error:
    if "cannot open shared object file" not in str(error):
        raise
    raise ImportError(
        f"airslam lacks a library of the system ({str(error).split(':')[0]}): install Debian's libceres3 "
        "libopencv-core406 libopencv-imgcodecs406 libopencv-calib3d406 libturbojpeg0 libspng0 "
        "libyaml-cpp0.7 libspdlog1.10 libsqlite3-0 libssl3 and PyPI's openvino==2026.4.1"
    ) from error

__all__ = [
    "Calibration",
    "Camera",
    "Detections",
    "Detector",
    "Error",
    "Frame",
    "ImuNoise",
    "Keyframe",
    "Localizer",
    "Location",
    "Map",
    "Odometry",
    "RunResult",
    "StereoRig",
    "Trajectory",
    "align",
    "associate",
    "evaluate",
    "export",
    "info",
    "merge",
    "program",
    "refine",
    "run",
    "set_quiet",
]


def program() -> str:
    """The path of the command-line program `airslam` that came with the package."""
    beside = _os.path.join(_os.path.dirname(__file__), "bin", "airslam")
    return beside if _os.path.exists(beside) else _os.environ.get("AIRSLAM_PROGRAM", "airslam")
