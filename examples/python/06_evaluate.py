# SPDX-License-Identifier: BSD-3-Clause
"""Compares a trajectory with ground truth: python 06_evaluate.py [<ground truth> <trajectory>]"""

import sys
from pathlib import Path

import airslam

example = Path(__file__).resolve().parents[1] / "warehouse_day"
given = sys.argv[1:3] or [example / "mav0/state_groundtruth_estimate0/data.csv", "out/example_01/trajectory.tum"]
errors = airslam.evaluate(*given)
print(f"ATE {1e3 * errors['ate_position_m']['rmse']:.1f} mm after {errors['alignment']} alignment, "
      f"{errors['compared_poses']} poses over {errors['path_length_m']:.1f} m")
print(f"RPE {1e3 * errors['rpe_translation_m']['rmse']:.2f} mm and {errors['rpe_rotation_deg']['rmse']:.3f} degrees a frame")
