# SPDX-License-Identifier: BSD-3-Clause
"""The numbers that the paper states for its own system, and its sequences. None: a failure there.

Tables and sections are those of "AirSLAM: An Efficient and Illumination-Robust Point-Line Visual SLAM System".
"""

from __future__ import annotations

# Translational RMSE in metres, table "EuRoC": AirVIO (no loops) and AirSLAM (loops). Stereo and IMU.
EUROC = {
    "MH_01_easy": (0.074, 0.019), "MH_02_easy": (0.060, 0.013), "MH_03_medium": (0.114, 0.025),
    "MH_04_difficult": (0.167, 0.056), "MH_05_difficult": (0.125, 0.051), "V1_01_easy": (0.033, 0.032),
    "V1_02_medium": (0.132, 0.014), "V1_03_difficult": (0.238, 0.025), "V2_01_easy": (0.036, 0.014),
    "V2_02_medium": (0.083, 0.018), "V2_03_difficult": (0.168, 0.068),
}
EUROC_AVERAGE = (0.113, 0.030)
EUROC_FRAMES_PER_SECOND = 73  # MH_01_easy, no loops; Intel i9-13900 and NVIDIA RTX 4080
EUROC_SPEED_SEQUENCE = "MH_01_easy"

OIVIO = {
    "MN_015_GV_01": 0.054, "MN_015_GV_02": 0.052, "MN_050_GV_01": 0.062, "MN_050_GV_02": 0.048,
    "MN_100_GV_01": 0.064, "MN_100_GV_02": 0.042, "TN_015_GV_01": 0.057, "TN_050_GV_01": 0.065,
    "TN_100_GV_01": 0.078,
}

UMA_VI = {
    "conference-csc1": 0.490, "conference-csc2": 0.091, "conference-csc3": 0.088,
    "lab-module-csc-rev": 0.504, "lab-module-csc": 0.979, "long-walk-eng": 1.801,
    "third-floor-csc1": 0.070, "third-floor-csc2": 0.127, "two-floors-csc1": 0.066,
    "two-floors-csc2": 0.190,
}

DARK_EUROC_SEQUENCE = "V2_01_easy"
DARK_EUROC_AVERAGE = 0.029  # table of the ablation of lines; the single levels stand only in a figure

# Recall in percent on the TartanAir Day/Night Localization data set, and queries/s (same machine).
TARTANAIR_RECALL = dict(zip((f"P{i:03d}" for i in range(12)), (
    89.5, 78.8, 87.8, 94.6, 88.2, 85.6, 70.0, 72.8, 83.4, 78.8, 81.4, 54.5)))
TARTANAIR_QUERIES_PER_SECOND = 48.8
