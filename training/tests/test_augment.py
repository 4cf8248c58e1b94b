# SPDX-License-Identifier: BSD-3-Clause
import pytest
import torch

from airslam_training import augment

CHANGES = [augment.brightness, augment.contrast, augment.gamma, augment.blur, augment.shadow, augment.spot,
           augment.shade, augment.darken, augment.noise]


def images(n=8):
    return torch.rand(n, 1, 64, 96, generator=torch.Generator().manual_seed(0)) * 255


@pytest.mark.parametrize("change", CHANGES, ids=lambda f: f.__name__)
def test_each_change_keeps_shape_and_is_finite(change):
    x = images()
    y = change(x, torch.Generator().manual_seed(1))
    assert y.shape == x.shape and torch.isfinite(y).all() and not torch.equal(x, y)


def test_chain_gives_whole_grey_levels_and_repeats_by_seed():
    a = augment.alter(images(), torch.Generator().manual_seed(2))
    b = augment.alter(images(), torch.Generator().manual_seed(2))
    assert torch.equal(a, b)
    assert a.min() >= 0 and a.max() <= 255 and torch.equal(a, a.round())


def test_darkness_reaches_the_means_that_robots_see():
    g = torch.Generator().manual_seed(3)
    means = augment.darken(images(64), g).mean((1, 2, 3))
    assert means.min() < 10 and means.max() > 25 and means.max() < 36


def test_standardize_has_unit_deviation_and_a_floor():
    x = augment.standardize(images())
    assert torch.allclose(x.std((2, 3), correction=0), torch.ones(8, 1), atol=1e-4)
    flat = augment.standardize(torch.full((1, 1, 32, 32), 17.0))
    assert torch.equal(flat, torch.zeros_like(flat))
