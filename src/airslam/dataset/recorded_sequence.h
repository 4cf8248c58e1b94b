// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "airslam/dataset/sequence.h"

namespace airslam {

struct RecordedFrame {
  std::int64_t timestamp_ns = 0;
  std::filesystem::path left, right;  // image files
};

// What the reader of one layout finds in a folder.
struct Recording {
  std::string name;  // of the layout
  StereoRig rig;
  std::vector<RecordedFrame> frames;  // strictly increasing in time
  std::vector<ImuSample> imu;
  std::vector<std::string> warnings;
};

// Readers of the layouts, see OpenSequence.
Recording ReadEuroc(const std::filesystem::path& folder);
Recording ReadKitti(const std::filesystem::path& folder);

// The sequence of what was found. Throws Error when it holds no frame, or when its first readable
// images are not of the calibrated size.
std::unique_ptr<Sequence> MakeSequence(Recording recording);

}  // namespace airslam
