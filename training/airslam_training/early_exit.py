# SPDX-License-Identifier: BSD-3-Clause
"""What early exit costs and saves, by confidence: `python -m airslam_training.early_exit` writes results/early_exit.md.

On held-out photos and scenes: share of pairs that stop after the first stage, precision and recall of the matches then.
"""
from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
import yaml

from .cache import CACHE
from .evaluate import RESULTS
from .export import load_matcher
from .loop import ROOT
from .pairs import Pairs
from .train_matcher import best_partner, count_matches, run, tensors

CONFIDENCES = (0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.95, 1.0)
SHARE = 0.95  # of the points of both images must be confident


@torch.no_grad()
def collect(net, pairs: Pairs, count: int) -> list[tuple]:
    """For each pair: confidences of stage 0, and (judged, right, true) counts after each stage."""
    rows = []
    for _ in range(count):
        batch = tensors(pairs.batch(1))
        outputs = run(net, batch)
        sure = torch.cat([outputs[0][f"confidence{s}"].sigmoid()[batch[f"mask{s}"] > 0] for s in (0, 1)]).numpy()
        rows.append((sure, [count_matches(best_partner(o)[0], batch) for o in outputs]))
    return rows


def main(checkpoint: Path = CACHE / "runs/matcher/checkpoint.pt", count: int = 120) -> None:
    torch.set_num_threads(1)
    config = yaml.safe_load((ROOT / "config/matcher.yaml").read_text()) | {"points": 256, "unrelated_share": 0.0}
    net = load_matcher(checkpoint)
    lines = ["| confidence | set | stop after stage 0 | precision | recall |", "|---|---|---|---|---|"]
    for name, share in (("photos", 1.0), ("scenes", 0.0)):
        rows = collect(net, Pairs("held", config | {"photo_share": share}, 78), count)
        for c in CONFIDENCES:
            early = [(sure > c).mean() >= SHARE for sure, _ in rows]
            judged, right, true = np.sum([n[0] if e else n[-1] for e, (_, n) in zip(early, rows)], 0)
            lines.append(f"| {c} | {name} | {np.mean(early):.2f} | {right / max(judged, 1):.3f} | {right / true:.3f} |")
    (RESULTS / "early_exit.md").write_text("\n".join(lines) + "\n")
    print("\n".join(lines))


if __name__ == "__main__":
    main()
