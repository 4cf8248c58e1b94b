# SPDX-License-Identifier: BSD-3-Clause
"""Where a library of the system is missing, importing the package says which one and what to install."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

from airslam import _core

PACKAGE = Path(_core.__file__).parent


def import_error(root: Path) -> str:
    """The last line that importing the package in `root` writes."""
    done = subprocess.run([sys.executable, "-c", "import airslam"], cwd=root, capture_output=True, text=True, check=False,
                          env={**os.environ, "PYTHONPATH": str(root)})
    assert done.returncode == 1
    return done.stderr.splitlines()[-1]


def test_the_loaders_complaint_becomes_advice(tmp_path: Path) -> None:
    """The module itself, asking for a library of another name: what the system's loader says is real."""
    package = tmp_path / "airslam"
    package.mkdir()
    shutil.copy(PACKAGE / "__init__.py", package)
    module = Path(_core.__file__)
    content = module.read_bytes()
    name, = set(re.findall(rb"\0(libyaml-cpp\.so[^\0]*)(?=\0)", content))
    other = name.replace(b"yaml-cpp", b"yaml-cpq")
    (package / module.name).write_bytes(content.replace(b"\0" + name + b"\0", b"\0" + other + b"\0"))
    said = import_error(tmp_path)
    assert said.startswith(f"ImportError: airslam lacks a library of the system ({other.decode()}): install Debian's ")
    assert "libyaml-cpp0.7" in said and "openvino==" in said


def test_other_failures_are_not_explained_away(tmp_path: Path) -> None:
    package = tmp_path / "airslam"
    package.mkdir()
    shutil.copy(PACKAGE / "__init__.py", package)
    (package / "_core.py").write_text("raise ImportError('another reason')\n")
    assert import_error(tmp_path) == "ImportError: another reason"
