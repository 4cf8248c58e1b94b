# SPDX-License-Identifier: BSD-3-Clause
"""A map as numpy arrays: python 03_look_into_a_map.py [<map.db or folder of a run>]"""

import sys

import numpy as np

import airslam

m = airslam.Map.load(sys.argv[1] if len(sys.argv) > 1 else "out/example_01")
print(m, "made with", m.model_pack)

# Keyframes: row k of timestamps_ns, components, world_from_body, ... belongs to m.keyframe(k).
steps = np.linalg.norm(np.diff(m.world_from_body[:, :3, 3], axis=0), axis=1)
print(f"{len(m)} keyframes over {1e-9 * np.ptp(m.timestamps_ns):.1f} s, {steps.sum():.2f} m")

# Points and lines in the world.
low, high = np.percentile(m.landmarks, [5, 95], axis=0)
print("most points lie between", low.round(2), "and", high.round(2))
lengths = np.linalg.norm(m.lines[:, 1] - m.lines[:, 0], axis=1)
print(f"{len(lengths)} lines, the longest {lengths.max(initial=0):.2f} m")

# Observations: (keyframe, keypoint, point) as rows. How well do the points fall onto their keypoints?
intrinsics, errors = m.calibration.camera_matrix, []
observations, landmarks, world_from_camera = m.observations, m.landmarks, m.world_from_camera
for k in range(len(m)):
    seen = observations[observations[:, 0] == k]
    camera_from_world = np.linalg.inv(world_from_camera[k])
    points = landmarks[seen[:, 2]] @ camera_from_world[:3, :3].T + camera_from_world[:3, 3]
    pixels = points @ intrinsics.T
    errors.append(np.linalg.norm(pixels[:, :2] / pixels[:, 2:] - m.keyframe(k).keypoints[seen[:, 1]], axis=1))
print(f"median re-projection error {np.median(np.concatenate(errors)):.2f} pixels")
