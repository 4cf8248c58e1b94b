# SPDX-License-Identifier: BSD-3-Clause
"""Skips with a clear word where PyTorch or the shared data are absent."""
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
for package in ("torch", "cv2", "onnx", "onnxruntime", "openvino"):
    pytest.importorskip(package, reason=f"{package} is not installed (training/requirements.txt)")


@pytest.fixture
def photos():
    """Training photos of the shared data."""
    from airslam_training.teacher import SHARED
    if not (SHARED / "data/photos").is_dir():
        pytest.skip(f"no training photos in {SHARED}")
    from airslam_training.cache import photo_split
    return photo_split()[0]
