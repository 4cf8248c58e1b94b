// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/map/map_codec.h"

#include <array>
#include <bit>
#include <cmath>
#include <cstring>

#include "airslam/common/error.h"

namespace airslam {

static_assert(std::endian::native == std::endian::little,
              "a big-endian machine must swap the bytes of map files");
static_assert(sizeof(Keypoint) == 3 * sizeof(float) && sizeof(LineSegment) == 5 * sizeof(float),
              "the BLOBs are copies of these structs");

namespace {

struct StoredImuSample {
  std::int64_t timestamp_ns;
  std::array<float, 6> values;
};
static_assert(sizeof(StoredImuSample) == 32);

}  // namespace

template <class T>
Bytes EncodeArray(std::span<const T> values) {
  const auto bytes = std::as_bytes(values);
  return {bytes.begin(), bytes.end()};
}

template <class T>
std::vector<T> DecodeArray(std::span<const std::byte> blob) {
  if (blob.size() % sizeof(T) != 0) {
    Fail("an array of {} bytes is not made of elements of {} bytes", blob.size(), sizeof(T));
  }
  std::vector<T> values(blob.size() / sizeof(T));
  if (!blob.empty()) std::memcpy(values.data(), blob.data(), blob.size());
  return values;
}

template Bytes EncodeArray(std::span<const float>);
template Bytes EncodeArray(std::span<const double>);
template Bytes EncodeArray(std::span<const std::uint16_t>);
template Bytes EncodeArray(std::span<const std::int64_t>);
template std::vector<float> DecodeArray(std::span<const std::byte>);
template std::vector<double> DecodeArray(std::span<const std::byte>);
template std::vector<std::uint16_t> DecodeArray(std::span<const std::byte>);
template std::vector<std::int64_t> DecodeArray(std::span<const std::byte>);

Bytes EncodeKeypoints(std::span<const Keypoint> keypoints) { return EncodeArray(keypoints); }

std::vector<Keypoint> DecodeKeypoints(std::span<const std::byte> blob) {
  return DecodeArray<Keypoint>(blob);
}

Bytes EncodeLines(std::span<const LineSegment> lines) { return EncodeArray(lines); }

std::vector<LineSegment> DecodeLines(std::span<const std::byte> blob) {
  return DecodeArray<LineSegment>(blob);
}

Bytes EncodeImuSamples(std::span<const ImuSample> samples) {
  std::vector<StoredImuSample> stored;
  for (const ImuSample& sample : samples) {
    const Eigen::Vector3f w = sample.angular_velocity.cast<float>();
    const Eigen::Vector3f a = sample.acceleration.cast<float>();
    stored.push_back({sample.timestamp_ns, {w.x(), w.y(), w.z(), a.x(), a.y(), a.z()}});
  }
  return EncodeArray<StoredImuSample>(stored);
}

std::vector<ImuSample> DecodeImuSamples(std::span<const std::byte> blob) {
  std::vector<ImuSample> samples;
  for (const StoredImuSample& stored : DecodeArray<StoredImuSample>(blob)) {
    const std::array<float, 6>& v = stored.values;
    samples.push_back({stored.timestamp_ns, {v[0], v[1], v[2]}, {v[3], v[4], v[5]}});
  }
  return samples;
}

QuantizedDescriptors QuantizeDescriptors(const DescriptorMatrix& descriptors) {
  if (!descriptors.allFinite()) Fail("a descriptor that is not finite cannot be stored");
  const float largest = descriptors.size() > 0 ? descriptors.cwiseAbs().maxCoeff() : 0;
  QuantizedDescriptors result;
  result.scale = largest > 0 ? largest / 127.0 : 1.0 / 127.0;
  result.values.resize(static_cast<std::size_t>(descriptors.size()));
  for (Eigen::Index i = 0; i < descriptors.size(); ++i) {
    const auto value = static_cast<std::int8_t>(std::lround(descriptors.data()[i] / result.scale));
    result.values[static_cast<std::size_t>(i)] = static_cast<std::byte>(value);
  }
  return result;
}

DescriptorMatrix RestoreDescriptors(std::span<const std::byte> values, double scale, int rows) {
  if (rows == 0 ? !values.empty() : values.size() % static_cast<std::size_t>(rows) != 0) {
    Fail("descriptors of {} bytes are not those of {} keypoints", values.size(), rows);
  }
  const auto columns = rows == 0 ? 0 : static_cast<Eigen::Index>(values.size()) / rows;
  DescriptorMatrix descriptors(rows, columns);
  for (Eigen::Index i = 0; i < descriptors.size(); ++i) {
    const auto value = static_cast<std::int8_t>(values[static_cast<std::size_t>(i)]);
    descriptors.data()[i] = static_cast<float>(scale * value);
  }
  for (Eigen::Index row = 0; row < rows; ++row) {
    const float length = descriptors.row(row).norm();
    if (length > 0) descriptors.row(row) /= length;
  }
  return descriptors;
}

}  // namespace airslam
