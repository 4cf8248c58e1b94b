// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/dataset/sequence.h"

#include "airslam/common/error.h"
#include "airslam/dataset/recorded_sequence.h"

namespace airslam {

std::unique_ptr<Sequence> OpenSequence(const std::filesystem::path& folder) {
  namespace fs = std::filesystem;
  if (!fs::exists(folder)) Fail("the folder {} does not exist", folder.string());
  if (!fs::is_directory(folder)) Fail("{} is not a folder", folder.string());
  if (fs::is_empty(folder)) Fail("the folder {} is empty", folder.string());
  if (fs::is_directory(folder / "mav0") || fs::is_directory(folder / "cam0")) {
    return MakeSequence(ReadEuroc(folder));
  }
  if (fs::is_directory(folder / "image_0") || fs::is_directory(folder / "image_1")) {
    return MakeSequence(ReadKitti(folder));
  }
  Fail(
      "the folder {} is neither in the EuRoC layout (it would hold mav0) nor in the KITTI odometry "
      "layout (it would hold image_0, image_1, calib.txt and times.txt)",
      folder.string());
}

}  // namespace airslam
