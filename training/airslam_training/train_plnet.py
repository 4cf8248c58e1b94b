# SPDX-License-Identifier: BSD-3-Clause
"""Trains PLNet's backbone and keypoint head: `python -m airslam_training.train_plnet [--config c.yaml] [--run name]`.

The teacher saw the clean crop (cached); the student sees it altered. A run can be stopped at any time and goes on from
its last checkpoint; time spent stopped does not matter, all schedules count steps.
"""
from __future__ import annotations

import copy
import queue
import threading
import time
from pathlib import Path

import numpy as np
import torch

from . import augment, losses
from .cache import CACHE, DESCRIPTOR_SCALE, SCORE_LOW, SCORE_STEP, Shard
from .loop import append, average_gradients, launch, learning_rate, update_average
from .networks import PLNet, PLNetConfig
from .validate import validate_plnet

COLUMNS = ["step", "crops", "loss", "cosine", "contrast", "score", "local", "rate", "crops_per_s"]
VALIDATION = ["step", "cosine", "accuracy", "correct", "accuracy_dark", "correct_dark"]


class Crops:
    """Random batches from the cached shards, read ahead in a thread."""

    def __init__(self, names: list[str], batch: int, seed: int):
        self.shards = [Shard.open(n) for n in names if (CACHE / f"{n}.keypoint.npy").exists()]
        counts = [len(s.image) for s in self.shards]
        self.where = np.concatenate([np.stack([np.full(n, k), np.arange(n)], 1) for k, n in enumerate(counts)])
        self.batch, self.rng = batch, np.random.default_rng(seed)
        self.queue: queue.Queue = queue.Queue(maxsize=3)
        threading.Thread(target=self._work, daemon=True).start()

    def _work(self) -> None:
        while True:
            order = self.rng.permutation(len(self.where))
            for k in range(0, len(order) - self.batch + 1, self.batch):
                rows = self.where[order[k:k + self.batch]]
                self.queue.put(tuple(np.stack([getattr(self.shards[s], f)[i] for s, i in rows])
                                     for f in ("image", "descriptor", "score", "keypoint")))

    def next(self, device: torch.device):
        """image B x 1 x S x S (grey), descriptors B x 64 x S/4 x S/4 (unit), logits B x 1 x S x S, keypoints B x K x 2."""
        image, descriptor, score, keypoint = [torch.from_numpy(a).to(device) for a in self.queue.get()]
        target = descriptor.permute(0, 3, 1, 2).float().mul_(1 / DESCRIPTOR_SCALE)  # of unit length but for rounding
        return image[:, None].float(), target, score[:, None].float() * SCORE_STEP + SCORE_LOW, keypoint.float()


def draw_points(keypoints: torch.Tensor, count: int, jitter: float, size: int, g: torch.Generator) -> torch.Tensor:
    """`count` keypoints a crop, moved by up to `jitter` pixels; missing ones (-1) become random positions."""
    b, k, _ = keypoints.shape
    choice = torch.rand(b, k, generator=g, device=g.device).argsort(1)[:, :count]
    points = torch.gather(keypoints, 1, choice[..., None].expand(-1, -1, 2))
    anywhere = torch.rand(points.shape, generator=g, device=g.device) * (size - 1)
    points = torch.where(points < 0, anywhere, points)
    return points + (torch.rand(points.shape, generator=g, device=g.device) * 2 - 1) * jitter


