// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/refine/options.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "airslam/common/options.h"

namespace airslam {
namespace {

TEST(RefineOptions, DefaultsAreValid) {
  EXPECT_NO_THROW(RefineOptions().Validate());
  EXPECT_THAT(RefineOptions().ProcessorNames(),
              ::testing::ElementsAre("loop_closure", "merge", "pose_graph", "global_bundle",
                                     "junction_vocabulary"));
}

TEST(RefineOptions, ProcessorsAreAList) {
  RefineOptions options;
  options.processors = " merge ,,global_bundle";
  EXPECT_THAT(options.ProcessorNames(), ::testing::ElementsAre("merge", "global_bundle"));
  options.processors = "";
  EXPECT_THAT(options.ProcessorNames(), ::testing::IsEmpty());
}

// Every number, set to something that is never right, is refused by its name.
TEST(RefineOptions, WrongValuesAreNamed) {
  RefineOptions options;
  for (const OptionBinding& binding : CollectOptions(options)) {
    RefineOptions wrong;
    for (const OptionBinding& field : CollectOptions(wrong)) {
      if (field.name != binding.name) continue;
      if (auto* number = std::get_if<double*>(&field.value)) **number = -1;
      if (auto* number = std::get_if<int*>(&field.value)) **number = -1;
      if (std::holds_alternative<bool*>(field.value)) continue;
      if (auto* text = std::get_if<std::string*>(&field.value)) **text = "nonsense";
      try {
        wrong.Validate();
        ADD_FAILURE() << binding.name;
      } catch (const Error& error) {
        const bool is_text = std::holds_alternative<std::string*>(field.value);
        EXPECT_THAT(error.what(), ::testing::HasSubstr(is_text ? "nonsense" : binding.name));
      }
    }
  }
}

}  // namespace
}  // namespace airslam
