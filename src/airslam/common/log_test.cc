// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/common/log.h"

#include <gtest/gtest.h>

namespace airslam {
namespace {

TEST(LogTest, PrefixesEachLine) {
  testing::internal::CaptureStderr();
  LogInfo("{} frames", 12);
  LogWarn("frame {} is unreadable", 7);
  EXPECT_EQ(testing::internal::GetCapturedStderr(),
            "airslam: 12 frames\nairslam: warning: frame 7 is unreadable\n");
}

TEST(LogTest, BracesInTextAreNotAFormat) {
  testing::internal::CaptureStderr();
  LogInfo("{}", "a {} b");
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "airslam: a {} b\n");
}

TEST(LogTest, LevelHidesWhatIsBelow) {
  SetLogLevel(LogLevel::kWarning);
  testing::internal::CaptureStderr();
  LogInfo("hidden");
  LogWarn("shown");
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "airslam: warning: shown\n");
  SetLogLevel(LogLevel::kInfo);
}

}  // namespace
}  // namespace airslam
