# SPDX-License-Identifier: BSD-3-Clause
"""PLNet's line module: a U-Net-like neck on the frozen backbone, the attraction field, junctions and the classifier.

A segment (x1, x2) is encoded into every cell p of a map at 1/4 of the image size whose foot on the segment lies between
the ends and no farther than REACH: d is the distance, theta the direction from p to its foot, theta1 in (0, pi/2) and
theta2 in (-pi/2, 0) the angles between that direction and the ends, so that (paper, section IV)

    x_i = p + d * R(theta) * (1, tan theta_i)^T.

The network gives raw numbers that keep their relative precision in bf16: d = REACH * sigmoid(a), theta = the angle of
(b, c), |theta_i| = pi/2 * sigmoid(e_i), and a confidence logit. Cell (row, column) is the pixel (4 column + 1.5, 4 row + 1.5).
"""
from __future__ import annotations

import math
from dataclasses import asdict, dataclass

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from .networks import ConvBnRelu, PLNetConfig, Residual

STRIDE = 4
REACH = 16.0  # pixels: the half width of a segment's attraction region
FIELD = 6  # confidence, a, b, c, e1, e2
JUNCTION = 3  # logit, offset x, offset y (cells, after 0.5 * tanh)


@dataclass(frozen=True)
class LineConfig:
    """Widths of the neck at /32, /16, /8, /4, channels of the map that is pooled, and the classifier."""

    w32: int = 128
    w16: int = 96
    w8: int = 64
    w4: int = 32
    n32: int = 4
    n4: int = 2
    pooled: int = 16
    samples: int = 32
    hidden: int = 128

    def to_dict(self) -> dict:
        return asdict(self)


def _up2(x: Tensor, like: Tensor) -> Tensor:
    """Twice the size, cut to the size of the finer map (which is odd when the image is no multiple of 32)."""
    return F.interpolate(x, scale_factor=2.0, mode="bilinear", align_corners=False)[..., :like.shape[2], :like.shape[3]]


