# SPDX-License-Identifier: BSD-3-Clause
"""Trains the matcher on cached features: `python -m airslam_training.train_matcher [--config c.yaml] [--run name]`."""
from __future__ import annotations

import copy
import queue
import threading
import time
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from .loop import append, average_gradients, launch, learning_rate, update_average
from .matcher import Matcher, MatcherConfig, log_scores
from .pairs import Pairs

COLUMNS = ["step", "pairs", "loss", "positive0", "positive1", "negative0", "negative1", "confidence", "rate", "pairs_per_s"]
VALIDATION = ["step", "set", "nearest_precision", "nearest_recall", "precision0", "recall0", "precision1", "recall1",
              "sure0"]
THRESHOLD = 0.1


def assignment_loss(output: dict[str, Tensor], batch: dict[str, Tensor]) -> tuple[Tensor, Tensor]:
    """Negative log likelihood of true matches, and of "unmatchable" at points without partner."""
    scores = log_scores(output)
    positive = -scores[batch["positive"]].mean()
    alone = torch.cat([output["matchable0"][batch["alone0"]], output["matchable1"][batch["alone1"]]]).float()
    return positive, -F.logsigmoid(-alone).mean()


def best_partner(output: dict[str, Tensor]) -> tuple[Tensor, Tensor]:
    """For each row and column its mutual best partner, or -1: B x N, B x M."""
    scores = log_scores(output)
    value0, best0 = scores.max(2)
    value1, best1 = scores.max(1)
    limit = float(np.log(THRESHOLD))
    ids0, ids1 = torch.arange(best0.shape[1]), torch.arange(best1.shape[1])
    good0 = (best1.gather(1, best0) == ids0) & (value0 > limit)
    good1 = (best0.gather(1, best1) == ids1) & (value1 > limit)
    return torch.where(good0, best0, -1), torch.where(good1, best1, -1)


def confidence_loss(outputs: list[dict[str, Tensor]], batch: dict[str, Tensor]) -> Tensor:
    """Cross-entropy of "this stage's partner is the last stage's" for all but the last stage."""
    with torch.no_grad():
        final = best_partner(outputs[-1])
    terms = []
    for output in outputs[:-1]:
        with torch.no_grad():
            same = [(a == b).float() for a, b in zip(best_partner(output), final)]
        for side in (0, 1):
            loss = F.binary_cross_entropy_with_logits(output[f"confidence{side}"].float(), same[side], reduction="none")
            mask = batch[f"mask{side}"]
            terms.append((loss * mask).sum() / mask.sum())
    return sum(terms) / max(1, len(terms))


def run(net: Matcher, batch: dict[str, Tensor]) -> list[dict[str, Tensor]]:
    return net(*[batch[f"{k}{s}"] for s in (0, 1) for k in ("points", "descriptors", "mask")])


def tensors(batch: dict[str, np.ndarray]) -> dict[str, Tensor]:
    return {k: torch.from_numpy(v) for k, v in batch.items()}


def count_matches(partner: Tensor, batch: dict[str, Tensor]) -> np.ndarray:
    """(judged, correct, true): predicted matches whose row has a verdict, those that are right, all true matches."""
    b, i = torch.nonzero(partner >= 0, as_tuple=True)
    right = batch["positive"][b, i, partner[b, i]]
    # Rows without verdict: no true match but something within a few pixels. They count neither way.
    verdict = batch["positive"].any(2) | batch["alone0"]
    return np.array([int(verdict[b, i].sum()), int(right.sum()), int(batch["positive"].sum())])


@torch.no_grad()
def validate(net: Matcher, config: dict) -> list[dict]:
    """Precision and recall on held-out photos and scenes, of every stage and of plain mutual nearest neighbours."""
    rows = []
    for name, share in (("photos", 1.0), ("scenes", 0.0)):
        pairs = Pairs("held", {**config, "photo_share": share, "unrelated_share": 0.0}, 77)
        totals, sure = np.zeros((3, 3)), []
        for _ in range(6):
            batch = tensors(pairs.batch(16))
            outputs = run(net, batch)
            cosine = batch["descriptors0"] @ batch["descriptors1"].transpose(1, 2)
            cosine = cosine - 9 * (1 - batch["mask0"][:, :, None] * batch["mask1"][:, None])
            none = torch.full_like(batch["mask0"], 20.0)
            plain = dict(similarity=cosine * 1e3, matchable0=none, matchable1=none)
            for k, output in enumerate([plain] + outputs):
                totals[k] += count_matches(best_partner(output)[0] if k else nearest(cosine), batch)
            confident = torch.cat([outputs[0][f"confidence{s}"].sigmoid()[batch[f"mask{s}"] > 0] for s in (0, 1)])
            sure.append(float((confident > 0.95).float().mean()))
        row = {"set": name, "sure0": float(np.mean(sure))}
        for label, (judged, right, true) in zip(("nearest_{}", "{}0", "{}1"), totals):
            row[label.format("precision")] = float(right / max(judged, 1))
            row[label.format("recall")] = float(right / max(true, 1))
        rows.append(row)
    return rows


