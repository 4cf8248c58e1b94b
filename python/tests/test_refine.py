# SPDX-License-Identifier: BSD-3-Clause
"""refine, merge and export give the program's files, bit for bit, and end in order."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest
import yaml

import airslam
from mapped_example import mapped_example
from stand_ins import PROGRAM


def program(*arguments: object) -> subprocess.CompletedProcess:
    return subprocess.run([PROGRAM, *map(str, arguments)], capture_output=True, text=True, check=False)


def without_measurements(report: dict) -> dict:
    """A report without what differs from run to run, or names files."""
    dropped = ("seconds", "memory_before_mib", "memory_peak_mib", "out", "picture")
    steps = [{k: v for k, v in step.items() if k not in dropped} for step in report["steps"]]
    return {**{k: v for k, v in report.items() if k not in dropped}, "steps": steps}


def test_refine_is_the_programs(tmp_path: Path) -> None:
    source = mapped_example()[1]
    before = (source / "map.db").read_bytes()
    assert program("refine", source, "--out", tmp_path / "a.db", "--report", tmp_path / "a.json").returncode == 0
    words = []
    report = airslam.refine(source, tmp_path / "b.db", report=tmp_path / "b.json",
                            on_progress=lambda *word: words.append(word))
    assert (tmp_path / "a.db").read_bytes() == (tmp_path / "b.db").read_bytes()
    assert (source / "map.db").read_bytes() == before
    told = json.loads((tmp_path / "a.json").read_text())
    assert report == json.loads((tmp_path / "b.json").read_text())
    assert without_measurements(report) == without_measurements(told)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    assert len(report["steps"]) == 5 and report["maps"] == [str(source)]
    assert list(dict.fromkeys(word[0] for word in words)) == [step["name"] for step in report["steps"]]
    assert all(0 <= done <= total and isinstance(state, str) for _, done, total, state in words)


def test_a_dict_is_the_file_of_options(tmp_path: Path) -> None:
    source = mapped_example()[1]
    config = {"processors": "global_bundle, junction_vocabulary", "global_bundle": {"fine_iterations": 3, "huber": 2.5}}
    (tmp_path / "c.yaml").write_text(yaml.safe_dump(config))
    assert program("refine", source, "--out", tmp_path / "a.db", "--config", tmp_path / "c.yaml").returncode == 0
    airslam.refine(source, tmp_path / "b.db", config=config)
    airslam.refine(source, tmp_path / "c.db", config=tmp_path / "c.yaml")
    assert (tmp_path / "a.db").read_bytes() == (tmp_path / "b.db").read_bytes() == (tmp_path / "c.db").read_bytes()


def test_merge_is_the_programs(tmp_path: Path) -> None:
    source = mapped_example()[1]
    assert program("merge", source, source / "map.db", "--out", tmp_path / "a.db").returncode == 0
    report = airslam.merge([source, source / "map.db"], tmp_path / "b.db")
    assert (tmp_path / "a.db").read_bytes() == (tmp_path / "b.db").read_bytes()
    assert report["before"]["components"] == 2 and report["after"]["components"] == 1
    with pytest.raises(airslam.Error, match="two maps at least, not 1"):
        airslam.merge([source], tmp_path / "c.db")


def test_export_is_the_programs(tmp_path: Path) -> None:
    source = mapped_example()[1]
    files = ("k.tum", "m.ply", "sparse/cameras.txt", "sparse/images.txt", "sparse/points3D.txt")
    a, b = tmp_path / "a", tmp_path / "b"
    a.mkdir()
    b.mkdir()
    assert program("export", source, "--tum", a / "k.tum", "--ply", a / "m.ply", "--colmap", a / "sparse").returncode == 0
    assert airslam.export(source, tum=b / "k.tum", ply=b / "m.ply", colmap=b / "sparse") == 0
    for file in files:
        assert (a / file).read_bytes() == (b / file).read_bytes(), file
        assert (a / file).stat().st_size > 0
    assert airslam.export(source, tum=b / "k.tum", component=0) == 0


def test_errors_are_the_programs_sentences(tmp_path: Path) -> None:
    source, out = mapped_example()[1], tmp_path / "out.db"
    nowhere = tmp_path / "nowhere.db"
    for call, arguments in (
            (lambda: airslam.refine(nowhere, out), ["refine", nowhere, "--out", out]),
            (lambda: airslam.refine(source, source / "map.db"), ["refine", source, "--out", source / "map.db"]),
            (lambda: airslam.refine(source, out, model=tmp_path), ["refine", source, "--out", out, "--model", tmp_path]),
            (lambda: airslam.merge([source, nowhere], out), ["merge", source, nowhere, "--out", out]),
            (lambda: airslam.export(source), ["export", source]),
            (lambda: airslam.export(source, ply=out, component=7), ["export", source, "--ply", out, "--component", 7])):
        with pytest.raises(airslam.Error) as raised:
            call()
        assert program(*arguments).stderr == f"airslam: {raised.value}\n"
    assert not out.exists()


def test_other_threads_go_on(tmp_path: Path) -> None:
    """Fails, and does not hang, where the global interpreter lock is held while the map is refined."""
    begun, answered, seen = threading.Event(), threading.Event(), []

    def answer() -> None:
        if begun.wait(60):
            answered.set()

    other = threading.Thread(target=answer)
    other.start()
    before = sys.getswitchinterval()
    sys.setswitchinterval(1000)  # the other thread runs only where the lock is given away
    try:
        airslam.refine(mapped_example()[1], tmp_path / "out.db",
                       on_progress=lambda *word: (begun.set(), seen.append(answered.is_set())))
    finally:
        sys.setswitchinterval(before)
        begun.set()
        other.join()
    assert not seen[0] and seen[-1]


@pytest.mark.parametrize("processor", ["loop_closure", "global_bundle", "junction_vocabulary"])
def test_what_the_callback_raises_ends_it_and_leaves_no_result(processor: str, tmp_path: Path) -> None:
    def stop(name: str, *_: object) -> None:
        if name == processor:
            raise LookupError("enough")

    with pytest.raises(LookupError, match="enough"):
        airslam.refine(mapped_example()[1], tmp_path / "out.db", on_progress=stop)
    assert not list(tmp_path.iterdir())


def test_ctrl_c_ends_it(tmp_path: Path) -> None:
    """The signal comes while the core works: Python's own handler alone would raise after the result is there."""
    def raise_interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, raise_interrupt)
    try:
        with pytest.raises(KeyboardInterrupt):
            signal.setitimer(signal.ITIMER_REAL, 0.01)
            airslam.refine(mapped_example()[1], tmp_path / "out.db")
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    assert not list(tmp_path.iterdir())
