// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/dataset/text_lines.h"

#include <gtest/gtest.h>

#include <string>

#include "airslam/sensor/temporary_folder.h"

namespace airslam {
namespace {

TEST(ForEachLine, SkipsCommentsHeadersAndEmptyLinesButCountsThem) {
  const TemporaryFolder folder;
  const auto file = folder.Write("a.csv", "time,name\n# x\n\n1, a.png\r\n 2\tb.png\n3");
  std::string seen;
  ForEachLine(file, [&](int number, const Words& words) {
    seen += std::to_string(number) + ":";
    for (const std::string_view word : words) seen += std::string(word) + "|";
  });
  EXPECT_EQ(seen, "4:1|a.png|5:2|b.png|6:3|");
}

TEST(ParseSecondsToNs, IsExactForDecimals) {
  EXPECT_EQ(ParseSecondsToNs("1403715273.262142976"), 1403715273262142976);
  EXPECT_EQ(ParseSecondsToNs("1700000000"), 1700000000000000000);
  EXPECT_EQ(ParseSecondsToNs("0.1"), 100000000);
  EXPECT_EQ(ParseSecondsToNs("-0.000000001"), -1);
  EXPECT_EQ(ParseSecondsToNs("1.0000000015"), 1000000002);  // rounded
  EXPECT_EQ(ParseSecondsToNs("1.037359e-01"), 103735900);
}

TEST(ParseSecondsToNs, RefusesWhatIsNoTime) {
  for (const char* text : {"", "-", "abc", "1.2.3", "1s", "nan", "inf", "1403715273262142976"}) {
    EXPECT_FALSE(ParseSecondsToNs(text)) << text;
  }
}

TEST(ParseNumbers, TakeTheWholeWord) {
  EXPECT_EQ(ParseInteger("12"), 12);
  EXPECT_FALSE(ParseInteger("12x"));
  EXPECT_FALSE(ParseInteger("12.0"));
  EXPECT_FALSE(ParseInteger("99999999999999999999"));
  EXPECT_EQ(ParseDouble("+1e-3"), 1e-3);
  EXPECT_FALSE(ParseDouble("1,5"));
  EXPECT_FALSE(ParseDouble("inf"));
}

TEST(TextLines, TimesWhoseDifferencesDoNotFitAreNone) {
  EXPECT_EQ(ParseTimeNs("1403715273262142976"), 1403715273262142976);
  EXPECT_EQ(ParseTimeNs("-5"), -5);
  EXPECT_EQ(ParseTimeNs("9223372036854775807"), std::nullopt);
  EXPECT_EQ(ParseTimeNs("-9223372036854775808"), std::nullopt);
  EXPECT_EQ(ParseSecondsToNs("4399999999.5"), 4'399'999'999'500'000'000);
  EXPECT_EQ(ParseSecondsToNs("4400000000"), std::nullopt);
}

}  // namespace
}  // namespace airslam
