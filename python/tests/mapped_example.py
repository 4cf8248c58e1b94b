# SPDX-License-Identifier: BSD-3-Clause
"""One result folder of `airslam map` for all tests that look at results."""

from __future__ import annotations

import atexit
import functools
import shutil
import subprocess
import tempfile
from pathlib import Path

from stand_ins import PROGRAM, write_asl

FRAMES = 40


@functools.cache
def mapped_example() -> tuple[Path, Path]:
    """(data set, result folder): 40 frames of the example. Copy before writing into it."""
    root = Path(tempfile.mkdtemp(prefix="airslam-test-"))
    atexit.register(shutil.rmtree, root, ignore_errors=True)
    dataset = write_asl(root / "dataset", FRAMES)
    subprocess.run([PROGRAM, "map", dataset, "--out", root / "result"], check=True, capture_output=True)
    return dataset, root / "result"


def copy_of_result(folder: Path) -> Path:
    """A result folder of one's own."""
    return Path(shutil.copytree(mapped_example()[1], folder / "result"))
