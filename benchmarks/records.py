# SPDX-License-Identifier: BSD-3-Clause
"""Records of benchmark runs: what was measured, with which program, on which machine.

A record is a JSON file of its own in benchmarks/results/; docs/benchmarks.md is rendered from these
(benchmarks/render.py).
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
import time
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parent.parent
RESULTS = REPOSITORY / "benchmarks/results"


def git(*arguments: str) -> str:
    """The answer of a git command in this repository, or nothing."""
    result = subprocess.run(["git", "-C", str(REPOSITORY), *arguments], capture_output=True,
                            text=True, check=False)
    return result.stdout.strip()


def machine() -> str:
    """Processor, and how many of its cores this process may use."""
    processor = next((line.split(":", 1)[1].strip()
                      for line in Path("/proc/cpuinfo").read_text().splitlines()
                      if line.startswith("model name")), platform.processor())
    return f"{len(os.sched_getaffinity(0))} cores of {processor}"


def conditions() -> dict:
    """Taken before the runs: commit, date, machine and what else it did."""
    return {
        "commit": git("rev-parse", "--short=10", "HEAD"),
        "changed": bool(git("status", "--porcelain", "src", "models")),
        "date": time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime()),
        "machine": machine(),
        "load_before": round(os.getloadavg()[0], 1),
    }


def markdown(head: list[str], rows: list[list[str]]) -> str:
    """A markdown table, without a line break at its end."""
    return "\n".join("| " + " | ".join(row) + " |" for row in [head, ["---"] * len(head), *rows])


def write(file: Path, about: dict, configuration: str, protocol: str, results: object) -> None:
    """Writes one record. configuration: options and model pack; protocol: how it was measured."""
    record = {
        **about,
        "configuration": configuration,
        "protocol": protocol,
        "results": results,
    }
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(record, indent=1, ensure_ascii=False) + "\n")


def read(name: str, folder: Path = RESULTS) -> dict | None:
    """The record of a name, if there is one."""
    file = folder / f"{name}.json"
    return json.loads(file.read_text()) if file.exists() else None
