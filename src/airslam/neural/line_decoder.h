// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <opencv2/core.hpp>
#include <span>
#include <vector>

#include "airslam/neural/detections.h"

namespace airslam {

// How a network's line maps become proposals. The values are the pack's: the classifier was trained
// on proposals made with them.
struct LineDecoderOptions {
  int stride = 4;               // pixels a cell of the maps, 1..64
  float reach = 16;             // pixels, > 0: the half width of a segment's attraction region
  float min_confidence = 0.3F;  // 0..1: a cell less confident proposes nothing
  float min_junction = 0.02F;   // 0..1: heat below it is no junction
  int max_junctions = 512;      // >= 2
  float snap = 24;              // pixels, > 0: the farthest junction that an end snaps to
  // 0..1: two junctions are a proposal, too, when so much of the way between them is supported by
  // the field.
  float min_support = 0.75F;
  // >= 1. sAP10 on 60 held-out photos and scenes at 480 rows with 256 junctions and 1280 proposals,
  // 384 and 2560, 512 and 4096, 768 and 8192: 49.6 / 50.3 / 50.3 / 50.3 and 40.9 / 41.8 / 42.0 /
  // 42.0. A request may ask for less.
  int max_proposals = 4096;
  // Pixels, >= 0: a line whose ends lie so near to those of a surer one is left out. On held-out
  // photos and scenes at 480 rows, sAP10 without / 8 / 12 / 17 pixels: 39.4 / 40.7 / 42.5 / 41.4
  // and 36.3 / 37.3 / 38.1 / 36.5.
  float double_radius = 12;
  // Pixels, >= 0: see DiscountOverlaps; 0 leaves it out. On held-out photos 4 / 8 pixels: 49.6
  // / 49.9.
  float overlap_radius = 8;
  // A junction is at least so many pixels away from masked pixels (>= 0), and so is all of a line
  // but for `max_masked` (0..1) of its length.
  int mask_border = 4;
  float max_masked = 0.1F;

  // Throws Error that names the wrong field.
  void Validate() const;
};

// Numbers of a proposal that the classifier reads beside the features along the line.
inline constexpr int kLineExtras = 9;

// Maps of one image, row-major planes of height x width cells; cell (row, column) is the pixel
// (stride * column + (stride - 1) / 2, stride * row + (stride - 1) / 2).
struct LineMaps {
  // 6 planes: logit of the confidence, a, b, c, e1, e2. The attraction field (paper, eq. 1)
  // is d = reach * sigmoid(a), theta = the angle of (b, c), theta_1 = pi/2 * sigmoid(e1),
  // theta_2 = -pi/2 * sigmoid(e2): numbers whose relative precision survives bf16.
  const float* field = nullptr;
  // 3 planes: logit of the heat, offsets x and y, in cells after 0.5 * tanh.
  const float* junctions = nullptr;
  int width = 0;
  int height = 0;
};

// A segment between two junctions, the left one first.
struct LineProposal {
  int start = 0, end = 0;  // indices of junctions
  // log(1 + votes) / 4, votes per cell of length / 4 (votes at most 8 a cell), distance of the
  // nearest ends of a vote / snap (2 without votes), mean confidence of the votes, heat of start
  // and of end, length / 256, log(length + 1) / 4, support.
  std::array<float, kLineExtras> extras = {};
};

// The segment x1, y1, x2, y2 in pixels that the cell at (row, column) proposes: with its centre p,
// x_i = p + d * R(theta) * (1, tan theta_i)^T.
std::array<float, 4> DecodeLine(const LineMaps& maps, const LineDecoderOptions& options, int row,
                                int column);

// Maxima of the heat in their 3x3 cells, best first (ties in row-major order), at most
// max_junctions, moved into the image of `image_size`. mask: empty, or CV_8UC1 of that size.
std::vector<Keypoint> FindJunctions(const LineMaps& maps, cv::Size image_size, const cv::Mat& mask,
                                    const LineDecoderOptions& options);

// How much of the way between two junctions agrees with the field, 0..1. At each of 16 samples the
// cells 5 pixels to the left and right are asked for the line that they see, not for its ends,
// which a cell in the middle of a long segment hardly knows: with a confidence over 0.2 one of them
// sees its foot within 4 pixels of this line and its normal within 32 degrees of this one's.
float LineSupport(const LineMaps& maps, const Keypoint& start, const Keypoint& end,
                  const LineDecoderOptions& options);

// Pairs of junctions to which confident cells' segments snap, each end to the nearest, and pairs
// that are supported. They come by the heat of both junctions * (support + summed confidence of the
// cells per cell of length, at most 2, / 2), best first (ties by junction indices), at most
// max_proposals. A proposal that crosses masked pixels is left out.
std::vector<LineProposal> ProposeLines(const LineMaps& maps, std::span<const Keypoint> junctions,
                                       const cv::Mat& mask, const LineDecoderOptions& options);

// The scores, but -1 for each proposal below `min_score` and for each that doubles a surer one (of
// equal ones the first): the summed squared distance of their ends is below the square of `radius`
// pixels.
std::vector<float> SuppressDoubles(std::span<const Keypoint> junctions,
                                   std::span<const LineProposal> proposals,
                                   std::span<const float> scores, float radius, float min_score);

// The scores, each times (1 - score * overlap) for every surer proposal along the same line (of
// equal ones the first): of several guesses at the ends of one line at most one is right. Along the
// same line: the ends of one lie within `radius` pixels of the other, endless; overlap:
// intersection over union along the surer one. A score below 0 neither lowers others nor changes.
// With the overlaps sAP10 of what this network finds on held-out photos went from 49.0 to 49.9, in
// rooms from 41.2 to 41.4.
std::vector<float> DiscountOverlaps(std::span<const Keypoint> junctions,
                                    std::span<const LineProposal> proposals,
                                    std::span<const float> scores, float radius);

// Fills lines, line_ends and junctions of `detections`, which are empty before: the proposals of at
// least `min_score`, best first (ties by junction indices), and the junctions that are ends of
// these, in their order. scores: one of each proposal.
void KeepLines(std::span<const Keypoint> junctions, std::span<const LineProposal> proposals,
               std::span<const float> scores, float min_score, Detections& detections);

}  // namespace airslam
