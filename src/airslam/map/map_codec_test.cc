// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/map/map_codec.h"

#include <gtest/gtest.h>

#include <cstring>
#include <limits>

#include "airslam/common/error.h"
#include "airslam/map/test_map.h"

namespace airslam {
namespace {

TEST(MapCodecTest, ArraysAreLittleEndianAndNothingElse) {
  const std::vector<std::int64_t> values = {1, -2};
  const Bytes blob = EncodeArray<std::int64_t>(values);
  ASSERT_EQ(blob.size(), 16u);
  EXPECT_EQ(blob[0], std::byte{1});
  EXPECT_EQ(blob[7], std::byte{0});
  EXPECT_EQ(blob[8], std::byte{0xfe});
  EXPECT_EQ(blob[15], std::byte{0xff});
  EXPECT_EQ(DecodeArray<std::int64_t>(blob), values);
  EXPECT_TRUE(DecodeArray<float>({}).empty());
}

TEST(MapCodecTest, PartOfAnElementIsAnError) {
  const Bytes blob(15);
  EXPECT_THROW(DecodeArray<std::int64_t>(blob), Error);
  EXPECT_THROW(DecodeArray<float>(blob), Error);
  EXPECT_THROW(DecodeKeypoints(Bytes(13)), Error);
  EXPECT_THROW(DecodeLines(Bytes(21)), Error);
}

TEST(MapCodecTest, KeypointsAndLines) {
  const std::vector<Keypoint> keypoints = {{1.5f, 2.25f, 0.5f}, {3, 4, 5}};
  const Bytes blob = EncodeKeypoints(keypoints);
  ASSERT_EQ(blob.size(), 24u);
  float y = 0;
  std::memcpy(&y, &blob[4], 4);
  EXPECT_EQ(y, 2.25f);
  const std::vector<Keypoint> read = DecodeKeypoints(blob);
  ASSERT_EQ(read.size(), 2u);
  EXPECT_EQ(read[1].x, 3);
  EXPECT_EQ(read[1].score, 5);
  const std::vector<LineSegment> lines = {{1, 2, 3, 4, 0.5f}};
  EXPECT_EQ(EncodeLines(lines).size(), 20u);
  EXPECT_EQ(DecodeLines(EncodeLines(lines)).at(0).y2, 4);
}

TEST(MapCodecTest, DescriptorsKeepTheirPrecision) {
  const DescriptorMatrix original = TestKeyframe(3, 400, 0).descriptors;
  const QuantizedDescriptors quantized = QuantizeDescriptors(original);
  EXPECT_EQ(quantized.values.size(), 400u * 64u);
  EXPECT_FLOAT_EQ(static_cast<float>(quantized.scale), original.cwiseAbs().maxCoeff() / 127);
  const DescriptorMatrix read = RestoreDescriptors(quantized.values, quantized.scale, 400);
  ASSERT_EQ(read.rows(), 400);
  ASSERT_EQ(read.cols(), 64);
  EXPECT_LT((read - original).cwiseAbs().maxCoeff(), 1.0 / 127);
  for (int row = 0; row < 400; ++row) {
    EXPECT_NEAR(read.row(row).norm(), 1, 1e-5);
    EXPECT_GT(read.row(row).dot(original.row(row)), 0.9995);
  }
}

// The least favourable: one component takes the whole range.
TEST(MapCodecTest, ErrorBoundOfAConcentratedDescriptor) {
  DescriptorMatrix original(2, 4);
  original << 1, 0, 0, 0, 0.98f, 0.0039f, -0.0039f, 0.19f;
  original.rowwise().normalize();
  const QuantizedDescriptors quantized = QuantizeDescriptors(original);
  EXPECT_EQ(quantized.values[0], std::byte{127});
  const DescriptorMatrix read = RestoreDescriptors(quantized.values, quantized.scale, 2);
  EXPECT_LT((read - original).cwiseAbs().maxCoeff(), 1.0 / 127);
}

TEST(MapCodecTest, DescriptorsWithoutRowsOrOfZeros) {
  EXPECT_TRUE(QuantizeDescriptors(DescriptorMatrix(0, 64)).values.empty());
  EXPECT_EQ(RestoreDescriptors({}, 1, 0).rows(), 0);
  const QuantizedDescriptors zeros = QuantizeDescriptors(DescriptorMatrix::Zero(2, 3));
  EXPECT_EQ(RestoreDescriptors(zeros.values, zeros.scale, 2), DescriptorMatrix::Zero(2, 3));
}

TEST(MapCodecTest, BadDescriptorsAreErrors) {
  DescriptorMatrix bad = DescriptorMatrix::Zero(1, 2);
  bad(0, 1) = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THROW(QuantizeDescriptors(bad), Error);
  EXPECT_THROW(RestoreDescriptors(Bytes(7), 1, 2), Error);
  EXPECT_THROW(RestoreDescriptors(Bytes(7), 1, 0), Error);
}

TEST(MapCodec, ReadingsAreRoundedToFloats) {
  const std::vector<ImuSample> samples = {
      {1'700'000'000'000'000'001, {0.1, -0.2, 0.3}, {9.81, 1, 2}},
      {1'700'000'000'005'000'003, {1, 2, 3}, {4, 5, 6}}};
  const Bytes blob = EncodeImuSamples(samples);
  EXPECT_EQ(blob.size(), 64u);
  const std::vector<ImuSample> read = DecodeImuSamples(blob);
  ASSERT_EQ(read.size(), 2u);
  for (int i = 0; i < 2; ++i) {
    EXPECT_EQ(read[i].timestamp_ns, samples[i].timestamp_ns);
    EXPECT_LT((read[i].angular_velocity - samples[i].angular_velocity).norm(), 1e-6);
    EXPECT_LT((read[i].acceleration - samples[i].acceleration).norm(), 1e-6);
  }
  EXPECT_THROW(DecodeImuSamples(std::span(blob).first(40)), Error);
}

}  // namespace
}  // namespace airslam
