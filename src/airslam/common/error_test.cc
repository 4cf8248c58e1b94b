// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/common/error.h"

#include <gtest/gtest.h>

namespace airslam {
namespace {

TEST(Error, IsOneLineWhateverAFileHolds) {
  try {
    Fail("line {} holds '{}'", 3, "a\nb\tc\r");
  } catch (const Error& error) {
    EXPECT_STREQ(error.what(), "line 3 holds 'a b c '");
    return;
  }
  FAIL() << "nothing was thrown";
}

}  // namespace
}  // namespace airslam
