// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "airslam/neural/line_decoder.h"

namespace airslam {

// The line that each cell of a network's field sees: asked for how much of the way between two
// junctions it supports (LineSupport tells how).
class SeenLines {
 public:
  SeenLines(const LineMaps& maps, const LineDecoderOptions& options);

  // The share of 16 samples between two junctions that agree, 0..1.
  float Support(const Keypoint& p, const Keypoint& q) const;

  // For one junction and each of some others: 0 only where Support is less than `least` (0..1).
  // Tells most pairs that are no lines at less cost than Support: one bit says whether a cell can
  // agree with a line of about this direction. possible: as many as others.
  void FindPossible(const Keypoint& p, std::span<const Keypoint> others, float least,
                    std::span<std::uint8_t> possible) const;

  // How the cells lie; for the functions that work on eight samples at once.
  struct Grid {
    float offset = 0, per_stride = 0;  // the first centre in pixels, and cells a pixel
    float last_column = 0, last_row = 0, width = 0;
  };

  // A cell's foot on its line and the normal there, which points from the cell to the line; a
  // normal of 0 marks a cell that sees no line.
  struct Seen {
    float x = 0, y = 0, cosine = 0, sine = 0;
  };

 private:
  void Mark(int row, int column, int stride);

  Grid grid_;
  std::vector<Seen> cells_;
  // Bit k of a cell: it may agree with a line against whose normal it lies, where that normal has a
  // direction of bin k.
  std::vector<std::uint32_t> marks_;
};

}  // namespace airslam
