# SPDX-License-Identifier: BSD-3-Clause
"""Distillation losses of PLNet."""
from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor

from .networks import sample_descriptors

THRESHOLD = -5.0


def dense_cosine(student: Tensor, target: Tensor, shift: tuple[int, int]) -> Tensor:
    """1 - cosine over every second cell in both directions (from `shift` on); B x D x h x w each, the target unit."""
    s, t = student[:, :, shift[1] % 2::2, shift[0] % 2::2], target[:, :, shift[1] % 2::2, shift[0] % 2::2]
    return 1 - ((s * t).sum(1) * (s * s).sum(1).clamp_min(1e-12).rsqrt()).mean()


def contrast(student: Tensor, target: Tensor, points: Tensor, temperature: float) -> Tensor:
    """Student descriptors must rank the teacher's as the teacher itself does.

    Student and target maps B x D x h x w, points B x K x 2. All B·K keypoints compete, so negatives come from the same
    and from other images; the soft target keeps repeated texture from being torn apart.
    """
    s = sample_descriptors(student, points).flatten(0, 1)
    t = sample_descriptors(target, points).flatten(0, 1)
    with torch.no_grad():
        goal = F.softmax((t / temperature) @ t.T, dim=1)
    return F.cross_entropy((s / temperature) @ t.T, goal)


def score(student: Tensor, target: Tensor, softness: float) -> Tensor:
    """Binary cross-entropy of keypoint probability; logits B x 1 x H x W. Keypoints weigh more: they are rare."""
    goal = torch.sigmoid((target - THRESHOLD) / softness)
    weight = 1 + 4 * goal
    return F.binary_cross_entropy_with_logits((student - THRESHOLD) / softness, goal, weight,
                                              reduction="sum") / weight.sum()


def local_position(student: Tensor, target: Tensor, shift: tuple[int, int], window: int = 8) -> Tensor:
    """Where in each window the keypoint is: cross-entropy of a softmax over window pixels and a "none" bin.

    Logits B x 1 x H x W. `shift` moves the window grid, so that no pixel is always at a border.
    """
    s, t = student[:, :, shift[1]:, shift[0]:], target[:, :, shift[1]:, shift[0]:]
    h, w = (s.shape[2] // window) * window, (s.shape[3] // window) * window

    def windows(x: Tensor) -> Tensor:
        x = F.pixel_unshuffle(x[:, :, :h, :w], window)
        return torch.cat([x, torch.full_like(x[:, :1], THRESHOLD)], 1)

    goal = F.softmax(windows(t), dim=1)
    weight = 1.05 - goal[:, -1]  # windows without keypoint hardly count
    loss = F.cross_entropy(windows(s), goal, reduction="none")
    return (loss * weight).sum() / weight.sum()
