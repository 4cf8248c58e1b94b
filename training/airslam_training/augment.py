# SPDX-License-Identifier: BSD-3-Clause
"""The seven photometric alterations, as tensor code on the training device.

Every function takes and returns grey images B x 1 x H x W in 0..255 (float) and draws its own random parameters per
image from the generator. `alter` chains them and ends, as a camera does, with noise and rounding to 8 bits.
"""
from __future__ import annotations

import math

import torch
import torch.nn.functional as F
from torch import Tensor

Generator = torch.Generator


def _uniform(g: Generator, n: int, low: float, high: float) -> Tensor:
    """n x 1 x 1 x 1 uniform numbers."""
    return torch.rand(n, 1, 1, 1, generator=g, device=g.device) * (high - low) + low


def _axes(x: Tensor) -> tuple[Tensor, Tensor]:
    """Row and column coordinates in -1..1, 1 x 1 x H x 1 and 1 x 1 x 1 x W."""
    h, w = x.shape[-2:]
    return (torch.linspace(-1, 1, h, device=x.device).view(1, 1, h, 1),
            torch.linspace(-1, 1, w, device=x.device).view(1, 1, 1, w))


def brightness(x: Tensor, g: Generator) -> Tensor:
    """Offset by up to 50 grey levels."""
    return x + _uniform(g, len(x), -50, 50)


def contrast(x: Tensor, g: Generator) -> Tensor:
    """Stretch about the mean by 0.3 to 1.6."""
    mean = x.mean((2, 3), keepdim=True)
    return (x - mean) * _uniform(g, len(x), 0.3, 1.6) + mean


def gamma(x: Tensor, g: Generator) -> Tensor:
    """Exponents 0.4 to 2.7, even in logarithm."""
    return 255 * (x.clamp(0.5, 255) / 255) ** torch.exp(_uniform(g, len(x), -0.9, 1.0))


def blur(x: Tensor, g: Generator) -> Tensor:
    """Gaussian (sigma 0.4 to 1.8) or motion (length up to 10 pixels, any direction), half and half."""
    n, r = len(x), 5
    t = torch.arange(-r, r + 1, device=x.device, dtype=x.dtype)
    yy, xx = t.view(1, -1, 1), t.view(1, 1, -1)
    sigma = _uniform(g, n, 0.4, 1.8).view(n, 1, 1)
    gauss = torch.exp(-(xx ** 2 + yy ** 2) / (2 * sigma ** 2))
    angle, half = _uniform(g, n, 0, math.pi).view(n, 1, 1), _uniform(g, n, 0.5, 5).view(n, 1, 1)
    along, across = xx * angle.cos() + yy * angle.sin(), -xx * angle.sin() + yy * angle.cos()
    motion = torch.exp(-across ** 2 / 0.6) * torch.sigmoid(4 * (half - along.abs()))
    kernel = torch.where(_uniform(g, n, 0, 1).view(n, 1, 1) < 0.5, gauss, motion)
    kernel = kernel / kernel.sum((1, 2), keepdim=True)
    padded = F.pad(x.transpose(0, 1), (r, r, r, r), mode="reflect")
    return F.conv2d(padded, kernel[:, None], groups=n).transpose(0, 1)


def shadow(x: Tensor, g: Generator) -> Tensor:
    """One soft-edged half-plane or band falls into shadow (20 to 70 % of the light left)."""
    n = len(x)
    yy, xx = _axes(x)
    angle = _uniform(g, n, 0, 2 * math.pi)
    distance = xx * angle.cos() + yy * angle.sin() - _uniform(g, n, -0.6, 0.6)
    band = torch.where(_uniform(g, n, 0, 1) < 0.5, distance, distance.abs() - _uniform(g, n, 0.1, 0.6))
    dark = torch.sigmoid(band / _uniform(g, n, 0.005, 0.15))
    return x * (1 - dark * _uniform(g, n, 0.3, 0.8))


