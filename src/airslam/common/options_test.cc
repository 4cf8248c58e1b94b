// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/common/options.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <fstream>

namespace airslam {
namespace {

using ::testing::HasSubstr;

struct TrackingOptions {
  int max_keypoints = 350;
  double parallax_ratio = 0.1;
  bool use_right_image = true;

  template <class V>
  void Visit(V& v) {
    v.Field("max_keypoints", max_keypoints, {1, 4096}, "Best scores kept.");
    v.Field("parallax_ratio", parallax_ratio, {0.001, 1, "image widths"}, "Above it: a keyframe.");
    v.Field("use_right_image", use_right_image, "Stereo.");
  }
};

struct RunOptions {
  std::string pack = "default";
  float threshold = 0.2f;
  TrackingOptions tracking;

  template <class V>
  void Visit(V& v) {
    v.Field("pack", pack, "Which networks.");
    v.Field("threshold", threshold, {0, 1}, "Of scores.");
    v.Group("tracking", tracking, "How frames match.");
  }
  void Validate() const { RequireRanges(*this); }
};

class OptionsTest : public testing::Test {
 protected:
  ~OptionsTest() override { std::filesystem::remove(file_); }

  void Load(const std::string& text, RunOptions& options) {
    std::ofstream(file_) << text;
    LoadOptions(file_, options);
  }

  // The sentence that loading `text` fails with, less the file's name; empty when it does not.
  std::string ErrorOf(const std::string& text) {
    RunOptions options;
    try {
      Load(text, options);
    } catch (const Error& error) {
      const std::string what = error.what();
      EXPECT_TRUE(what.starts_with(file_.string())) << what;
      return what.substr(file_.string().size());
    }
    return "";
  }