def nearest(cosine: Tensor) -> Tensor:
    """Mutual nearest neighbours without any threshold: B x N partners or -1."""
    best0, best1 = cosine.argmax(2), cosine.argmax(1)
    mutual = best1.gather(1, best0) == torch.arange(best0.shape[1])
    return torch.where(mutual & (cosine.max(2).values > -2), best0, -1)


class Trainer:
    """Matcher, its moving average, optimizer and counter: all that a checkpoint holds."""

    def __init__(self, config: dict, folder: Path):
        self.c, self.folder, self.step = config, folder, 0
        torch.manual_seed(config["seed"])
        network = {**config["network"], "layers": tuple(config["network"]["layers"])}
        self.net = Matcher(MatcherConfig(**network))
        self.average = copy.deepcopy(self.net).eval()
        self.optimizer = torch.optim.AdamW(self.net.parameters(), lr=1e-3, weight_decay=config["weight_decay"])
        if (folder / "checkpoint.pt").exists():
            state = torch.load(folder / "checkpoint.pt", weights_only=True)
            self.net.load_state_dict(state["net"])
            self.average.load_state_dict(state["average"])
            self.optimizer.load_state_dict(state["optimizer"])
            self.step = state["step"]

    def save(self) -> None:
        state = dict(net=self.net.state_dict(), average=self.average.state_dict(), step=self.step,
                     optimizer=self.optimizer.state_dict(), config=self.c)
        torch.save(state, self.folder / "checkpoint.tmp")
        (self.folder / "checkpoint.tmp").rename(self.folder / "checkpoint.pt")

    def update(self, batch: dict[str, Tensor]) -> dict[str, float]:
        with torch.autocast("cpu", torch.bfloat16):
            outputs = run(self.net, batch)
        losses = [assignment_loss(o, batch) for o in outputs]
        confidence = confidence_loss(outputs, batch)
        loss = sum(p + n for p, n in losses) / len(losses) + 0.3 * confidence
        for group in self.optimizer.param_groups:
            group["lr"] = learning_rate(self.step, self.c)
        self.optimizer.zero_grad(set_to_none=True)
        loss.backward()
        average_gradients(self.net)
        torch.nn.utils.clip_grad_norm_(self.net.parameters(), 1.0)
        self.optimizer.step()
        self.step += 1
        update_average(self.average, self.net, self.c["ema"], self.step)
        row = {"loss": float(loss.detach()), "confidence": float(confidence.detach())}
        for i, (p, n) in enumerate(losses):
            row |= {f"positive{i}": float(p.detach()), f"negative{i}": float(n.detach())}
        return row


def _reader(pairs: Pairs, batch: int) -> queue.Queue:
    """Queue that a thread keeps filled with batches."""
    ready: queue.Queue = queue.Queue(maxsize=3)

    def work() -> None:
        while True:
            ready.put(pairs.batch(batch))

    threading.Thread(target=work, daemon=True).start()
    return ready


def train(config: dict, folder: Path, rank: int = 0, processes: int = 1) -> None:
    """The loop: rank 0 logs, validates and saves."""
    trainer = Trainer(config, folder)
    data = _reader(Pairs("train", config, config["seed"] + 1000 * trainer.step + rank), config["batch"] // processes)
    sums: list[dict] = []
    start = time.time()
    while trainer.step < config["steps"]:
        sums.append(trainer.update(tensors(data.get())))
        if rank == 0 and trainer.step % config["log_every"] == 0:
            row = {k: float(np.mean([s[k] for s in sums])) for k in sums[0]}
            row |= dict(step=trainer.step, pairs=trainer.step * config["batch"], rate=learning_rate(trainer.step, config),
                        pairs_per_s=len(sums) * config["batch"] / (time.time() - start))
            append(folder / "log.csv", COLUMNS, row)
            print(" ".join(f"{k} {row[k]:.4g}" for k in COLUMNS), flush=True)
            sums, start = [], time.time()
        if rank == 0 and trainer.step % config["checkpoint_every"] == 0:
            trainer.save()
        if rank == 0 and trainer.step % config["validate_every"] == 0:
            for row in validate(trainer.average, config):
                append(folder / "validation.csv", VALIDATION, dict(step=trainer.step, **row))
                print("validation", row, flush=True)
            start = time.time()
    if rank == 0:
        trainer.save()


if __name__ == "__main__":
    launch(train, "matcher", __doc__)
