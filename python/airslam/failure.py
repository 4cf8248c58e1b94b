# SPDX-License-Identifier: BSD-3-Clause
"""What a command of `python -m airslam` says when it cannot do what was asked: one sentence."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable


class Failure(Exception):
    """An error that the user can act on; its text is one sentence that names file and reason."""


def ends_with_a_sentence(command: Callable[..., int]) -> Callable[..., int]:
    """Makes a command's main print a Failure to standard error and return 1."""

    @functools.wraps(command)
    def run(*arguments: object, **options: object) -> int:
        try:
            return command(*arguments, **options)
        except Failure as failure:
            print(f"airslam: {failure}", file=sys.stderr)
            return 1

    return run
