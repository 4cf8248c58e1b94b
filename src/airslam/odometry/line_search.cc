// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/odometry/line_search.h"

#include <utility>

#include "airslam/feature/line_refinement.h"
#include "airslam/feature/stereo_lines.h"

namespace airslam {
namespace {

// Moves lines of the left image onto the straight edges that they follow, and leaves out those that
// follow none: no other keyframe could tell where they are to a fraction of a pixel.
void KeepEdges(const cv::Mat& image, Detections& found) {
  std::vector<LineSegment> lines;
  std::vector<LineEnds> ends;
  for (std::size_t i = 0; i < found.lines.size(); ++i) {
    const auto edge = RefineLine(found.lines[i], image);
    if (!edge) continue;
    lines.push_back(*edge);
    ends.push_back(found.line_ends[i]);
  }
  found.lines = std::move(lines);
  found.line_ends = std::move(ends);
}

// The same of the lines found in the right image, which keep their places in the list. They follow
// what is about the line, an edge among it, to a pixel.
void MoveOntoEdges(const cv::Mat& image, std::vector<LineSegment>& right) {
  const LineRefinementOptions near{.reach = 1.5, .max_tilt = 1.5};
  for (LineSegment& line : right) {
    if (line.score >= 0) line = RefineLine(line, image, near).value_or(kNoLine);
  }
}

}  // namespace

void LineSearch::Begin(LineSearchImages images) {
  under_way_ =
      std::async(std::launch::async, [this, images = std::move(images)] { return Find(images); });
}

std::optional<KeyframeLines> LineSearch::Take() {
  if (!under_way_.valid()) return std::nullopt;
  ScopedStage stage(times_, "wait for lines");
  return under_way_.get();
}

KeyframeLines LineSearch::Find(const LineSearchImages& images) {
  KeyframeLines found;
  found.keyframe = images.keyframe;
  {
    ScopedStage stage(times_, "detect lines");
    found.left = detector_.FindLines(images.left.full(), rectifier_.left_mask(), images.seen,
                                     {0, true, static_cast<float>(options_.min_score)});
  }
  {
    ScopedStage stage(times_, "refine lines");
    KeepEdges(images.left.full(), found.left);
  }
  ScopedStage stage(times_, "find lines in right image");
  found.right = FindRightLines(found.left.lines, images.left, images.right, rectifier_.stereo());
  MoveOntoEdges(images.right.full(), found.right);
  return found;
}

}  // namespace airslam
