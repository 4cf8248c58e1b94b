# SPDX-License-Identifier: BSD-3-Clause
"""A small matcher in the manner of LightGlue, with early exit between stages.

Self attention (rotary encoding of relative position), cross attention, a double-softmax assignment with matchability,
and a confidence a point that says whether a later stage would still change its mind. Written for the CPU: no concat,
split or rotate-half. The rotation x·cos + rotate(x)·sin needs rotate(Wx), which is a second linear map R·W.

The start is the identity: zero-initialised messages and an orthonormal assignment make the untrained matcher equal to
dual-softmax matching of the descriptors, so training can only add to that.
"""
from __future__ import annotations

from dataclasses import asdict, dataclass

import torch
import torch.nn.functional as F
from torch import Tensor, nn


@dataclass(frozen=True)
class MatcherConfig:
    """`layers` of each stage; after each stage the caller may stop."""

    width: int = 96
    layers: tuple[int, ...] = (2, 2)
    hidden: int = 192
    descriptor: int = 64
    temperature: float = 18.0

    def to_dict(self) -> dict:
        return asdict(self)


def _rotation(width: int) -> Tensor:
    """W x W matrix that maps pairs (a, b) to (-b, a)."""
    r = torch.zeros(width, width)
    even = torch.arange(0, width, 2)
    r[even, even + 1], r[even + 1, even] = -1.0, 1.0
    return r


