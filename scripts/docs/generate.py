#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Writes the pages of docs/ that come from the program: options.md and commands.md.

    python3 scripts/docs/generate.py            # write them
    python3 scripts/docs/generate.py --check    # fail when a page is not what the program says
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parent.parent.parent
DOCS = REPOSITORY / "docs"
CONFIGURED = {
    "map": "Of `airslam map --config` ([life of a frame](architecture.md#the-life-of-a-frame)).",
    "refine": "Of `airslam refine --config` and `airslam merge --config` ([refining](refine.md)).",
    "localize": "Of `airslam localize --config` ([localization](relocalization.md)).",
}


def run(airslam: Path, *arguments: str) -> str:
    return subprocess.run([airslam, *arguments], check=True, capture_output=True, text=True).stdout


def options_page(airslam: Path) -> str:
    text = """# Options

Every option that a configuration file can set, as the program knows it: this page is what
`airslam options <command> --markdown` prints, and a test holds it to that. `airslam options <command>`
prints the same as a YAML file to start from:

```
airslam options map > my.yaml       # change what you need, delete the rest
airslam map <dataset> --out out --config my.yaml
```

A file need only name what it changes. An unknown name is an error that says the nearest known one; so is a
value out of its range. A range holds both of its ends; a number without a unit is a count or a ratio.
"""
    for command, about in CONFIGURED.items():
        table = re.sub(r"^### (\S+)$", rf"### {command}: \1", run(airslam, "options", command,
                                                                 "--markdown"), flags=re.MULTILINE)
        text += f"\n## airslam {command}\n\n{about}\n\n{table}"
    return text


def command_names(airslam: Path) -> list[str]:
    """In the order in which --help lists them."""
    listed = run(airslam, "--help").split("Subcommands:\n")[1]
    return [line.split()[0] for line in listed.splitlines() if re.match(r"  \S", line)]


def commands_page(airslam: Path) -> str:
    text = """# Commands

What `--help` prints, for every command; a test holds this page to the program. The exit code is 0 on
success, 1 when a command failed (one sentence on the standard error stream says why), 2 on wrong usage,
128 + the signal when SIGTERM or Ctrl-C ended `map` in order.
Files that `--config` reads are described in [options](options.md).

```
"""
    text += run(airslam, "--help").strip() + "\n```\n"
    for name in command_names(airslam):
        text += f"\n## airslam {name}\n\n```\n{run(airslam, name, '--help').strip()}\n```\n"
    return text


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--airslam", type=Path, default=REPOSITORY / "build/bin/airslam")
    parser.add_argument("--check", action="store_true")
    arguments = parser.parse_args()
    stale = []
    for name, page in (("options.md", options_page), ("commands.md", commands_page)):
        text = page(arguments.airslam.resolve())
        if not arguments.check:
            (DOCS / name).write_text(text)
        elif not (DOCS / name).exists() or (DOCS / name).read_text() != text:
            stale.append(name)
    for name in stale:
        print(f"docs/{name} is not what the program says: run `python3 scripts/docs/generate.py`",
              file=sys.stderr)
    return 1 if stale else 0


if __name__ == "__main__":
    sys.exit(main())
