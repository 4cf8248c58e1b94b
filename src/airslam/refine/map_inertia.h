// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>

#include "airslam/map/map.h"
#include "airslam/optimize/inertial_bundle.h"

namespace airslam {

// What the IMU says of a map's keyframes: states of those that have one, links where the readings
// between consecutive keyframes are in the map, and gravity as these states and readings show it.
// Components whose gravity points elsewhere (more than 3 degrees from that of the component with
// the most links) are left out. `positions`: of the keyframes in the bundle. Without any link the
// terms are empty.
InertialTerms CollectInertialTerms(const Map& map, const std::map<KeyframeId, int>& positions);

// Writes velocities and biases of solved terms back. `keyframes`: by position in the bundle.
void ApplyInertialTerms(const InertialTerms& terms, const std::vector<KeyframeId>& keyframes,
                        Map& map);

}  // namespace airslam