class Trainer:
    """Network, its moving average, optimizer and counters: all that a checkpoint holds."""

    def __init__(self, config: dict, folder: Path, device: torch.device, rank: int = 0):
        self.c, self.folder, self.device, self.rank = config, folder, device, rank
        torch.manual_seed(config["seed"])
        self.net = PLNet(PLNetConfig(**config["network"])).to(device, memory_format=torch.channels_last)
        self.average = copy.deepcopy(self.net).eval()
        self.optimizer = torch.optim.AdamW(self.net.parameters(), lr=1e-3, weight_decay=config["weight_decay"])
        self.generator = torch.Generator(device).manual_seed(config["seed"])
        self.step = 0
        checkpoint = folder / "checkpoint.pt"
        if checkpoint.exists():
            self.load(torch.load(checkpoint, map_location=device, weights_only=True))
        # Each process alters its own crops: the seed says which process, and where the run goes on.
        self.generator.manual_seed(config["seed"] + 1000 * self.step + rank)

    def load(self, state: dict) -> None:
        self.net.load_state_dict(state["net"])
        self.average.load_state_dict(state["average"])
        self.optimizer.load_state_dict(state["optimizer"])
        self.step = state["step"]

    def save(self) -> None:
        state = dict(net=self.net.state_dict(), average=self.average.state_dict(), step=self.step,
                     optimizer=self.optimizer.state_dict(), config=self.c)
        torch.save(state, self.folder / "checkpoint.tmp")
        (self.folder / "checkpoint.tmp").rename(self.folder / "checkpoint.pt")

    def update(self, batch) -> dict[str, float]:
        """One optimizer step on one batch; returns the losses."""
        c, g = self.c, self.generator
        image, target, logits, keypoints = batch
        x = augment.standardize(augment.alter(image, g)).contiguous(memory_format=torch.channels_last)
        with torch.autocast(self.device.type, torch.bfloat16):
            maps, scores = self.net(x)
        maps, scores = maps.float(), scores.float()
        points = draw_points(keypoints, c["keypoints"], c["jitter"], image.shape[-1], g)
        shift = tuple(torch.randint(0, 8, (2,), generator=g, device=g.device).tolist())
        parts = dict(cosine=losses.dense_cosine(maps, target, shift),
                     contrast=losses.contrast(maps, target, points, c["temperature"]),
                     score=losses.score(scores, logits, c["score_softness"]),
                     local=losses.local_position(scores, logits, shift))
        loss = sum(c["weights"][k] * v for k, v in parts.items())
        for group in self.optimizer.param_groups:
            group["lr"] = learning_rate(self.step, c)
        self.optimizer.zero_grad(set_to_none=True)
        loss.backward()
        average_gradients(self.net)
        torch.nn.utils.clip_grad_norm_(self.net.parameters(), 5.0)
        self.optimizer.step()
        self.step += 1
        update_average(self.average, self.net, c["ema"], self.step)
        return {"loss": float(loss.detach()), **{k: float(v.detach()) for k, v in parts.items()}}


def train(config: dict, folder: Path, rank: int = 0, processes: int = 1) -> None:
    """The loop: rank 0 logs, validates and saves."""
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    trainer = Trainer(config, folder, device, rank)
    data = Crops(config["shards"], config["batch"] // processes, config["seed"] + 1000 * trainer.step + rank)
    print(f"process {rank}: {len(data.where)} crops, from step {trainer.step}", flush=True)
    sums: list[dict] = []
    start = time.time()
    while trainer.step < config["steps"]:
        sums.append(trainer.update(data.next(device)))
        if rank == 0 and trainer.step % config["log_every"] == 0:
            row = {k: float(np.mean([s[k] for s in sums])) for k in sums[0]}
            row |= dict(step=trainer.step, crops=trainer.step * config["batch"],
                        rate=learning_rate(trainer.step, config),
                        crops_per_s=len(sums) * config["batch"] / (time.time() - start))
            append(folder / "log.csv", COLUMNS, row)
            print(" ".join(f"{k} {row[k]:.4g}" for k in COLUMNS), flush=True)
            sums, start = [], time.time()
        if rank == 0 and trainer.step % config["checkpoint_every"] == 0:
            trainer.save()
        if rank == 0 and trainer.step % config["validate_every"] == 0:
            row = dict(step=trainer.step, **validate_plnet(trainer.average, device))
            append(folder / "validation.csv", VALIDATION, row)
            print("validation", row, flush=True)
            start = time.time()
    if rank == 0:
        trainer.save()


if __name__ == "__main__":
    launch(train, "plnet", __doc__)
