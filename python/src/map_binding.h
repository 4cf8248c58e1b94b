// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <utility>
#include <vector>

#include "airslam/map/map.h"

namespace airslam::python {

// A map that Python reads, with its keyframes in order of their ids, so that arrays can be indexed.
class MapView {
 public:
  explicit MapView(Map map);

  const Map& map() const { return map_; }
  const std::vector<const Keyframe*>& keyframes() const { return keyframes_; }

 private:
  Map map_;
  std::vector<const Keyframe*> keyframes_;
};

}  // namespace airslam::python
