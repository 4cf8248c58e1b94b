#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Runs a program that prints a markdown table and records the table.

    python3 benchmarks/record_table.py --json benchmarks/results/refine_growth.json \
        --protocol "what was measured" build-bench/bin/refine_growth 1 4 16
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

import records


def parse_table(text: str) -> dict:
    """Head and rows of the only table in a text."""
    lines = [[cell.strip() for cell in line.strip("| ").split("|")] for line in text.splitlines()
             if line.startswith("|")]
    return {"head": lines[0], "rows": lines[2:]}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", type=Path, required=True)
    parser.add_argument("--protocol", required=True)
    parser.add_argument("command", nargs="+")
    arguments = parser.parse_args()
    about = records.conditions()
    run = subprocess.run(arguments.command, capture_output=True, text=True, check=False)
    print(run.stdout, end="")
    if run.returncode != 0:
        print(run.stderr, end="", file=sys.stderr)
        return run.returncode
    command = " ".join([Path(arguments.command[0]).name, *arguments.command[1:]])
    records.write(arguments.json, about, command, arguments.protocol, parse_table(run.stdout))
    return 0


if __name__ == "__main__":
    sys.exit(main())
