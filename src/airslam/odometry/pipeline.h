// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <atomic>
#include <functional>
#include <vector>

#include "airslam/common/stage_times.h"
#include "airslam/dataset/sequence.h"
#include "airslam/neural/feature_detector.h"
#include "airslam/neural/feature_matcher.h"
#include "airslam/odometry/map_recorder.h"
#include "airslam/odometry/odometry.h"
#include "airslam/odometry/options.h"

namespace airslam {

// The networks (or their stand-ins) that a run uses. Each is used by one thread.
struct PipelineNetworks {
  FeatureDetector& detector;
  FeatureDetector& line_detector;  // of the same networks
  FeatureMatcher& matcher;
};

struct PipelineResult {
  std::vector<FrameRecord> records;  // one a frame that was read, in order
  Map map;
  InertialSummary inertial;
};

// Called after each frame, from the thread that called RunPipeline.
using FrameObserver = std::function<void(const FrameObservation&)>;

// The calibration that maps of this rig carry.
MapCalibration MakeMapCalibration(const StereoRig& rig, const StereoRectifier& rectifier);

// Runs stereo odometry over a sequence, with its IMU if it has one and the options allow it. Two
// stages on two threads, joined by a bounded queue: read and rectify | track; a keyframe's lines,
// local bundle adjustment and map writing have threads of their own. A frame that cannot be
// read is skipped with a warning. A sequence may still be recorded (LiveSequence). What a stage
// throws ends the run and is rethrown here. `recorder` and `observer` may be empty. Once `stop` (if
// given) is true, no further frame is read: those under way are finished, and the result is that of
// a sequence that ends there.
PipelineResult RunPipeline(const Sequence& sequence, const StereoRectifier& rectifier,
                           const OdometryOptions& options, const PipelineNetworks& networks,
                           MapRecorder* recorder, const FrameObserver& observer, StageTimes& times,
                           const std::atomic<bool>* stop = nullptr);

}  // namespace airslam
