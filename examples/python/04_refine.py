# SPDX-License-Identifier: BSD-3-Clause
"""Optimizes a map and readies it for localization: python 04_refine.py [<folder of a run> [<refined map>]]

Refining is the program's: airslam.program() is the `airslam` that came with the package.
"""

import subprocess
import sys

import numpy as np

import airslam

source, target = (sys.argv[1:] + ["out/example_01", "out/refined.db"][len(sys.argv) - 1:])[:2]
subprocess.run([airslam.program(), "refine", source, "--out", target], check=True)

before, after = airslam.Map.load(source), airslam.Map.load(target)
moved = np.linalg.norm(after.world_from_body[:, :3, 3] - before.world_from_body[:, :3, 3], axis=1)
print(f"{after}; keyframes moved by {1e3 * moved.max():.1f} mm at the most")
