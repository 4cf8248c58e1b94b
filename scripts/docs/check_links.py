#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Checks README.md, CHANGELOG.md and docs/ without network (standard library only).

Every relative link and picture names a file that exists, every #anchor a heading of it, and every
`path` in backticks that begins with a folder of the repository or of src/airslam names what exists.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parent.parent.parent
PAGES = [REPOSITORY / "README.md", REPOSITORY / "CHANGELOG.md",
         *sorted((REPOSITORY / "docs").rglob("*.md"))]
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)[^)]*\)")
CODE = re.compile(r"`([^`\n]+)`")
FENCE = re.compile(r"^(```|~~~).*?^\1", re.MULTILINE | re.DOTALL)
SOURCE = REPOSITORY / "src/airslam"
FOLDERS = ({p.name for p in SOURCE.iterdir() if p.is_dir()}
           | {"src", "docs", "scripts", "benchmarks", "examples", "models", "training", "python",
              "cmake"})
# What a run makes, and so is in no checkout.
MADE = ("docs/images/demo_", "examples/python/")


def anchors(page: Path) -> set[str]:
    """Anchors of a page's headings, as mkdocs and most viewers make them."""
    found = set()
    for heading in re.findall(r"^#+\s+(.*?)\s*$", FENCE.sub("", page.read_text()), re.MULTILINE):
        text = re.sub(r"[`*]|\[([^\]]*)\]\([^)]*\)", r"\1", heading).lower()
        found.add(re.sub(r"[\s-]+", "-", re.sub(r"[^\w\s-]", "", text)).strip("-"))
    return found


def broken_links(page: Path, text: str) -> list[str]:
    broken = []
    for target in LINK.findall(text):
        if re.match(r"[a-z]+:", target):
            continue
        path, _, anchor = target.partition("#")
        file = (page.parent / path).resolve() if path else page
        if not file.exists():
            broken.append(f"links to {target}, which does not exist")
        elif anchor and file.suffix == ".md" and anchor not in anchors(file):
            broken.append(f"links to {target}, but {file.name} has no such heading")
    return broken


def exists(path: str) -> bool:
    """A file, a folder, or the name of a source without its ending; * stands for anything."""
    for root in (REPOSITORY, SOURCE):
        if list(root.glob(path)) or list(root.glob(path + ".h")) or list(root.glob(path + ".cc")):
            return True
    return False


def missing_files(text: str) -> list[str]:
    missing = []
    for code in CODE.findall(text):
        path = code.rstrip("/")
        if not re.fullmatch(r"[\w.-]+(/[\w.*-]+)+", path) or path.split("/")[0] not in FOLDERS:
            continue
        if not exists(path) and not path.startswith(MADE):
            missing.append(f"names `{code}`, which does not exist")
    return missing


def main() -> int:
    complaints = []
    for page in PAGES:
        text = FENCE.sub("", page.read_text())
        for complaint in broken_links(page, text) + missing_files(text):
            complaints.append(f"{page.relative_to(REPOSITORY)} {complaint}")
    print("\n".join(complaints) or f"{len(PAGES)} pages: every link and file is there")
    return 1 if complaints else 0


if __name__ == "__main__":
    sys.exit(main())