  const std::filesystem::path file_ =
      std::filesystem::path(testing::TempDir()) /
      (std::string(testing::UnitTest::GetInstance()->current_test_info()->name()) + "_" +
       std::to_string(getpid()) + ".yaml");
};

TEST_F(OptionsTest, SetsWhatIsNamedAndLeavesTheRest) {
  RunOptions options;
  Load("pack: night\ntracking:\n  max_keypoints: 400\n  use_right_image: false\n", options);
  EXPECT_EQ(options.pack, "night");
  EXPECT_EQ(options.threshold, 0.2f);
  EXPECT_EQ(options.tracking.max_keypoints, 400);
  EXPECT_EQ(options.tracking.parallax_ratio, 0.1);
  EXPECT_FALSE(options.tracking.use_right_image);
}

TEST_F(OptionsTest, EmptyFileAndEmptyGroupChangeNothing) {
  EXPECT_EQ(ErrorOf(""), "");
  EXPECT_EQ(ErrorOf("# only a comment\n"), "");
  EXPECT_EQ(ErrorOf("tracking:\n"), "");
}

TEST_F(OptionsTest, UnknownKeyNamesTheNearest) {
  EXPECT_EQ(ErrorOf("pack: a\ntracking:\n  max_keypoint: 400\n"),
            ":3: unknown option 'tracking.max_keypoint'; the nearest known one is "
            "'tracking.max_keypoints'");
  EXPECT_EQ(ErrorOf("treshold: 1\n"),
            ":1: unknown option 'treshold'; the nearest known one is 'threshold'");
}

TEST_F(OptionsTest, KeyInTheWrongGroupFindsItsPlace) {
  EXPECT_THAT(ErrorOf("max_keypoints: 400\n"), HasSubstr("is 'tracking.max_keypoints'"));
  EXPECT_THAT(ErrorOf("traking:\n  max_keypoints: 400\n"), HasSubstr("is 'tracking'"));
}

TEST_F(OptionsTest, WrongTypeNamesFieldAndExpectation) {
  EXPECT_EQ(ErrorOf("tracking:\n  max_keypoints: many\n"),
            ":2: option 'tracking.max_keypoints' must be a whole number, but is 'many'");
  EXPECT_THAT(ErrorOf("tracking:\n  max_keypoints: 1.5\n"), HasSubstr("must be a whole number"));
  EXPECT_THAT(ErrorOf("tracking:\n  max_keypoints: 99999999999\n"), HasSubstr("whole number"));
  EXPECT_THAT(ErrorOf("threshold: .nan\n"), HasSubstr("must be a number, but is '.nan'"));
  EXPECT_THAT(ErrorOf("threshold: [1, 2]\n"), HasSubstr("must be a number, but is '[1, 2]'"));
  EXPECT_THAT(ErrorOf("tracking:\n  use_right_image: 3\n"), HasSubstr("must be true or false"));
  EXPECT_THAT(ErrorOf("pack: {a: b}\n"), HasSubstr("must be text"));
  EXPECT_THAT(ErrorOf("tracking: 3\n"), HasSubstr("'tracking' is a group of options"));
}

TEST_F(OptionsTest, TextIsReadLikeAFile) {
  RunOptions options;
  const auto error_of = [&](const std::string& text) -> std::string {
    try {
      LoadOptionsText(text, "config", options);
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_EQ(
      error_of(R"({"pack": "night", "tracking": {"parallax_ratio": 1e-1}, "threshold": 0.3})"), "");
  EXPECT_EQ(options.pack, "night");
  EXPECT_EQ(options.threshold, 0.3F);
  EXPECT_EQ(options.tracking.parallax_ratio, 0.1);
  EXPECT_EQ(error_of("{}"), "");
  EXPECT_EQ(error_of(R"({"tracking": {"max_keypoint": 4}})"),
            "config: unknown option 'tracking.max_keypoint'; the nearest known one is "
            "'tracking.max_keypoints'");
  EXPECT_EQ(error_of(R"({"threshold": null})"),
            "config: option 'threshold' must be a number, but is '~'");
  EXPECT_EQ(error_of(R"({"tracking": {"max_keypoints": -3}})"),
            "config: option tracking.max_keypoints is -3, which is not in the range 1 to 4096");
  EXPECT_THAT(error_of("[1]"), HasSubstr("config: a configuration must hold"));
  EXPECT_THAT(error_of("{"), HasSubstr("config: not valid YAML"));
}

TEST_F(OptionsTest, RepeatedKeyIsAnError) {
  EXPECT_EQ(ErrorOf("pack: a\npack: b\n"), ":2: option 'pack' is given twice");
}

TEST_F(OptionsTest, BrokenFiles) {
  EXPECT_THAT(ErrorOf("pack: [a\n"), HasSubstr("not valid YAML"));
  EXPECT_THAT(ErrorOf("- a\n- b\n"), HasSubstr("must hold 'name: value' lines"));
  RunOptions options;
  EXPECT_THROW(LoadOptions("/nonexistent.yaml", options), Error);
}

TEST_F(OptionsTest, ValidationSpeaksForTheFile) {
  EXPECT_EQ(ErrorOf("tracking:\n  max_keypoints: -3\n"),
            ": option tracking.max_keypoints is -3, which is not in the range 1 to 4096");
  EXPECT_EQ(ErrorOf("tracking:\n  parallax_ratio: 2\n"),
            ": option tracking.parallax_ratio is 2, which is not in the range 0.001 to 1 image "
            "widths");
}

TEST_F(OptionsTest, NotANumberIsOutOfEveryRange) {
  RunOptions options;
  options.tracking.parallax_ratio = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(options.Validate(), Error);
}

TEST_F(OptionsTest, DumpReadsBackBitForBit) {
  RunOptions written;
  written.pack = "a: \"b\" # c\n";
  written.threshold = 0.1f + 0.2f;
  written.tracking.parallax_ratio = 1.0 / 3.0;
  written.tracking.use_right_image = false;
  RunOptions read;
  Load(DumpOptions(written), read);
  EXPECT_EQ(read.pack, written.pack);
  EXPECT_EQ(read.threshold, written.threshold);
  EXPECT_EQ(read.tracking.parallax_ratio, written.tracking.parallax_ratio);
  EXPECT_EQ(read.tracking.use_right_image, false);
}

TEST_F(OptionsTest, DumpIsNestedYaml) {
  EXPECT_EQ(DumpOptions(RunOptions()),
            "pack: \"default\"\nthreshold: 0.2\ntracking:\n  max_keypoints: 350\n"
            "  parallax_ratio: 0.1\n  use_right_image: true\n");
}

// A file to start from: it says what each field means, and reading it changes nothing.
TEST_F(OptionsTest, DescriptionIsACommentedConfiguration) {
  RunOptions options;
  const std::string text = DescribeOptions(CollectOptions(options));
  EXPECT_EQ(text,
            "# Which networks. (text)\npack: \"default\"\n# Of scores. (0 to 1)\nthreshold: 0.2\n"
            "\n# How frames match.\ntracking:\n"
            "  # Best scores kept. (1 to 4096)\n  max_keypoints: 350\n"
            "  # Above it: a keyframe. (0.001 to 1 image widths)\n  parallax_ratio: 0.1\n"
            "  # Stereo. (true or false)\n  use_right_image: true\n");
  RunOptions read;
  read.threshold = 0.9f;
  Load(text, read);
  EXPECT_EQ(DumpOptions(read), DumpOptions(options));
}

TEST_F(OptionsTest, TableHasASectionForEachGroup) {
  RunOptions options;
  EXPECT_EQ(TabulateOptions(CollectOptions(options)),
            "| option | default | range, unit | meaning |\n|---|---|---|---|\n"
            "| `pack` | `\"default\"` | text | Which networks. |\n"
            "| `threshold` | `0.2` | 0 to 1 | Of scores. |\n"
            "\n### tracking\n\nHow frames match.\n\n"
            "| option | default | range, unit | meaning |\n|---|---|---|---|\n"
            "| `max_keypoints` | `350` | 1 to 4096 | Best scores kept. |\n"
            "| `parallax_ratio` | `0.1` | 0.001 to 1 image widths | Above it: a keyframe. |\n"
            "| `use_right_image` | `true` | true or false | Stereo. |\n");
}

}  // namespace
}  // namespace airslam
