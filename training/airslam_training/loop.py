# SPDX-License-Identifier: BSD-3-Clause
"""What both training programs share: schedule, moving average, averaged gradients, csv logs, several processes.

On a CPU each process uses one thread and a share of the batch, and gradients are averaged once a step: on a machine
shared with other work this is far faster than threads that must meet at every operation.
"""
from __future__ import annotations

import argparse
import csv
import math
import tempfile
from pathlib import Path

import torch
import torch.distributed as dist
import yaml

from .cache import CACHE

ROOT = Path(__file__).resolve().parents[1]


def learning_rate(step: int, c: dict) -> float:
    """Linear warm-up, a long plateau, then half a cosine down to the final rate from `decay_from` to `steps`.

    The plateau lets the length of a run be decided while it runs: on a shared machine its speed is not known before.
    """
    if step < c["warmup"]:
        return c["learning_rate"] * (step + 1) / c["warmup"]
    t = min(1.0, max(0.0, (step - c["decay_from"]) / max(1, c["steps"] - c["decay_from"])))
    low = c["final_learning_rate"]
    return low + 0.5 * (c["learning_rate"] - low) * (1 + math.cos(math.pi * t))


def average_gradients(net: torch.nn.Module) -> None:
    """Mean of the gradients over all processes (if there are several), in one message."""
    if not dist.is_initialized():
        return
    gradients = [p.grad for p in net.parameters() if p.grad is not None]  # the last stage's confidence has none
    flat = torch.cat([g.flatten() for g in gradients])
    dist.all_reduce(flat)
    flat /= dist.get_world_size()
    for g, part in zip(gradients, flat.split([g.numel() for g in gradients])):
        g.copy_(part.view_as(g))


def append(path: Path, columns: list[str], row: dict) -> None:
    """One line to a csv log (with a header if it is new)."""
    new = not path.exists()
    with path.open("a", newline="") as f:
        writer = csv.DictWriter(f, columns, extrasaction="ignore")
        if new:
            writer.writeheader()
        writer.writerow({k: (f"{row[k]:.5g}" if isinstance(row[k], float) else row[k]) for k in columns})


@torch.no_grad()
def update_average(average: torch.nn.Module, net: torch.nn.Module, decay: float, step: int) -> None:
    """Exponential moving average of weights and batch-norm statistics; shorter in the first steps."""
    decay = min(decay, (1 + step) / (10 + step))
    for a, b in zip(average.state_dict().values(), net.state_dict().values()):
        if a.is_floating_point():
            a.lerp_(b, 1 - decay)
        else:
            a.copy_(b)


def _worker(rank: int, train, config: dict, folder: Path, processes: int, threads: int, meeting: str) -> None:
    """One of several processes that share the batch; they meet over a file."""
    torch.set_num_threads(threads)
    if processes > 1:
        dist.init_process_group("gloo", init_method=f"file://{meeting}", rank=rank, world_size=processes)
    train(config, folder, rank, processes)


def launch(train, name: str, description: str) -> None:
    """Command line of a training program; `train(config, folder, rank, processes)` does the work."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--config", type=Path, default=ROOT / f"config/{name}.yaml")
    parser.add_argument("--run", default=name)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--threads", type=int, default=1, help="of each process")
    options = parser.parse_args()
    config, folder = yaml.safe_load(options.config.read_text()), CACHE / "runs" / options.run
    folder.mkdir(parents=True, exist_ok=True)
    meeting = tempfile.mktemp(prefix="airslam_training_")
    arguments = (train, config, folder, options.processes, options.threads, meeting)
    if options.processes == 1:
        _worker(0, *arguments)
    else:
        torch.multiprocessing.spawn(_worker, arguments, nprocs=options.processes)
