// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/common/progress.h"

#include <gtest/gtest.h>

#include <memory>

namespace airslam {
namespace {

TEST(ProgressTest, Format) {
  EXPECT_EQ(FormatProgress("map", 120, 1000, 4.0, "tracking"), "map 120/1000 12% 30.0/s tracking");
  EXPECT_EQ(FormatProgress("map", 3, 0, 2.0, ""), "map 3 1.5/s");
  EXPECT_EQ(FormatProgress("map", 0, 10, 0.0, ""), "map 0/10 0%");
}

// Reports once a second for twelve seconds by a clock of its own, and returns what was written.
std::string Written(bool terminal) {
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::tmpfile(), &std::fclose);
  double now_s = 100;
  Progress progress("map", 24, {file.get(), terminal, [&] { return now_s; }});
  for (int done = 0; done < 24; done += 2) {
    progress.Update(done, "ok");
    progress.Update(done, "too soon");
    now_s += 1;
  }
  progress.Finish(24, "done");
  std::rewind(file.get());
  std::string text(4096, '\0');
  text.resize(std::fread(text.data(), 1, text.size(), file.get()));
  return text;
}

TEST(ProgressTest, LogGetsALineEveryFiveSeconds) {
  EXPECT_EQ(Written(/*terminal=*/false),
            "map 10/24 41% 2.0/s ok\nmap 20/24 83% 2.0/s ok\nmap 24/24 100% 2.0/s done\n");
}

TEST(ProgressTest, TerminalLineIsRewrittenInPlace) {
  const std::string text = Written(/*terminal=*/true);
  EXPECT_TRUE(text.starts_with("\r\x1b[Kmap 2/24 8% 2.0/s ok\r\x1b[Kmap 4/24 16%")) << text;
  EXPECT_EQ(text.find('\n'), text.size() - 1);
  EXPECT_EQ(text.find("too soon"), std::string::npos);
}

}  // namespace
}  // namespace airslam
