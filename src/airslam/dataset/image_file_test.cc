// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/dataset/image_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>
#include <string>

#include "airslam/sensor/temporary_folder.h"

namespace airslam {
namespace {

using testing::HasSubstr;

std::string Write(const TemporaryFolder& folder, const std::string& name, const cv::Mat& image) {
  const std::string file = (folder.path() / name).string();
  EXPECT_TRUE(cv::imwrite(file, image));
  return file;
}

// `count` bytes less than the whole file.
void CutOff(const std::string& file, std::size_t count) {
  std::filesystem::resize_file(file, std::filesystem::file_size(file) - count);
}

TEST(DecodeGrey, KeepsEightBitsAndSixteenBits) {
  const TemporaryFolder folder;
  cv::Mat eight(6, 8, CV_8UC1), sixteen(6, 8, CV_16UC1);
  cv::randu(eight, 0, 256);
  cv::randu(sixteen, 0, 65536);
  const cv::Mat eight_back = DecodeGrey(Write(folder, "8.png", eight));
  const cv::Mat sixteen_back = DecodeGrey(Write(folder, "16.png", sixteen));
  ASSERT_EQ(eight_back.type(), CV_8UC1);
  ASSERT_EQ(sixteen_back.type(), CV_16UC1);
  EXPECT_EQ(cv::norm(eight, eight_back, cv::NORM_INF), 0);
  EXPECT_EQ(cv::norm(sixteen, sixteen_back, cv::NORM_INF), 0);
}

TEST(DecodeGrey, GivesThePixelsThatOpenCvGives) {
  const TemporaryFolder folder;
  cv::Mat grey(45, 67, CV_8UC1), colour(45, 67, CV_8UC3), deep(45, 67, CV_16UC1);
  cv::randu(grey, 0, 256);
  cv::randu(colour, 0, 256);
  cv::randu(deep, 0, 65536);
  const std::vector<std::string> files = {
      Write(folder, "grey.jpg", grey),     Write(folder, "colour.jpg", colour),
      Write(folder, "grey.png", grey),     Write(folder, "deep.png", deep),
      Write(folder, "colour.png", colour), Write(folder, "grey.bmp", grey),
      Write(folder, "grey.pgm", grey),     Write(folder, "deep.tiff", deep)};
  for (const std::string& file : files) {
    const cv::Mat expected = cv::imread(file, cv::IMREAD_GRAYSCALE | cv::IMREAD_ANYDEPTH);
    const cv::Mat found = DecodeGrey(file);
    ASSERT_EQ(found.type(), expected.type()) << file;
    EXPECT_EQ(cv::norm(found, expected, cv::NORM_INF), 0) << file;
  }
}

TEST(DecodeGrey, WeighsColours) {
  const TemporaryFolder folder;
  const cv::Mat colour(6, 8, CV_8UC3, cv::Scalar(10, 100, 200));  // blue, green, red
  const cv::Mat grey = DecodeGrey(Write(folder, "c.png", colour));
  ASSERT_EQ(grey.type(), CV_8UC1);
  EXPECT_NEAR(grey.at<uchar>(3, 3), 0.114 * 10 + 0.587 * 100 + 0.299 * 200, 1.5);
  const cv::Mat deep(6, 8, CV_16UC3, cv::Scalar(1000, 10000, 20000));
  const cv::Mat deep_grey = DecodeGrey(Write(folder, "d.png", deep));
  ASSERT_EQ(deep_grey.type(), CV_16UC1);
  EXPECT_NEAR(deep_grey.at<std::uint16_t>(3, 3), 0.114 * 1000 + 0.587 * 10000 + 0.299 * 20000, 150);
}

TEST(DecodeGrey, SaysWhatIsWrongWithAFile) {
  const TemporaryFolder folder;
  EXPECT_THAT(ErrorOf([&] { DecodeGrey(folder.path() / "none.png"); }),
              HasSubstr("none.png is missing"));
  EXPECT_THAT(ErrorOf([&] { DecodeGrey(folder.Write("a.png", "")); }), HasSubstr("is empty"));
  EXPECT_THAT(ErrorOf([&] { DecodeGrey(folder.Write("b.png", "no image")); }),
              HasSubstr("b.png cannot be decoded"));
  cv::Mat noise(60, 80, CV_8UC1);
  cv::randu(noise, 0, 256);
  for (const char* name : {"cut.png", "cut.jpg"}) {
    const std::string file = Write(folder, name, noise);
    EXPECT_EQ(ErrorOf([&] { DecodeGrey(file); }), "");
    CutOff(file, 1500);
    EXPECT_THAT(ErrorOf([&] { DecodeGrey(file); }), HasSubstr("is cut off")) << name;
  }
  cv::Mat floats(6, 8, CV_32FC1, cv::Scalar(0.5));
  const std::string file = Write(folder, "f.tiff", floats);
  EXPECT_THAT(ErrorOf([&] { DecodeGrey(file); }), HasSubstr("neither 8 nor 16 bits"));
}

TEST(ToEightBit, ShiftsByEightOrFour) {
  cv::Mat sixteen(1, 4, CV_16UC1);
  const std::uint16_t values[] = {0, 4095, 0x1234, 65535};
  std::copy_n(values, 4, sixteen.ptr<std::uint16_t>());
  const cv::Mat full = ToEightBit(sixteen, false);
  EXPECT_EQ(full.at<uchar>(0, 1), 15);
  EXPECT_EQ(full.at<uchar>(0, 2), 0x12);
  EXPECT_EQ(full.at<uchar>(0, 3), 255);
  const cv::Mat twelve = ToEightBit(sixteen, true);
  EXPECT_EQ(twelve.at<uchar>(0, 1), 255);
  EXPECT_EQ(twelve.at<uchar>(0, 3), 255);  // out of range: saturates
}

}  // namespace
}  // namespace airslam
