# SPDX-License-Identifier: BSD-3-Clause
import numpy as np

from airslam_training import geometry as g


def blobs(points, size=(160, 160), sigma=3.0):
    y, x = np.mgrid[:size[1], :size[0]]
    return sum(200 * np.exp(-((x - p[0]) ** 2 + (y - p[1]) ** 2) / (2 * sigma ** 2)) for p in points).astype(np.float32)


def test_warped_image_and_warped_points_agree():
    points = np.array([[60.0, 70.0], [95.0, 60.0], [80.0, 100.0]])
    rng = np.random.default_rng(0)
    for _ in range(5):
        h = g.random_homography(rng, (160, 160), 160, g.HomographyRange(0.9, 1.2, 20, 0.1, 0.1))
        warped = g.warp_image(blobs(points), h, (160, 160))
        for p in g.warp_points(h, points):
            if not g.inside(p, (160, 160), 12):
                continue
            x, y = np.rint(p).astype(int)
            patch = warped[y - 4:y + 5, x - 4:x + 5]
            dy, dx = np.unravel_index(patch.argmax(), patch.shape)
            assert np.hypot(x - 4 + dx - p[0], y - 4 + dy - p[1]) < 1.5


def test_keypoints_are_separated_peaks_and_refined_to_subpixels():
    true = np.array([[40.3, 50.0], [100.0, 90.4]])
    scores = blobs(true) / 10 - 8
    found = g.select_keypoints(scores, 10)
    assert len(found) == 2
    refined = g.refine_keypoints(scores, found)
    for p in true:
        assert np.linalg.norm(refined - p, axis=1).min() < 0.1


def test_descriptor_sampling_uses_half_pixel_cells():
    y, x = np.mgrid[:10, :12].astype(float)
    ramp = np.stack([x, y, np.ones_like(x)])  # at cell (cx, cy) the descriptor is (cx, cy, 1) before normalising
    p = np.array([[17.0, 9.0], [30.5, 22.0]])
    d = g.sample_descriptors(ramp, p)
    expected = (p + 0.5) / 4 - 0.5
    assert np.allclose(d[:, :2] / d[:, 2:], expected)


def test_numpy_and_torch_sampling_agree():
    import torch

    from airslam_training.networks import sample_descriptors
    rng = np.random.default_rng(1)
    maps, points = rng.normal(size=(64, 16, 20)), rng.uniform(0, 60, (30, 2))
    ours = sample_descriptors(torch.from_numpy(maps)[None], torch.from_numpy(points)[None])[0].numpy()
    assert np.allclose(ours, g.sample_descriptors(maps, points), atol=1e-6)


def test_mutual_nearest_returns_the_permutation():
    d = np.random.default_rng(2).normal(size=(20, 8))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    order = np.random.default_rng(3).permutation(20)
    pairs = g.mutual_nearest(d, d[order])
    assert (order[pairs[:, 1]] == pairs[:, 0]).all() and len(pairs) == 20