class LineNeck(nn.Module):
    """Backbone features at /4, /8, /16 -> field B x 6, junctions B x 3 and pooled features B x C, all x H/4 x W/4."""

    def __init__(self, b: PLNetConfig, c: LineConfig):
        super().__init__()
        self.down32 = ConvBnRelu(b.w16, c.w32, stride=2)
        # The later pairs look far: a cell in the middle of a segment must know both ends of it.
        self.stage32 = nn.Sequential(*[Residual(c.w32, 1 if i == 0 else 3) for i in range(c.n32 // 2)])
        self.from32 = nn.Conv2d(c.w32, c.w16, 1)
        self.lateral16 = nn.Conv2d(b.w16, c.w16, 1)
        self.stage16 = ConvBnRelu(c.w16, c.w16)
        self.from16 = nn.Conv2d(c.w16, c.w8, 1)
        self.lateral8 = nn.Conv2d(b.w8, c.w8, 1)
        self.stage8 = ConvBnRelu(c.w8, c.w8)
        self.from8 = nn.Conv2d(c.w8, c.w4, 1)
        self.lateral4 = nn.Conv2d(b.w4, c.w4, 3, padding=1)
        self.stage4 = nn.Sequential(*[Residual(c.w4) for _ in range(c.n4 // 2)])
        self.field = nn.Sequential(ConvBnRelu(c.w4, c.w4), nn.Conv2d(c.w4, FIELD, 1))
        self.rest = nn.Conv2d(c.w4, JUNCTION + c.pooled, 1)
        with torch.no_grad():  # start near the rates of the labels
            self.rest.bias[0] = -4.0

    def forward(self, f4: Tensor, f8: Tensor, f16: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        x = self.merge(f4, f8, f16)
        rest = self.rest(x)
        return self.field(x), rest[:, :JUNCTION], rest[:, JUNCTION:]

    def merge(self, f4: Tensor, f8: Tensor, f16: Tensor) -> Tensor:
        """Down to /32 and up again: B x w4 x H/4 x W/4, which every output reads."""
        x = self.stage32(self.down32(f16))
        x = self.stage16(F.relu(self.lateral16(f16) + _up2(self.from32(x), f16)))
        x = self.stage8(F.relu(self.lateral8(f8) + _up2(self.from16(x), f8)))
        return self.stage4(F.relu(self.lateral4(f4) + _up2(self.from8(x), f4)))


# ---------------------------------------------------------------- decoding

EXTRA = 9  # numbers beside the pooled features that the classifier reads


@dataclass(frozen=True)
class DecoderOptions:
    """The same numbers rule training, evaluation and (by the manifest) the C++ decoder."""

    confidence: float = 0.3  # a cell below it proposes nothing
    junction: float = 0.02  # heat below it is no junction
    junctions: int = 512
    snap: float = 24.0  # pixels: the farthest junction that an end snaps to
    support: float = 0.75  # two junctions are a proposal, too, when so much of the way between them agrees
    proposals: int = 4096
    double: float = 12.0  # pixels: a line whose ends lie so near to those of a surer one is left out
    overlap: float = 8.0  # pixels: surer lines along one so near to it lower its score


SUPPORT_SAMPLES = 16
SUPPORT_OFFSET = 5.0  # pixels beside the segment, where its direction is clear
SUPPORT_DISTANCE, SUPPORT_COSINE, SUPPORT_CONFIDENCE = 4.0, 0.85, 0.2


def decode_field(field: Tensor, cells: Tensor) -> Tensor:
    """Segments K x 4 (x1, y1, x2, y2 in pixels) proposed by cells K x 2 (row, column) of a field 6 x h x w."""
    a, b, c, e1, e2 = field[1:, cells[:, 0], cells[:, 1]]
    d = REACH * torch.sigmoid(a)
    norm = (b * b + c * c).clamp_min(1e-12).sqrt()
    cos, sin = b / norm, c / norm
    t1, t2 = torch.tan(math.pi / 2 * torch.sigmoid(e1)), -torch.tan(math.pi / 2 * torch.sigmoid(e2))
    x, y = cells[:, 1] * STRIDE + 1.5, cells[:, 0] * STRIDE + 1.5
    return torch.stack([x + d * (cos - sin * t1), y + d * (sin + cos * t1),
                        x + d * (cos - sin * t2), y + d * (sin + cos * t2)], 1)


def find_junctions(maps: Tensor, o: DecoderOptions) -> tuple[Tensor, Tensor]:
    """Junction map 3 x h x w -> positions J x 2 in pixels and scores J: 3 x 3 maxima, best first."""
    heat = torch.sigmoid(maps[0])
    peak = (F.max_pool2d(heat[None], 3, 1, 1)[0] == heat) & (heat > o.junction)
    row, column = torch.nonzero(peak, as_tuple=True)
    score = heat[row, column]
    order = torch.sort(score, descending=True, stable=True).indices[:o.junctions]
    row, column, score = row[order], column[order], score[order]
    offset = 0.5 * torch.tanh(maps[1:, row, column])
    return torch.stack([(column + offset[0]) * STRIDE + 1.5, (row + offset[1]) * STRIDE + 1.5], 1), score


def support(field: Tensor, points: Tensor, first: Tensor, second: Tensor) -> Tensor:
    """How much of the way from points[first] to points[second] agrees with the field 6 x h x w, 0..1.

    At each sample the cells to the left and right are asked for the line that they see (not for its ends, which a cell
    in the middle of a long segment hardly knows): one of them must see this one."""
    h, w = field.shape[1:]
    p, q = points[first], points[second]
    u = F.normalize(q - p, dim=1)
    normal = torch.stack([-u[:, 1], u[:, 0]], 1)
    t = (torch.arange(SUPPORT_SAMPLES, device=field.device) + 0.5) / SUPPORT_SAMPLES
    middle = p[:, None] + (q - p)[:, None] * t[:, None]
    norm = (field[2] ** 2 + field[3] ** 2).clamp_min(1e-12).sqrt()
    cos, sin, d = field[2] / norm, field[3] / norm, REACH * torch.sigmoid(field[1])
    foot_x = torch.arange(w, device=field.device) * STRIDE + 1.5 + d * cos
    foot_y = torch.arange(h, device=field.device)[:, None] * STRIDE + 1.5 + d * sin
    sure = torch.sigmoid(field[0]) > SUPPORT_CONFIDENCE
    agree = torch.zeros(middle.shape[:2], dtype=torch.bool, device=field.device)
    for side in (-SUPPORT_OFFSET, SUPPORT_OFFSET):
        cell = ((middle + side * normal[:, None] - 1.5) / STRIDE).round().long()
        x, y = cell[..., 0].clamp(0, w - 1), cell[..., 1].clamp(0, h - 1)
        distance = (foot_x[y, x] - p[:, :1]) * normal[:, :1] + (foot_y[y, x] - p[:, 1:]) * normal[:, 1:]
        along = cos[y, x] * normal[:, :1] + sin[y, x] * normal[:, 1:]
        agree |= (distance.abs() < SUPPORT_DISTANCE) & (along.abs() > SUPPORT_COSINE) & sure[y, x]
    return agree.float().mean(1)


def count_votes(field: Tensor, points: Tensor, o: DecoderOptions) -> tuple[Tensor, Tensor, Tensor]:
    """Cells' segments with their ends snapped to points, counted for each pair (i < j, at index i * n + j): votes,
    summed confidence, least summed distance of both ends (2 * snap where there is no vote)."""
    n = len(points)
    confidence = torch.sigmoid(field[0])
    cells = torch.nonzero(confidence > o.confidence)
    votes, total = field.new_zeros(n * n), field.new_zeros(n * n)
    closest = field.new_full((n * n,), 2 * o.snap)
    if len(cells):
        distance, nearest = torch.cdist(decode_field(field, cells).reshape(-1, 2), points).min(1)
        distance, nearest = distance.view(-1, 2), nearest.view(-1, 2).sort(1).values
        good = (distance.amax(1) < o.snap) & (nearest[:, 0] != nearest[:, 1])
        key = nearest[good, 0] * n + nearest[good, 1]
        sure = confidence[cells[good, 0], cells[good, 1]]
        votes.index_add_(0, key, torch.ones_like(sure))
        total.index_add_(0, key, sure)
        closest = closest.scatter_reduce(0, key, distance[good].sum(1), "amin")
    return votes, total, closest


def propose(field: Tensor, maps: Tensor, o: DecoderOptions) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Segments whose ends are junctions: field 6 x h x w and junction map 3 x h x w of one image.

    Two junctions are a proposal when a cell's segment snaps to them, or when most of the way between them is supported.
    Returns ends N x 4 (pixels), what else the classifier reads N x EXTRA, indices of both junctions N x 2, junctions
    J x 3 (x, y, score); ordered by the heat of both junctions * (support + summed confidence per cell of length, at most 2, / 2).
    """
    points, heat = find_junctions(maps, o)
    n = len(points)
    junctions = torch.cat([points, heat[:, None]], 1)
    pair = torch.triu_indices(n, n, 1, device=field.device).T
    if len(pair) == 0:
        return field.new_zeros(0, 4), field.new_zeros(0, EXTRA), pair, junctions
    key = pair[:, 0] * n + pair[:, 1]
    votes, total, closest = [v[key] for v in count_votes(field, points, o)]
    held = support(field, points, pair[:, 0], pair[:, 1])
    chosen = torch.nonzero((votes > 0) | (held >= o.support))[:, 0]
    pair, votes, total, closest, held = [v[chosen] for v in (pair, votes, total, closest, held)]
    length = (points[pair[:, 0]] - points[pair[:, 1]]).norm(dim=1)
    rank = heat[pair].prod(1) * (held + (total / (length / STRIDE + 1)).clamp_max(2) / 2)
    order = torch.sort(rank, descending=True, stable=True).indices[:o.proposals]
    pair, votes, total, closest, held, length = [v[order] for v in (pair, votes, total, closest, held, length)]
    # From left to right, so that the classifier sees a segment in one direction only.
    swap = points[pair[:, 0], 0] > points[pair[:, 1], 0]
    pair = torch.where(swap[:, None], pair.flip(1), pair)
    extra = torch.stack([torch.log1p(votes) / 4, (votes / (length / STRIDE + 1)).clamp_max(8) / 4, closest / o.snap,
                         total / votes.clamp_min(1), heat[pair[:, 0]], heat[pair[:, 1]],
                         length / 256, torch.log(length + 1) / 4, held], 1)
    return points[pair].reshape(-1, 4), extra, pair, junctions


# Pixels from an end into the segment where the classifier looks, too: whether the line goes on beyond tells a true end.
END_OFFSETS = (-32.0, -20.0, -12.0, -6.0, 0.0, 6.0, 12.0, 20.0, 32.0)


def sample_at(maps: Tensor, points: Tensor, stride: int = STRIDE) -> Tensor:
    """Bilinear samples: maps C x h x w, points N x S x 2 in pixels -> N x S * C."""
    size = torch.tensor([maps.shape[2], maps.shape[1]], device=points.device)
    grid = (points + 0.5) / (stride * size) * 2 - 1
    sampled = F.grid_sample(maps[None], grid[None], mode="bilinear", padding_mode="border", align_corners=False)
    return sampled[0].permute(1, 2, 0).flatten(1)


def sample_along(maps: Tensor, ends: Tensor, samples: int = LineConfig.samples) -> Tensor:
    """Samples at equal steps from end to end: maps C x h x w, ends N x 4 in pixels -> N x samples * C."""
    t = torch.linspace(0, 1, samples, device=ends.device)[None, :, None]
    return sample_at(maps, ends[:, None, :2] * (1 - t) + ends[:, None, 2:] * t)


def sample_ends(maps: Tensor, ends: Tensor) -> Tensor:
    """Samples at END_OFFSETS from the first end, then from the second: N x 2 * len(END_OFFSETS) * C."""
    into = F.normalize(ends[:, 2:] - ends[:, :2], dim=1)[:, None]
    off = torch.tensor(END_OFFSETS, device=ends.device)[None, :, None]
    return sample_at(maps, torch.cat([ends[:, None, :2] + into * off, ends[:, None, 2:] - into * off], 1))


def classifier_features(maps: Tensor, ends: Tensor, extra: Tensor, samples: int = LineConfig.samples) -> Tensor:
    """What the classifier reads of proposals: maps C x h x w, ends N x 4, extra N x EXTRA -> N x D."""
    return torch.cat([sample_along(maps, ends, samples), extra, sample_ends(maps, ends)], 1)


def classifier_size(c: LineConfig) -> int:
    """D of classifier_features."""
    return (c.samples + 2 * len(END_OFFSETS)) * c.pooled + EXTRA


class LineClassifier(nn.Module):
    """Is a proposal a line? classifier_features N x D -> logits N."""

    def __init__(self, c: LineConfig):
        super().__init__()
        self.layers = nn.Sequential(nn.Linear(classifier_size(c), c.hidden), nn.ReLU(inplace=True),
                                    nn.Linear(c.hidden, c.hidden), nn.ReLU(inplace=True), nn.Linear(c.hidden, 1))

    def forward(self, features: Tensor) -> Tensor:
        """N x D -> N."""
        return self.layers(features)[:, 0]


def without_doubles(lines: Tensor, radius: float) -> Tensor:
    """Lines N x 5, best first, without those whose ends lie near those of a better one (root of the summed squares)."""
    p = lines[:, :4]
    near = torch.minimum(torch.cdist(p, p), torch.cdist(p, p[:, [2, 3, 0, 1]])) < radius
    keep: list[int] = []
    for i in range(len(lines)):
        if not near[i, keep].any():
            keep.append(i)
    return lines[keep]


def discount_overlaps(lines: Tensor, radius: float) -> Tensor:
    """Lines N x 5, best first -> N x 5, the score of each times (1 - score * intersection over union) for every better one
    along the same line, best first: of several guesses at the ends of one line at most one is right."""
    p, q, score = lines[:, :2], lines[:, 2:4], lines[:, 4]
    length = (q - p).norm(dim=1).clamp_min(1e-6)
    along = (q - p) / length[:, None]

    def seen(points):  # of each line (rows): where the points (columns) lie along it and how far across
        d = points[None] - p[:, None]
        return (d * along[:, None]).sum(2), (d[..., 1] * along[:, None, 0] - d[..., 0] * along[:, None, 1]).abs()

    (a, across_a), (b, across_b) = seen(p), seen(q)
    common = (torch.minimum(torch.maximum(a, b), length[:, None]) - torch.minimum(a, b).clamp_min(0)).clamp_min(0)
    distance = torch.maximum(across_a, across_b)
    overlap = common / (length[:, None] + length[None] - common) * (torch.minimum(distance, distance.T) < radius)
    factor = (1 - score[:, None] * torch.triu(overlap, 1)).prod(0)
    discounted = torch.cat([lines[:, :4], (score * factor)[:, None]], 1)
    return discounted[torch.sort(discounted[:, 4], descending=True, stable=True).indices]


class LineModule(nn.Module):
    """All that is trained in the second round."""

    def __init__(self, b: PLNetConfig = PLNetConfig(), c: LineConfig = LineConfig()):
        super().__init__()
        self.config = c
        self.neck = LineNeck(b, c)
        self.classifier = LineClassifier(c)

    def classify(self, pooled: Tensor, ends: Tensor, extra: Tensor) -> Tensor:
        """Logits N of the proposals of one image, pooled C x h x w."""
        return self.classifier(classifier_features(pooled, ends, extra, self.config.samples))

    @torch.no_grad()
    def detect(self, features, o: DecoderOptions = DecoderOptions()) -> tuple[Tensor, Tensor]:
        """Backbone features of one image -> all proposals N x 5 (ends, probability), best first, and junctions J x 3."""
        field, maps, pooled = [m[0].float() for m in self.neck(*features)]
        ends, extra, _, junctions = propose(field, maps, o)
        score = torch.sigmoid(self.classify(pooled, ends, extra)) if len(ends) else ends.new_zeros(0)
        order = torch.sort(score, descending=True, stable=True).indices
        lines = without_doubles(torch.cat([ends, score[:, None]], 1)[order], o.double)
        return discount_overlaps(lines, o.overlap), junctions
