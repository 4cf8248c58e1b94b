// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <span>
#include <utility>
#include <vector>

#include "airslam/neural/detections.h"
#include "airslam/place/vocabulary.h"

namespace airslam {

// The junctions of one image as vertices of a graph whose edges are lines (paper, section VI-B).
struct Junctions {
  DescriptorMatrix descriptors;            // N x D, rows of unit length
  std::vector<WordId> words;               // of each, in the junction vocabulary
  std::vector<std::pair<int, int>> lines;  // ends of lines, as indices of junctions, each once
};

// The pairs of junctions that are the ends of a line: a line's end is the junction nearest to it
// within what RefineLine moves an end; lines without both ends are left out. Ordered, smaller index
// first, no doubles.
std::vector<std::pair<int, int>> JoinLines(std::span<const LineSegment> lines,
                                           std::span<const Keypoint> junctions);

// Junctions of two images matched one to one within a word: of all pairs of one word the most
// similar are taken first. Pairs of indices, ascending by the first.
std::vector<std::pair<int, int>> MatchJunctions(const Junctions& query, const Junctions& keyframe);

// S_G / n (design, section 1, relocalization stage 2): n junctions are matched; Q and B are the
// n x n adjacency matrices of the matched junctions in query and keyframe;
// S_G = sum over all n^2 entries of 1 - |q_ij - b_ij|. 0 when nothing is matched.
double StructureScore(const Junctions& query, const Junctions& keyframe);

}  // namespace airslam
