# SPDX-License-Identifier: BSD-3-Clause
import cv2
import numpy as np
import pytest

from airslam_training.procedural import make_views
from airslam_training.ray_cast import HEIGHT, WIDTH, project


@pytest.fixture(scope="module")
def scene():
    from airslam_training.cache import photo_split
    from airslam_training.teacher import SHARED
    if not (SHARED / "data/photos").is_dir():
        pytest.skip(f"no training photos in {SHARED}")
    return make_views(5, photo_split()[0], 3)


def test_same_seed_same_views(scene, photos):
    again = make_views(5, photos, 3)[1][0]
    assert np.array_equal(again.images, scene[1][0].images) and np.array_equal(again.edges, scene[1][0].edges)


def test_depth_of_two_views_agrees_by_reprojection(scene):
    k, (a, _, b) = scene
    v, u = np.mgrid[4:HEIGHT - 4:6, 4:WIDTH - 4:6]
    z = a.depth[v, u]
    rays = np.stack([(u - k[0, 2]) / k[0, 0], (v - k[1, 2]) / k[1, 1], np.ones_like(z)], -1) * z[..., None]
    world = rays.reshape(-1, 3) @ a.pose[:3, :3].T + a.pose[:3, 3]
    pixels, depth = project(world, b.pose, k)
    ok = (depth > 0.1) & (pixels > 1).all(1) & (pixels[:, 0] < WIDTH - 2) & (pixels[:, 1] < HEIGHT - 2)
    assert ok.sum() > 200
    seen = cv2.remap(b.depth, pixels[ok, 0].astype(np.float32)[None], pixels[ok, 1].astype(np.float32)[None],
                     cv2.INTER_NEAREST)[0]
    error = (depth[ok] - seen) / seen
    assert np.mean(np.abs(error) < 0.03) > 0.7  # the rest is occluded in b
    assert np.mean(error < -0.03) < 0.02        # nothing may lie in front of what b sees


def test_edges_project_onto_their_image_end_points(scene):
    k, views = scene
    edges = views[0].edges
    assert len(edges) >= 5
    for part in (0, 1):
        pixels, depth = project(edges[:, 4 + 3 * part:7 + 3 * part].astype(float), views[0].pose, k)
        assert np.abs(pixels - edges[:, 2 * part:2 * part + 2]).max() < 0.05 and (depth > 0).all()


def test_lightings_differ_and_are_exposed(scene):
    images = scene[1][0].images.astype(float)
    assert images.shape == (3, HEIGHT, WIDTH)
    assert np.abs(images[0] - images[2]).mean() > 5 and images.max() > 120
