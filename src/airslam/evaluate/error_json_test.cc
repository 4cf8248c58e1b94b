// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/evaluate/error_json.h"

#include <gtest/gtest.h>

namespace airslam {
namespace {

TEST(ErrorJson, NamesUnitsAndKeepsNumbers) {
  TrajectoryErrors errors;
  errors.position.rmse = 0.25;
  errors.relative_rotation.mean = 0.5;
  errors.relative_rotation.count = 7;
  errors.compared_poses = 8;
  errors.coverage_basis = "frames";
  const nlohmann::json json = ToJson(errors);
  EXPECT_EQ(json["ate_position_m"]["rmse"], 0.25);
  EXPECT_NEAR(json["rpe_rotation_deg"]["mean"].get<double>(), 28.6478897565, 1e-9);
  EXPECT_EQ(json["rpe_rotation_deg"]["count"], 7);
  EXPECT_EQ(json["compared_poses"], 8);
  EXPECT_EQ(json["alignment"], "SE(3)");
  EXPECT_EQ(json["coverage_basis"], "frames");
}

}  // namespace
}  // namespace airslam