def spot(x: Tensor, g: Generator) -> Tensor:
    """Darkness with one to three soft-edged elliptical cones of light, as of a headlamp."""
    n = len(x)
    yy, xx = _axes(x)
    light = torch.zeros_like(x)
    for k in range(3):
        angle, radius = _uniform(g, n, 0, math.pi), _uniform(g, n, 0.25, 1.0)
        u, v = xx - _uniform(g, n, -0.8, 0.8), yy - _uniform(g, n, -0.8, 0.8)
        p = (u * angle.cos() + v * angle.sin()) / radius
        q = (-u * angle.sin() + v * angle.cos()) / (radius * _uniform(g, n, 0.5, 1.0))
        cone = torch.sigmoid((1 - (p * p + q * q)) * _uniform(g, n, 1.5, 8))
        on = 1.0 if k == 0 else (_uniform(g, n, 0, 1) < 0.35).to(x.dtype)
        light = torch.maximum(light, cone * on * _uniform(g, n, 0.5, 1.3))
    return x * (light + _uniform(g, n, 0.0, 0.12))


def shade(x: Tensor, g: Generator) -> Tensor:
    """Additive veil: a smooth random field of up to 70 grey levels (reflections, haze, sensor glow)."""
    n, (h, w) = len(x), x.shape[-2:]
    coarse = torch.rand(n, 1, 4, 4, generator=g, device=g.device) * 2 - 1
    field = F.interpolate(coarse, size=(h, w), mode="bilinear", align_corners=True)
    return x + field * _uniform(g, n, 10, 70)


def darken(x: Tensor, g: Generator) -> Tensor:
    """Scale to a mean grey of 6 to 35 and keep what an 8-bit camera would see of it."""
    mean = x.mean((2, 3), keepdim=True).clamp_min(1)
    target = torch.exp(_uniform(g, len(x), math.log(6), math.log(35)))
    return x * torch.minimum(target / mean, torch.ones_like(mean))


def noise(x: Tensor, g: Generator) -> Tensor:
    """Shot and read noise. The gain (grey levels a photo-electron) sets both; then round to 8 bits."""
    n = len(x)
    gain = torch.exp(_uniform(g, n, math.log(0.01), math.log(0.35)))
    read = torch.exp(_uniform(g, n, math.log(0.2), math.log(2.0)))
    sigma = (x.clamp_min(0) * gain + read * read).sqrt()
    return x + sigma * torch.randn(x.shape, generator=g, device=g.device)


def _some(x: Tensor, g: Generator, probability: float, change) -> Tensor:
    """Apply `change` to a random part of the batch."""
    chosen = torch.nonzero(torch.rand(len(x), generator=g, device=g.device) < probability)[:, 0]
    if len(chosen) == 0:
        return x
    return x.index_copy(0, chosen, change(x[chosen], g).clamp(0, 255))


def alter(x: Tensor, g: Generator, strength: float = 1.0) -> Tensor:
    """Random chain of alterations of clean images, B x 1 x H x W in 0..255 -> the same, whole grey levels.

    About a third of the images end up in darkness or under a spot light. `strength` scales the probabilities.
    """
    s = strength
    x = _some(x, g, 0.30 * s, blur)
    x = _some(x, g, 0.35 * s, gamma)
    x = _some(x, g, 0.25 * s, shadow)
    x = _some(x, g, 0.22 * s, spot)
    x = _some(x, g, 0.20 * s, shade)
    x = _some(x, g, 0.35 * s, contrast)
    x = _some(x, g, 0.30 * s, brightness)
    x = _some(x, g, 0.22 * s, darken)
    x = _some(x, g, 0.70 * s, noise)
    return x.round().clamp(0, 255)


def standardize(x: Tensor) -> Tensor:
    """Images B x 1 x H x W in grey levels -> zero mean and unit deviation each (floor 2 grey levels)."""
    std, mean = torch.std_mean(x, (2, 3), keepdim=True, correction=0)
    return (x - mean) / std.clamp_min(2.0)
