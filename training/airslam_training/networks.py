# SPDX-License-Identifier: BSD-3-Clause
"""PLNet for two CPU cores: a plain convolutional backbone and a keypoint head.

The backbone keeps thin layers at high resolution short (two strided stem convolutions) and spends its arithmetic
at 1/4 and 1/8 of the image size. Everything is 3x3 / 1x1 convolution + batch norm + ReLU, so batch norms fold into
the convolutions at export and the network quantizes to int8 without surprises. The line module of part 2 attaches to
the same `Backbone` features at /4, /8 and /16.
"""
from __future__ import annotations

from dataclasses import asdict, dataclass

import torch
import torch.nn.functional as F
from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_conv_bn_eval


@dataclass(frozen=True)
class PLNetConfig:
    """Widths and depths of the network. `w2` is the width at half resolution, and so on."""

    w2: int = 16
    w4: int = 32
    w8: int = 64
    w16: int = 96
    n4: int = 2
    n8: int = 3
    n16: int = 2
    fused: int = 64
    score: int = 32
    descriptor: int = 64

    def to_dict(self) -> dict:
        return asdict(self)


class ConvBnRelu(nn.Sequential):
    """k x k convolution, batch norm and (optionally) ReLU; shapes B x Cin x H x W -> B x Cout x H/s x W/s."""

    def __init__(self, cin: int, cout: int, k: int = 3, stride: int = 1, relu: bool = True, dilation: int = 1):
        layers: list[nn.Module] = [nn.Conv2d(cin, cout, k, stride, k // 2 * dilation, dilation, bias=False),
                                   nn.BatchNorm2d(cout)]
        if relu:
            layers.append(nn.ReLU(inplace=True))
        super().__init__(*layers)


class Residual(nn.Module):
    """Two 3x3 convolutions with a skip, the pair that makes depth trainable. B x C x H x W -> the same."""

    def __init__(self, c: int, dilation: int = 1):
        super().__init__()
        self.a = ConvBnRelu(c, c, dilation=dilation)
        self.b = ConvBnRelu(c, c, relu=False, dilation=dilation)

    def forward(self, x: Tensor) -> Tensor:
        return F.relu(x + self.b(self.a(x)))


def _stage(c: int, n: int) -> nn.Sequential:
    """`n` 3x3 convolutions of width `c`, in residual pairs; an odd one comes first, plain."""
    layers: list[nn.Module] = [ConvBnRelu(c, c) for _ in range(n % 2)]
    layers += [Residual(c) for _ in range(n // 2)]
    return nn.Sequential(*layers)


class Backbone(nn.Module):
    """Image B x 1 x H x W (standardized) -> features at /4, /8 and /16 (w4, w8, w16 channels)."""

    def __init__(self, c: PLNetConfig):
        super().__init__()
        self.stem = nn.Sequential(ConvBnRelu(1, c.w2, stride=2), ConvBnRelu(c.w2, c.w4, stride=2))
        self.stage4 = _stage(c.w4, c.n4)
        self.down8 = ConvBnRelu(c.w4, c.w8, stride=2)
        self.stage8 = _stage(c.w8, c.n8)
        self.down16 = ConvBnRelu(c.w8, c.w16, stride=2)
        self.stage16 = _stage(c.w16, c.n16)

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        f4 = self.stage4(self.stem(image))
        f8 = self.stage8(self.down8(f4))
        f16 = self.stage16(self.down16(f8))
        return f4, f8, f16


def _up2(x: Tensor) -> Tensor:
    return F.interpolate(x, scale_factor=2.0, mode="bilinear", align_corners=False)


class KeypointHead(nn.Module):
    """Backbone features -> descriptors B x D x H/4 x W/4 (not normalised) and score logits B x 1 x H x W."""

    def __init__(self, c: PLNetConfig):
        super().__init__()
        self.lateral16 = nn.Conv2d(c.w16, c.fused, 1)
        self.lateral8 = nn.Conv2d(c.w8, c.fused, 1)
        self.lateral4 = nn.Conv2d(c.w4, c.fused, 1)
        self.fuse = ConvBnRelu(c.fused, c.fused, 1)
        self.descriptor = nn.Conv2d(c.fused, c.descriptor, 1)
        # Scores need position more than meaning: they read the /4 features and a thin summary of the coarser ones.
        self.score_context = nn.Conv2d(c.w8, c.score, 1)
        self.score_in = nn.Conv2d(c.w4, c.score, 3, padding=1)
        self.score_mid = ConvBnRelu(c.score, c.score)
        self.score_out = nn.Conv2d(c.score, 16, 3, padding=1)

    def forward(self, f4: Tensor, f8: Tensor, f16: Tensor) -> tuple[Tensor, Tensor]:
        coarse = self.lateral8(f8) + _up2(self.lateral16(f16))
        fused = F.relu(self.lateral4(f4) + _up2(coarse))
        return self.descriptor(self.fuse(fused)), F.pixel_shuffle(self.score_cells(f4, f8), 4)

    def score_cells(self, f4: Tensor, f8: Tensor) -> Tensor:
        """Score logits B x 16 x H/4 x W/4: those of a cell's 4 x 4 pixels, row by row."""
        s = F.relu(self.score_in(f4) + _up2(self.score_context(f8)))
        return self.score_out(self.score_mid(s))

    def at_points(self) -> nn.Sequential:
        """The descriptor head for features sampled at N points: N x (w4 + w8 + w16) -> N x D, not normalised.

        Upsampling, sampling and 1x1 convolutions are linear and change places; only the two ReLUs see a point rather than
        cells around it. Cosine to what is sampled of the dense map: 0.998 in the mean."""
        laterals = [self.lateral4, self.lateral8, self.lateral16]
        fuse = fuse_conv_bn_eval(self.fuse[0].eval(), self.fuse[1].eval())
        weights = [torch.cat([m.weight for m in laterals], 1), fuse.weight, self.descriptor.weight]
        biases = [sum(m.bias for m in laterals), fuse.bias, self.descriptor.bias]
        layers: list[nn.Module] = []
        for weight, bias in zip(weights, biases):
            layer = nn.Linear(weight.shape[1], weight.shape[0])
            layer.weight.data, layer.bias.data = weight.detach()[..., 0, 0].clone(), bias.detach().clone()
            layers += [layer, nn.ReLU()]
        return nn.Sequential(*layers[:-1])


class PLNet(nn.Module):
    """Backbone and keypoint head. Image B x 1 x H x W, H and W multiples of 16."""

    def __init__(self, config: PLNetConfig = PLNetConfig()):
        super().__init__()
        self.config = config
        self.backbone = Backbone(config)
        self.keypoints = KeypointHead(config)

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor]:
        return self.keypoints(*self.backbone(image))


def sample_descriptors(maps: Tensor, points: Tensor) -> Tensor:
    """Descriptors at pixel positions: maps B x D x h x w (stride 4), points B x N x 2 (x, y) -> B x N x D, unit length.

    Cell convention "half pixel": cell = (pixel + 0.5) / 4 - 0.5; positions outside are clamped to the border.
    """
    h, w = maps.shape[-2:]
    size = torch.tensor([w, h], dtype=points.dtype, device=points.device)
    grid = (points + 0.5) / (4.0 * size) * 2.0 - 1.0
    d = F.grid_sample(maps, grid[:, :, None].to(maps.dtype), mode="bilinear", padding_mode="border",
                      align_corners=False)
    return F.normalize(d[..., 0].transpose(1, 2), dim=-1)
