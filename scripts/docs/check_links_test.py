# SPDX-License-Identifier: BSD-3-Clause
"""The checker finds what is broken, and nothing else (standard library only)."""

import tempfile
import unittest
from pathlib import Path

import check_links


class CheckLinks(unittest.TestCase):
    def broken(self, text: str) -> list[str]:
        with tempfile.TemporaryDirectory() as folder:
            other = Path(folder) / "other.md"
            other.write_text("# The life of a `frame`, eq. 5–8\n```\n# not a heading\n```\n")
            page = Path(folder) / "page.md"
            page.write_text(text)
            return check_links.broken_links(page, text)

    def test_links(self):
        self.assertEqual(self.broken("[a](other.md) [b](https://nowhere.invalid) ![c](page.md)"), [])
        self.assertEqual(len(self.broken("[a](nothing.md) ![b](nothing.png)")), 2)

    def test_anchors(self):
        self.assertEqual(self.broken("[a](other.md#the-life-of-a-frame-eq-58)"), [])
        self.assertEqual(len(self.broken("[a](other.md#not-a-heading)")), 1)

    def test_files(self):
        named = "`optimize/point_factor`, `common/options.h`, `scripts/setup.sh`, `docs/`, `a/b`, `m/s`"
        self.assertEqual(check_links.missing_files(named), [])
        self.assertEqual(len(check_links.missing_files("`optimize/pint_factor` `docs/no.md`")), 2)


if __name__ == "__main__":
    unittest.main()
