# SPDX-License-Identifier: BSD-3-Clause
"""Optimizes a map and readies it for localization: python 04_refine.py [<folder of a run> [<refined map>]]"""

import sys

import numpy as np

import airslam

source, target = (sys.argv[1:] + ["out/example_01", "out/refined.db"][len(sys.argv) - 1:])[:2]


def show(processor, done, total, state):
    """One line that is written over and over."""
    print(f"\r{processor} {done}/{total} {state:30}", end="", file=sys.stderr)


# The map is that of `airslam refine`, bit for bit. Options as in its YAML file: docs/options.md has them all.
report = airslam.refine(source, target, config={"global_bundle": {"fine_iterations": 60}}, on_progress=show)
print(file=sys.stderr)

for step in report["steps"]:
    print(f"{step['name']:20} {step['seconds']:.2f} s, error {step['after']['reprojection_rms_px']:.2f} pixels")
before, after = airslam.Map.load(source), airslam.Map.load(target)
moved = np.linalg.norm(after.world_from_body[:, :3, 3] - before.world_from_body[:, :3, 3], axis=1)
print(f"{after}; keyframes moved by {1e3 * moved.max():.1f} mm at the most")
