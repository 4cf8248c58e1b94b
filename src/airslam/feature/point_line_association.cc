// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/feature/point_line_association.h"

#include <algorithm>
#include <optional>

namespace airslam {
namespace {

// What deciding about one line needs, ready for many points.
struct PreparedLine {
  ImageLine line;
  ImageSegment segment;
  Eigen::Vector2d along;  // unit
  double length;
  double min_x, max_x, min_y, max_y;

  explicit PreparedLine(const ImageLine& image_line, const ImageSegment& s)
      : line(image_line),
        segment(s),
        along((s.end - s.start).normalized()),
        length(s.Length()),
        min_x(std::min(s.start.x(), s.end.x())),
        max_x(std::max(s.start.x(), s.end.x())),
        min_y(std::min(s.start.y(), s.end.y())),
        max_y(std::max(s.start.y(), s.end.y())) {}

  bool Owns(const Eigen::Vector2d& p, const PointLineOptions& options) const {
    if (!(line.Distance(p) < options.max_distance)) return false;
    const bool x_between = min_x <= p.x() && p.x() <= max_x;
    const bool y_between = min_y <= p.y() && p.y() <= max_y;
    if (!x_between && !y_between) return false;
    const double place = along.dot(p - segment.start);
    return -place <= options.max_overshoot && place - length <= options.max_overshoot;
  }
};

}  // namespace

PointLineAssociation AssociatePoints(std::span<const Keypoint> points,
                                     std::span<const LineSegment> lines,
                                     const PointLineOptions& options) {
  PointLineAssociation result;
  result.points_of_line.resize(lines.size());
  result.lines_of_point.resize(points.size());
  for (std::size_t j = 0; j < lines.size(); ++j) {
    const ImageSegment segment = ToImageSegment(lines[j]);
    const std::optional<ImageLine> image_line = ImageLine::Through(segment);
    if (!image_line) continue;
    const PreparedLine line(*image_line, segment);
    for (std::size_t i = 0; i < points.size(); ++i) {
      if (!line.Owns({points[i].x, points[i].y}, options)) continue;
      result.points_of_line[j].push_back(static_cast<int>(i));
      result.lines_of_point[i].push_back(static_cast<int>(j));
    }
  }
  return result;
}

}  // namespace airslam
