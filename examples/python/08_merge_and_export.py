# SPDX-License-Identifier: BSD-3-Clause
"""Joins two sessions into one map and writes it for other programs:

python 08_merge_and_export.py [<map> <map> [<folder>]]

The maps of examples 01 and 02 are of the same recording; two of your own would be of the same place by day and by
night, or of two rounds.
"""

import sys
from pathlib import Path

import airslam

given = sys.argv[1:] or ["out/example_01", "out/example_02"]
folder = Path(given[2] if len(given) > 2 else "out/example_08")

joined = folder / "joined.db"
report = airslam.merge(given[:2], joined)  # the first one's world stays
print(f"{report['before']['components']} components, then {report['after']['components']}:", airslam.Map.load(joined))

# Open the PLY file with MeshLab, CloudCompare or Open3D, the folder with COLMAP.
airslam.export(joined, tum=folder / "keyframes.tum", ply=folder / "joined.ply", colmap=folder / "sparse/0")
print(*sorted(str(f.relative_to(folder)) for f in folder.rglob("*") if f.is_file()))
