// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/odometry/options.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

#include "airslam/common/options.h"
#include "airslam/sensor/temporary_folder.h"

namespace airslam {
namespace {

TEST(OdometryOptions, DefaultsAreValid) { EXPECT_NO_THROW(OdometryOptions{}.Validate()); }

// Sets one field far out of its range.
void Spoil(OptionBinding& binding, bool above) {
  if (int** integer = std::get_if<int*>(&binding.value)) {
    **integer = above ? std::numeric_limits<int>::max() : std::numeric_limits<int>::min();
  } else {
    *std::get<double*>(binding.value) = above ? 1e9 : -1e9;
  }
}

TEST(OdometryOptions, ValidateNamesTheFieldThatIsOutOfItsRange) {
  OdometryOptions options;
  const std::size_t count = CollectOptions(options).size();
  EXPECT_GE(count, 21u);
  for (std::size_t i = 0; i < count; ++i) {
    for (bool above : {false, true}) {
      OdometryOptions spoilt;
      std::vector<OptionBinding> bindings = CollectOptions(spoilt);
      if (std::holds_alternative<bool*>(bindings[i].value)) continue;  // has no range
      Spoil(bindings[i], above);
      EXPECT_THAT(ErrorOf([&] { spoilt.Validate(); }),
                  ::testing::StartsWith("option " + bindings[i].name + " is "));
    }
  }
}

TEST(OdometryOptions, NotANumberIsOutOfRange) {
  OdometryOptions options;
  options.tracking.pixel_sigma = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(ErrorOf([&] { options.Validate(); }), ::testing::HasSubstr("tracking.pixel_sigma"));
}

}  // namespace
}  // namespace airslam
