#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Writes line_case.json: line maps of random segments with noise, and what the training code decodes from them.

    python make_line_case.py            (needs torch, numpy, opencv; writes beside itself)
"""
import json
import sys
from pathlib import Path

import numpy as np
import torch

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[3] / "training"))
from airslam_training.line_data import encode  # noqa: E402
from airslam_training.lines import END_OFFSETS, REACH, DecoderOptions, discount_overlaps, propose, sample_along, sample_ends  # noqa: E402

WIDTH, HEIGHT, CHANNELS, SAMPLES = 24, 18, 3, 5


def logit(p):
    p = np.clip(p, 1e-4, 1 - 1e-4)
    return np.log(p / (1 - p))


def main():
    rng = np.random.default_rng(4)
    ends = rng.uniform(4, [4 * WIDTH - 4, 4 * HEIGHT - 4], (7, 2))
    pairs = [(0, 1), (1, 2), (2, 3), (3, 4), (4, 5), (5, 6), (6, 0), (0, 3)]
    segments = np.array([[*ends[a], *ends[b], 0.9] for a, b in pairs])
    field, junctions = encode(segments, HEIGHT, WIDTH)
    raw = np.stack([logit(field[0] * 0.8 + 0.02), logit(field[1] / REACH), field[2], field[3],
                    logit(field[4] / (np.pi / 2)), logit(-field[5] / (np.pi / 2))])
    raw += rng.normal(0, 0.08, raw.shape)
    heat = np.stack([logit(junctions[0] * 0.9 + 0.005), *np.arctanh(2 * junctions[1:])])
    heat += rng.normal(0, 0.3, heat.shape)
    # Kept with few digits, so that both sides read the same numbers.
    raw, heat = np.round(raw, 3).astype(np.float32), np.round(heat, 3).astype(np.float32)
    pooled = np.round(rng.normal(size=(CHANNELS, HEIGHT, WIDTH)), 2).astype(np.float32)
    lines, extras, pair, found = propose(torch.from_numpy(raw), torch.from_numpy(heat), DecoderOptions())
    along = sample_along(torch.from_numpy(pooled), lines, SAMPLES)

    scores = torch.from_numpy(np.round(rng.uniform(size=len(lines)), 3).astype(np.float32))
    best = torch.sort(scores, descending=True, stable=True).indices
    discounted = discount_overlaps(torch.cat([lines, scores[:, None]], 1)[best], DecoderOptions().overlap)

    def numbers(x, digits=5):
        return np.round(np.asarray(x, np.float64), digits).tolist()

    case = {"width": WIDTH, "height": HEIGHT, "channels": CHANNELS, "samples": SAMPLES, "field": numbers(raw.ravel()),
            "junction_maps": numbers(heat.ravel()), "pooled": numbers(pooled.transpose(1, 2, 0).ravel()),
            "junctions": numbers(found), "proposals": pair.tolist(), "extras": numbers(extras), "along": numbers(along),
            "end_offsets": END_OFFSETS, "about_ends": numbers(sample_ends(torch.from_numpy(pooled), lines)),
            "scores": numbers(scores), "discounted": numbers(discounted[:, 4])}
    (HERE / "line_case.json").write_text(json.dumps(case) + "\n")
    print(len(found), "junctions,", len(pair), "proposals")


if __name__ == "__main__":
    main()
