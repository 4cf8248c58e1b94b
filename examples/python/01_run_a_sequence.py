# SPDX-License-Identifier: BSD-3-Clause
"""Maps a recorded sequence: python 01_run_a_sequence.py [<dataset> [<out>]]"""

import sys
from pathlib import Path

import airslam

example = Path(__file__).resolve().parents[1] / "warehouse_day"
dataset, out = (sys.argv[1:] + [example, "out/example_01"][len(sys.argv) - 1:])[:2]

# The files in `out` are those that `airslam map` writes, bit for bit.
result = airslam.run(dataset, out)

print(result.map)
print(f"{len(result.trajectory)} poses; the last body stands at", result.trajectory.world_from_body[-1, :3, 3])
print(f"{result.report['frames_per_second']:.1f} frames/s; results in {out}")
