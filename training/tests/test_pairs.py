# SPDX-License-Identifier: BSD-3-Clause
import numpy as np

from airslam_training.pairs import FeatureSets, labels, normalize_points


def test_labels_split_into_matches_unmatched_and_undecided():
    d = np.full((4, 4), 50.0)
    d[0, 1] = 1.0   # a match
    d[1, 1] = 2.0   # second best for column 1: undecided
    d[2, 3] = 4.5   # too far for a match, too near for none
    matrix, alone0, alone1 = labels(d, 3.0, 6.0)
    assert np.argwhere(matrix).tolist() == [[0, 1]]
    assert alone0.tolist() == [False, False, False, True] and alone1.tolist() == [True, False, True, False]


def test_positions_are_normalised_by_the_longer_side():
    assert np.allclose(normalize_points(np.array([[384.0, 144.0]]), np.array([384, 288])), [[1.0, 0.0]])


def test_transfer_of_a_planar_and_of_a_spatial_pair():
    sets = object.__new__(FeatureSets)
    sets.points = np.array([[[10.0, 20.0]], [[0, 0]]])
    sets.count, sets.depth = np.array([1, 1]), np.array([[2.0], [2.0]])
    shift = np.array([[1.0, 0, 5], [0, 1, -3], [0, 0, 1]])
    sets.planar, sets.homography = True, np.stack([np.eye(3), shift])
    assert np.allclose(sets.transfer(0, 1, 1), [[15, 17]])
    sets.planar, sets.intrinsics = False, np.array([[[100.0, 0, 50], [0, 100, 40], [0, 0, 1]]] * 2)
    right = np.eye(4)
    right[0, 3] = 0.1  # the second camera stands 0.1 m to the right: disparity 100 * 0.1 / 2 = 5
    sets.pose = np.stack([np.eye(4), right])
    assert np.allclose(sets.transfer(0, 1, 1), [[5, 20]])
