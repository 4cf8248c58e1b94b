# SPDX-License-Identifier: BSD-3-Clause
"""What docs/benchmarks.md says of records (standard library only)."""

import json
import tempfile
import unittest
from pathlib import Path

import record_table
import records
import render

ABOUT = {"commit": "0123456789", "changed": False, "date": "2026-01-02 03:04 UTC",
         "machine": "2 cores of a CPU", "load_before": 0.1}


def run(ate: float, posed: int = 300, **changes: object) -> dict:
    return {"sequence": "warehouse_day", "frames": 300, "frames_with_pose": posed, "ate": ate,
            "ate_online": ate, "wall_seconds": 5.0, "frames_per_second": 60.0, "cpu_ms": 25.0,
            "peak_mb": 250.0, "keyframes": 88, "components": 1, "map_mb": 3.0, "images_mb": 200.0,
            "imu": "off", "failure": "", **changes}


class Render(unittest.TestCase):
    def page(self, **found: list[dict]) -> str:
        with tempfile.TemporaryDirectory() as folder:
            for name, runs in found.items():
                records.write(Path(folder) / f"{name}.json", ABOUT, "airslam map", "how",
                              {"warehouse_day": runs})
            return render.page(Path(folder))

    def test_says_where_it_was_measured(self):
        page = self.page(odometry_stereo_lines=[run(0.006)])
        self.assertIn("Commit `0123456789`, 2026-01-02 03:04 UTC, 2 cores of a CPU", page)

    def test_ahead_and_behind(self):
        self.assertIn("| 0.006\u00a0m | 0.016\u00a0m | ORB-SLAM3 | ahead |",
                      self.page(odometry_stereo_lines=[run(0.006)]))
        self.assertIn("| 0.017\u00a0m | 0.016\u00a0m | ORB-SLAM3 | **behind** |",
                      self.page(odometry_stereo_lines=[run(0.017)]))

    def test_frames_without_a_pose_are_named(self):
        self.assertIn("0.0060 (299/300 frames)", self.page(odometry_stereo_lines=[run(0.006, 299)]))

    def test_median_of_runs_without_the_failed(self):
        runs = [run(0.006), run(0.008), run(0.007), run(None, failure="exit code 1")]
        self.assertIn("| 0.0070 |", self.page(odometry_stereo_lines=runs))

    def test_an_imu_that_was_not_used_is_no_result(self):
        page = self.page(odometry_imu_lines=[run(0.0046, imu="inconsistent")])
        self.assertNotIn("0.0046", page)

    def test_mean_ratio_counts_pairs_that_track_the_same_frames(self):
        pairs = [{"keypoints": 400, "points": 0.004, "lines": 0.002, "points_poses": 300,
                  "lines_poses": 300},
                 {"keypoints": 300, "points": 0.004, "lines": 0.008, "points_poses": 300,
                  "lines_poses": 300},
                 {"keypoints": 200, "points": 0.001, "lines": 0.009, "points_poses": 72,
                  "lines_poses": 99}]
        text = render.ablation_table({"results": {"warehouse_day": {"stereo": pairs}}})
        self.assertIn("| warehouse, day | stereo | 1.00 |", text)
        self.assertIn("200: 1.0 → 9.0 (72 → 99 frames)", text)

    def test_uncommitted_changes_are_named(self):
        self.assertIn("with uncommitted changes",
                      render.provenance({**ABOUT, "changed": True, "configuration": "", "protocol": ""}))

    def test_a_table_is_read_from_what_a_program_prints(self):
        self.assertEqual(record_table.parse_table("words\n| a | b c |\n|---|---|\n| 1 | 2 |\n"),
                         {"head": ["a", "b c"], "rows": [["1", "2"]]})

    def test_a_record_is_json(self):
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "new/name.json"
            records.write(file, ABOUT, "configuration", "protocol", [1])
            self.assertEqual(json.loads(file.read_text())["results"], [1])
            self.assertIsNone(records.read("other", Path(folder)))


if __name__ == "__main__":
    unittest.main()
