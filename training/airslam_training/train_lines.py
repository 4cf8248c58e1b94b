# SPDX-License-Identifier: BSD-3-Clause
"""Trains the line module on the frozen backbone: `python -m airslam_training.train_lines [--config c.yaml] [--run name]`.

L1 on the attraction field, binary cross-entropy on confidence, junctions and the classifier, whose proposals are made by
the network itself as it is. A run can be stopped at any time and goes on from its last checkpoint.
"""
from __future__ import annotations

import copy
import math
import time
from pathlib import Path

import cv2
import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from . import augment
from .cache import CACHE
from .export import load_plnet
from .line_data import Views, Wireframe, sources
from .lines import REACH, DecoderOptions, LineConfig, LineModule, propose
from .loop import ROOT, append, average_gradients, launch, learning_rate, update_average
from .validate_lines import validate_lines

COLUMNS = ["step", "images", "loss", "confidence", "field", "ends", "heat", "offset", "classifier", "rate", "images_per_s"]
VALIDATION = ["step", "photos_sap10", "photos_junctions", "photos_proposals", "scenes_sap10", "scenes_junctions",
              "scenes_proposals", "count"]


def field_losses(field: Tensor, target: Tensor, sharpness: float) -> dict[str, Tensor]:
    """Maps B x 6 x h x w, raw and target (score, d, cos, sin, theta1, theta2): confidence, L1 on the field, decoded ends."""
    score = (target[:, 0] * sharpness).clamp_max(1)
    losses = dict(confidence=F.binary_cross_entropy_with_logits(field[:, 0], score))
    weight, total = score, score.sum().clamp_min(1)
    a, b, c, e1, e2 = field[:, 1:].unbind(1)
    norm = (b * b + c * c).clamp_min(1e-6).sqrt()
    half_pi = math.pi / 2
    difference = ((torch.sigmoid(a) - target[:, 1] / REACH).abs() + (b / norm - target[:, 2]).abs()
                  + (c / norm - target[:, 3]).abs() + (torch.sigmoid(e1) - target[:, 4] / half_pi).abs()
                  + (torch.sigmoid(e2) + target[:, 5] / half_pi).abs() + 0.02 * (norm - 1).abs())
    losses["field"] = (difference * weight).sum() / total
    # The same field as end positions along the segment: reaches d * tan theta_i, relative to its length.
    d = REACH * torch.sigmoid(a)
    true1, true2 = target[:, 1] * torch.tan(target[:, 4]), -target[:, 1] * torch.tan(target[:, 5])
    length = (true1 + true2).clamp_min(8)
    off = sum((d * torch.tan(half_pi * torch.sigmoid(e).clamp_max(0.998)) - t).abs() for e, t in ((e1, true1), (e2, true2)))
    losses["ends"] = ((off / length).clamp_max(2) * weight).sum() / total
    return losses


def junction_losses(maps: Tensor, target: Tensor, sharpness: float, positive: float) -> dict[str, Tensor]:
    """Junction maps B x 3 x h x w, raw and target (score, offset x, offset y)."""
    score = (target[:, 0] * sharpness).clamp_max(1)
    heat = F.binary_cross_entropy_with_logits(maps[:, 0], score, 1 + (positive - 1) * score)
    offset = (0.5 * torch.tanh(maps[:, 1:]) - target[:, 1:]).abs().sum(1)
    return dict(heat=heat, offset=(offset * score).sum() / score.sum().clamp_min(1))


def label_proposals(ends: Tensor, segments: np.ndarray, hit: float, sharpness: float) -> Tensor:
    """The score that each proposal N x 4 takes from the nearest label n x 5, 0 where none is within `hit`."""
    if len(segments) == 0:
        return torch.zeros(len(ends))
    s = torch.from_numpy(segments).float()
    p, q = ends[:, None], s[None, :, :4]
    distance = torch.minimum(((p - q) ** 2).sum(-1), ((p - q[..., [2, 3, 0, 1]]) ** 2).sum(-1))
    value = torch.where(distance < hit, s[None, :, 4] * sharpness, torch.zeros(()))
    return value.amax(1).clamp_max(1)


@torch.no_grad()
def grow(net: torch.nn.Module, trained: dict[str, Tensor]) -> None:
    """Takes over the weights of a smaller network so that this one begins as it ended: outputs that both have read their
    old inputs with the old weights, and nothing of what is new; new outputs keep their random weights."""
    for name, value in net.state_dict().items():
        old = trained[name]
        if value.shape == old.shape:
            value.copy_(old)
            continue
        value[:len(old)] = 0
        value[tuple(slice(n) for n in old.shape)] = old