class Rotary(nn.Module):
    """Learned frequencies: positions 1 x N x 2 -> cos and sin, 1 x N x W (each frequency serves a pair)."""

    def __init__(self, width: int):
        super().__init__()
        octaves = torch.exp2(torch.linspace(-1, 5, width // 2))
        angle = torch.arange(width // 2) * 2.39996  # golden angle: directions evenly spread
        self.frequency = nn.Parameter(torch.stack([octaves * angle.cos(), octaves * angle.sin()]))

    def forward(self, points: Tensor) -> tuple[Tensor, Tensor]:
        # Written as products, not a matmul: half-precision matmuls would lose the position's last digits.
        f = self.frequency.repeat_interleave(2, dim=1)
        theta = points[..., :1] * f[0] + points[..., 1:] * f[1]
        return theta.cos(), theta.sin()


class Update(nn.Module):
    """x + MLP(x, message): the concatenation of the original is a sum of two linear maps. Starts as x."""

    def __init__(self, c: MatcherConfig):
        super().__init__()
        self.from_state = nn.Linear(c.width, c.hidden)
        self.from_message = nn.Linear(c.width, c.hidden, bias=False)
        self.norm = nn.LayerNorm(c.hidden)
        self.out = nn.Linear(c.hidden, c.width)
        nn.init.zeros_(self.out.weight)
        nn.init.zeros_(self.out.bias)

    def forward(self, x: Tensor, message: Tensor) -> Tensor:
        return x + self.out(F.relu(self.norm(self.from_state(x) + self.from_message(message))))


class SelfAttention(nn.Module):
    """Points of one image look at each other; B x N x W -> B x N x W. `bias` B x 1 x N is very negative at padding."""

    def __init__(self, c: MatcherConfig):
        super().__init__()
        w = c.width
        self.query, self.key, self.value = nn.Linear(w, w), nn.Linear(w, w), nn.Linear(w, w)
        self.update = Update(c)
        self.scale = w ** -0.5
        self.register_buffer("rotation", _rotation(w), persistent=False)

    def _turn(self, linear: nn.Linear, x: Tensor, cos: Tensor, sin: Tensor) -> Tensor:
        turned = F.linear(x, self.rotation @ linear.weight, self.rotation @ linear.bias)
        return linear(x) * cos + turned * sin

    def forward(self, x: Tensor, rotary: tuple[Tensor, Tensor], bias: Tensor) -> Tensor:
        q, k = self._turn(self.query, x, *rotary), self._turn(self.key, x, *rotary)
        attention = torch.softmax((q * self.scale) @ k.transpose(1, 2) + bias, dim=-1)
        return self.update(x, attention @ self.value(x))


class CrossAttention(nn.Module):
    """Points of the two images look at each other over one similarity matrix, read by rows and by columns."""

    def __init__(self, c: MatcherConfig):
        super().__init__()
        self.key, self.value = nn.Linear(c.width, c.width), nn.Linear(c.width, c.width)
        self.update = Update(c)
        self.scale = c.width ** -0.25

    def forward(self, x0: Tensor, x1: Tensor, bias0: Tensor, bias1: Tensor) -> tuple[Tensor, Tensor]:
        k0, k1 = self.key(x0) * self.scale, self.key(x1) * self.scale
        to1 = torch.softmax(k0 @ k1.transpose(1, 2) + bias1, dim=-1)
        to0 = torch.softmax(k1 @ k0.transpose(1, 2) + bias0, dim=-1)
        return self.update(x0, to1 @ self.value(x1)), self.update(x1, to0 @ self.value(x0))


class Assignment(nn.Module):
    """States -> match probabilities (matchability0 · matchability1 · dual softmax); also the parts, for the loss."""

    def __init__(self, c: MatcherConfig):
        super().__init__()
        self.project = nn.Linear(c.width, c.width, bias=False)
        nn.init.orthogonal_(self.project.weight, gain=c.temperature ** 0.5)
        self.matchable = nn.Linear(c.width, 1)
        nn.init.zeros_(self.matchable.weight)
        nn.init.constant_(self.matchable.bias, 2.0)

    def forward(self, x0: Tensor, x1: Tensor, bias0: Tensor, bias1: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Similarity B x N x M (masked on both sides) and matchability logits B x N, B x M."""
        similarity = self.project(x0) @ self.project(x1).transpose(1, 2) + bias1 + bias0.transpose(1, 2)
        return similarity, self.matchable(x0)[..., 0], self.matchable(x1)[..., 0]


class Stage(nn.Module):
    """Some layers, then an assignment and a confidence. Stage 0 starts from descriptors."""

    def __init__(self, c: MatcherConfig, layers: int, first: bool):
        super().__init__()
        self.first = first
        if first:
            self.embed = nn.Linear(c.descriptor, c.width, bias=False)
            nn.init.orthogonal_(self.embed.weight)
        self.rotary = Rotary(c.width)
        self.self_attention = nn.ModuleList(SelfAttention(c) for _ in range(layers))
        self.cross_attention = nn.ModuleList(CrossAttention(c) for _ in range(layers))
        self.assignment = Assignment(c)
        self.confidence = nn.Linear(c.width, 1)

    def features(self, x0, x1, points0, points1, mask0, mask1):
        """States after the layers, and the padding biases."""
        bias0, bias1 = (mask0[:, None] - 1) * 1e4, (mask1[:, None] - 1) * 1e4
        if self.first:
            x0, x1 = self.embed(x0), self.embed(x1)
        rotary0, rotary1 = self.rotary(points0), self.rotary(points1)
        for own, cross in zip(self.self_attention, self.cross_attention):
            x0, x1 = own(x0, rotary0, bias0), own(x1, rotary1, bias1)
            x0, x1 = cross(x0, x1, bias0, bias1)
        return x0, x1, bias0, bias1

    def forward(self, x0, x1, points0, points1, mask0, mask1):
        """Inference: x are descriptors (first stage) or states -> state0, state1, scores, confidence0, confidence1."""
        x0, x1, bias0, bias1 = self.features(x0, x1, points0, points1, mask0, mask1)
        similarity, m0, m1 = self.assignment(x0, x1, bias0, bias1)
        scores = torch.softmax(similarity, 2) * torch.softmax(similarity, 1)
        scores = scores * (torch.sigmoid(m0) * mask0)[:, :, None] * (torch.sigmoid(m1) * mask1)[:, None]
        confidence0, confidence1 = self.confidence(x0)[..., 0], self.confidence(x1)[..., 0]
        return x0, x1, scores, torch.sigmoid(confidence0) * mask0, torch.sigmoid(confidence1) * mask1


class Matcher(nn.Module):
    """All stages. `forward` is for training: it returns the raw outputs of every stage."""

    def __init__(self, config: MatcherConfig = MatcherConfig()):
        super().__init__()
        self.config = config
        self.stages = nn.ModuleList(Stage(config, n, i == 0) for i, n in enumerate(config.layers))

    def forward(self, points0, descriptors0, mask0, points1, descriptors1, mask1) -> list[dict[str, Tensor]]:
        """Points B x N x 2 (normalised), descriptors B x N x 64, masks B x N (1 valid) -> a dict a stage."""
        x0, x1, outputs = descriptors0, descriptors1, []
        for stage in self.stages:
            x0, x1, bias0, bias1 = stage.features(x0, x1, points0, points1, mask0, mask1)
            similarity, m0, m1 = stage.assignment(x0, x1, bias0, bias1)
            # The confidence must not bend the states: it reads a detached copy.
            c0, c1 = stage.confidence(x0.detach())[..., 0], stage.confidence(x1.detach())[..., 0]
            outputs.append(dict(similarity=similarity, matchable0=m0, matchable1=m1, confidence0=c0, confidence1=c1))
        return outputs


def log_scores(output: dict[str, Tensor]) -> Tensor:
    """Log match probabilities B x N x M of one stage's raw outputs."""
    s = output["similarity"].float()
    return (F.log_softmax(s, 2) + F.log_softmax(s, 1) + F.logsigmoid(output["matchable0"].float())[:, :, None]
            + F.logsigmoid(output["matchable1"].float())[:, None])
