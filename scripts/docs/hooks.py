# SPDX-License-Identifier: BSD-3-Clause
"""What mkdocs does not do by itself: mathematics without JavaScript and its font, links out of docs/."""

from __future__ import annotations

import html
import re
import shutil
from pathlib import Path

from latex2mathml.converter import convert

FONT = Path(".venv-docs/fonts/STIXMath-Regular.otf")  # fetched by scripts/docs/build.sh
# [text](../path): a file of the repository, which the site does not hold.
OUTSIDE = re.compile(r"\[([^\]]+)\]\((?:\.\./)+((?!\.\.)[^)#\s]+)(?:#[^)]*)?\)")
# What pymdownx.arithmatex leaves of $...$ and $$...$$.
INLINE = re.compile(r'<span class="arithmatex">\\\((.*?)\\\)</span>', re.DOTALL)
BLOCK = re.compile(r'<div class="arithmatex">\s*\\\[(.*?)\\\]\s*</div>', re.DOTALL)
# A minus after an opening bracket, a comma or an equals sign.
SIGN = re.compile(r"(<mo[^>]*>(?:&#x00028;|\(|&#x0003D;|=|&#x0002C;|,|\[)</mo>)<mo>&#x02212;</mo>")
# The name of a function whose argument has no bracket.
FUNCTION = re.compile(r"(<m[io]>(?:sin|cos|tan|cot)</m[io]>)(?!<mo[^>]*>(?:&#x00028;|\())")


def on_page_markdown(markdown: str, page, **_) -> str:
    """Names files outside docs/ instead of linking to them; pages within it stay links."""
    depth = page.file.src_uri.count("/")

    def name(match: re.Match) -> str:
        steps = match[0].count("../", match[0].index("]("))
        if steps <= depth:
            return match[0]
        text, path = match[1], match[2]
        return f"`{path}`" if text == path else f"{text} (`{path}`)"

    return OUTSIDE.sub(name, markdown)


def mathml(tex: str, display: str) -> str:
    """MathML of a formula, with what latex2mathml does not know: bars are brackets, a minus that begins
    something is a sign and not an operation, a function's name keeps away from its argument."""
    tex = html.unescape(tex).replace(r"\lvert", r"\left|").replace(r"\rvert", r"\right|")
    text = SIGN.sub(r'\1<mo form="prefix">&#x02212;</mo>', convert(tex, display=display))
    return FUNCTION.sub(r'\1<mspace width="0.17em"/>', text)


def on_page_content(content: str, **_) -> str:
    """MathML in place of TeX."""
    content = INLINE.sub(lambda m: mathml(m[1], "inline"), content)
    return BLOCK.sub(lambda m: f'<div class="equation">{mathml(m[1], "block")}</div>', content)


def on_post_build(config, **_) -> None:
    """Puts the font of the formulas beside the style sheet that names it."""
    if FONT.exists():
        shutil.copy(FONT, Path(config["site_dir"]) / FONT.name)