class Trainer:
    """Frozen backbone, line module, its moving average, optimizer and counters."""

    def __init__(self, config: dict, folder: Path, device: torch.device, rank: int = 0):
        self.c, self.folder, self.device, self.rank = config, folder, device, rank
        torch.manual_seed(config["seed"])
        plnet = load_plnet(CACHE / "runs" / config["backbone"] / "checkpoint.pt").to(device)
        self.backbone = plnet.backbone.requires_grad_(False).to(memory_format=torch.channels_last)
        self.net = LineModule(plnet.config, LineConfig(**config["network"])).to(device, memory_format=torch.channels_last)
        if config["start"]:
            state = torch.load(ROOT / config["start"], map_location=device, weights_only=True)
            grow(self.net, state["average"])
        self.average = copy.deepcopy(self.net).eval()
        self.optimizer = torch.optim.AdamW(self.net.parameters(), lr=1e-3, weight_decay=config["weight_decay"])
        self.step = self.images = 0
        if (folder / "checkpoint.pt").exists():
            state = torch.load(folder / "checkpoint.pt", map_location=device, weights_only=True)
            self.net.load_state_dict(state["net"])
            self.average.load_state_dict(state["average"])
            self.optimizer.load_state_dict(state["optimizer"])
            self.step, self.images = state["step"], state["images"]
        seed = config["seed"] + 1000 * self.step + rank
        self.generator, self.rng = torch.Generator(device).manual_seed(seed), np.random.default_rng(seed)
        self.options = DecoderOptions()

    def save(self) -> None:
        state = dict(net=self.net.state_dict(), average=self.average.state_dict(), step=self.step,
                     images=self.images, optimizer=self.optimizer.state_dict(), config=self.c, plnet=self.backbone.state_dict())
        torch.save(state, self.folder / "checkpoint.tmp")
        (self.folder / "checkpoint.tmp").rename(self.folder / "checkpoint.pt")

    def classifier_loss(self, field: Tensor, maps: Tensor, pooled: Tensor, segments: list[np.ndarray]) -> Tensor:
        """Binary cross-entropy of proposals against the labels' scores, all images alike."""
        logits, goals = [], []
        for i, labels in enumerate(segments):
            with torch.no_grad():
                ends, extra, _, _ = propose(field[i], maps[i], self.options)
                chosen = torch.from_numpy(self.rng.permutation(len(ends))[:self.c["proposals"]])
                ends, extra = ends[chosen], extra[chosen]
            if len(ends):
                logits.append(self.net.classify(pooled[i], ends, extra))
                goals.append(label_proposals(ends, labels, self.c["hit"], self.c["sharpness"]).to(self.device))
        if not logits:
            return pooled.sum() * 0
        return F.binary_cross_entropy_with_logits(torch.cat(logits), torch.cat(goals))

    def update(self, batch) -> dict[str, float]:
        """One optimizer step on one batch; returns the losses."""
        c = self.c
        image = torch.from_numpy(batch[0])[:, None].float().to(self.device)
        target, junctions = [torch.from_numpy(b).to(self.device) for b in batch[2:]]
        x = augment.standardize(augment.alter(image, self.generator, c["alter"]))
        x = x.contiguous(memory_format=torch.channels_last)
        with torch.autocast(self.device.type, torch.bfloat16, enabled=c["bf16"]):
            with torch.no_grad():
                features = self.backbone(x)
            field, maps, pooled = self.net.neck(*features)
        field, maps, pooled = field.float(), maps.float(), pooled.float()
        parts = field_losses(field, target, c["sharpness"])
        parts |= junction_losses(maps, junctions, c["sharpness"], c["positive_weight"])
        parts["classifier"] = self.classifier_loss(field.detach(), maps.detach(), pooled, batch[1])
        loss = sum(c["weights"][k] * v for k, v in parts.items())
        for group in self.optimizer.param_groups:
            group["lr"] = learning_rate(self.step, c)
        self.optimizer.zero_grad(set_to_none=False)
        loss.backward()
        average_gradients(self.net)
        torch.nn.utils.clip_grad_norm_(self.net.parameters(), 5.0)
        self.optimizer.step()
        self.step += 1
        self.images += c["batch"]
        update_average(self.average, self.net, c["ema"], self.step)
        return {"loss": float(loss.detach()), **{k: float(v.detach()) for k, v in parts.items()}}


def train(config: dict, folder: Path, rank: int = 0, processes: int = 1) -> None:
    """The loop: rank 0 logs, validates and saves."""
    cv2.setNumThreads(1)
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    trainer = Trainer(config, folder, device, rank)
    pools = [(s, config["shares"][k]) for k, s in sources().items() if config["shares"].get(k)]
    if config["wireframe"]:
        pools.append((Wireframe(Path(config["wireframe"])), config["wireframe_share"]))
    data = Views(pools, config["batch"] // processes, config["size"], config["scales"],
                 config["seed"] + 1000 * trainer.step + rank)
    print(f"process {rank}: {[len(p.names) for p, _ in pools]} images, from step {trainer.step}", flush=True)
    sums: list[dict] = []
    start = time.time()
    while trainer.step < config["steps"]:
        sums.append(trainer.update(data.next()))
        if rank == 0 and trainer.step % config["log_every"] == 0:
            row = {k: float(np.mean([s[k] for s in sums])) for k in sums[0]}
            row |= dict(step=trainer.step, images=trainer.images, rate=learning_rate(trainer.step, config),
                        images_per_s=len(sums) * config["batch"] / (time.time() - start))
            append(folder / "log.csv", COLUMNS, row)
            print(" ".join(f"{k} {row[k]:.4g}" for k in COLUMNS), flush=True)
            sums, start = [], time.time()
        if rank == 0 and trainer.step % config["checkpoint_every"] == 0:
            trainer.save()
        if rank == 0 and trainer.step % config["validate_every"] == 0:
            row = dict(step=trainer.step, **validate_lines(trainer.backbone, trainer.average))
            append(folder / "validation.csv", VALIDATION, row)
            print("validation", row, flush=True)
            start = time.time()
    if rank == 0:
        trainer.save()


if __name__ == "__main__":
    launch(train, "lines", __doc__)
