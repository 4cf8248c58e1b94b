# SPDX-License-Identifier: BSD-3-Clause
"""Reading recordings (.rrd) back with rerun's own reader."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rerun.chunk import RrdReader


class Recorded:
    """Every value of every entity, in order of time."""

    def __init__(self, file: Path):
        self._values: dict[str, dict[str, list[tuple[int, int, object]]]] = {}
        for chunk in RrdReader(str(file)).stream():
            batch = chunk.to_record_batch()
            columns = {name: batch.column(name).to_pylist() for name in batch.schema.names}
            frames = columns.get("frame", [-1] * batch.num_rows)
            for name, cells in columns.items():
                if ":" not in name:
                    continue
                stored = self._values.setdefault(chunk.entity_path, {}).setdefault(name, [])
                for frame, cell in zip(frames, cells):
                    if cell is not None:
                        stored.append((frame, len(stored), cell))
        for components in self._values.values():
            for rows in components.values():
                rows.sort(key=lambda row: row[:2])

    def has(self, entity: str) -> bool:
        """Whether anything was logged there."""
        return entity in self._values

    def entities(self) -> list[str]:
        """All of them."""
        return sorted(self._values)

    def count(self, entity: str, component: str) -> int:
        """How many values over time."""
        return len(self._values[entity][component])

    def nth(self, entity: str, component: str, index: int) -> np.ndarray | list:
        """The n-th value in order of frames: an array where it is one."""
        value = self._values[entity][component][index][2]
        try:
            return np.array(value, dtype=np.float32)
        except ValueError:
            return value

    def last(self, entity: str, component: str) -> np.ndarray | list:
        """The last value."""
        return self.nth(entity, component, -1)
