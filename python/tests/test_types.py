# SPDX-License-Identifier: BSD-3-Clause
"""The package is typed: the stub beside the module names what the package offers."""

from __future__ import annotations

import ast
import sys
from pathlib import Path

import pytest

import airslam
from airslam import _core
from airslam.__main__ import main


def test_stub_names_everything_with_words() -> None:
    stub = ast.parse((Path(_core.__file__).parent / "_core.pyi").read_text())
    stubs = {node.name: node for node in stub.body if isinstance(node, (ast.ClassDef, ast.FunctionDef))}
    offered = set(airslam.__all__) - {"program"}
    assert offered <= set(stubs)
    for name in offered:
        assert ast.get_docstring(stubs[name]), name
    assert (Path(airslam.__file__).parent / "py.typed").exists()


def test_commands_hide_no_function(capsys: pytest.CaptureFixture) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["--help"])  # imports the module of every command
    assert ended.value.code == 0 and "run" in capsys.readouterr().out
    assert all(callable(getattr(airslam, name)) for name in airslam.__all__)


def test_a_command_without_its_packages_says_what_to_install(
        monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture) -> None:
    monkeypatch.setitem(sys.modules, "airslam.view", None)  # as if it could not be imported
    assert main(["view", "map.db", "--whatever"]) == 1
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and said.endswith("pip install '.[view]'\n")
