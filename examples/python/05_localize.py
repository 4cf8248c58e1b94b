# SPDX-License-Identifier: BSD-3-Clause
"""Where were these images taken? python 05_localize.py [<refined map>]

Needs pillow to read the images.
"""

import sys
from pathlib import Path

import numpy as np
from PIL import Image

import airslam

camera_folder = Path(__file__).resolve().parents[1] / "warehouse_day" / "mav0" / "cam0"
camera = airslam.Camera.load(camera_folder / "sensor.yaml")
localizer = airslam.Localizer(sys.argv[1] if len(sys.argv) > 1 else "out/refined.db", camera)

for file in sorted((camera_folder / "data").iterdir())[7::20]:
    found = localizer.localize(np.array(Image.open(file).convert("L")))
    if found:
        sigma = np.sqrt(np.trace(found.covariance[3:, 3:]))
        print(file.name, found.world_from_body[:3, 3].round(3), f"+- {1e3 * sigma:.1f} mm, {found.inliers} points")
    else:
        print(file.name, "refused:", found.refusal)
