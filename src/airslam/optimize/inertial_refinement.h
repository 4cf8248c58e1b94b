// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "airslam/geometry/rigid3.h"
#include "airslam/optimize/inertial_initialization.h"
#include "airslam/sensor/imu_preintegration.h"

namespace airslam {

// The last step of InitializeInertial: poses (within the noise that the options give them),
// velocities, biases and gravity of known length together, by all inertial factors, with a prior on
// the accelerometer's bias. `between` holds the readings between each two frames, integrated with
// the bias of `estimate`. Moves bias, gravity_in_world and velocities_in_world (one a frame) of
// `estimate` from where they are, and sets its residual and standard deviations: infinite ones
// where nothing is known of some direction.
void RefineInertial(const InertialInitializationOptions& options,
                    const std::vector<InertialFrame>& frames,
                    const std::vector<ImuPreintegration>& between, const Rigid3& body_from_cam,
                    InertialInitialization& estimate);

}  // namespace airslam
