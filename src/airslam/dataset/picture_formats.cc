// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/dataset/picture_formats.h"

#include <dlfcn.h>
#include <spng.h>
#include <turbojpeg.h>

#include <cstdint>
#include <memory>
#include <string_view>
#include <vector>

#include "airslam/common/error.h"

namespace airslam {
namespace {

using namespace std::string_view_literals;

// Larger pictures, and small files that claim to be, are OpenCV's.
constexpr std::uint64_t kMaxPixels = 1ULL << 27;

const unsigned char* Data(std::span<const char> bytes) {
  return reinterpret_cast<const unsigned char*>(bytes.data());
}

std::optional<cv::Mat> DecodeJpeg(std::span<const char> bytes) {
  struct Destroy {
    void operator()(void* handle) const { tjDestroy(handle); }
  };
  const std::unique_ptr<void, Destroy> decoder(tjInitDecompress());
  int width = 0, height = 0, subsampling = 0, colours = 0;
  if (!decoder || tjDecompressHeader3(decoder.get(), Data(bytes), bytes.size(), &width, &height,
                                      &subsampling, &colours) != 0) {
    return std::nullopt;
  }
  if (colours != TJCS_GRAY && colours != TJCS_YCbCr) return std::nullopt;
  if (static_cast<std::uint64_t>(width) * static_cast<std::uint64_t>(height) > kMaxPixels) {
    return std::nullopt;
  }
  cv::Mat grey(height, width, CV_8UC1);
  // A warning is no refusal: some cameras write more than the picture.
  if (tjDecompress2(decoder.get(), Data(bytes), bytes.size(), grey.data, width,
                    static_cast<int>(grey.step), height, TJPF_GRAY, 0) != 0 &&
      tjGetErrorCode(decoder.get()) != TJERR_WARNING) {
    return std::nullopt;
  }
  return grey;
}

std::optional<cv::Mat> DecodeGreyPng(std::span<const char> bytes) {
  struct Free {
    void operator()(spng_ctx* context) const { spng_ctx_free(context); }
  };
  const std::unique_ptr<spng_ctx, Free> decoder(spng_ctx_new(0));
  spng_ihdr header;
  if (!decoder || spng_set_png_buffer(decoder.get(), bytes.data(), bytes.size()) != 0 ||
      spng_get_ihdr(decoder.get(), &header) != 0) {
    return std::nullopt;
  }
  const bool deep = header.bit_depth == 16;
  if (header.color_type != SPNG_COLOR_TYPE_GRAYSCALE || (header.bit_depth != 8 && !deep) ||
      static_cast<std::uint64_t>(header.width) * header.height > kMaxPixels) {
    return std::nullopt;
  }
  cv::Mat grey(static_cast<int>(header.height), static_cast<int>(header.width),
               deep ? CV_16UC1 : CV_8UC1);
  if (spng_decode_image(decoder.get(), grey.data, grey.total() * grey.elemSize(), SPNG_FMT_PNG,
                        0) != 0) {
    return std::nullopt;
  }
  return grey;
}

// What OpenCV's library, which stays loaded, knows by this name.
void* FindInOpenCv(const char* name) {
  static void* const library = dlopen(AIRSLAM_IMGCODECS, RTLD_NOW | RTLD_LOCAL);
  if (library == nullptr) {
    Fail("OpenCV's library of picture formats, {}, cannot be loaded", AIRSLAM_IMGCODECS);
  }
  void* const found = dlsym(library, name);
  if (found == nullptr) Fail("{} does not know {}", AIRSLAM_IMGCODECS, name);
  return found;
}

template <typename Function>
Function* OpenCvFunction(const char* name) {
  return reinterpret_cast<Function*>(FindInOpenCv(name));
}

}  // namespace

std::optional<cv::Mat> DecodeCommonFormat(std::span<const char> bytes) {
  const std::string_view all(bytes.data(), bytes.size());
  if (all.starts_with("\xFF\xD8"sv)) return DecodeJpeg(bytes);
  if (all.starts_with("\x89PNG"sv)) return DecodeGreyPng(bytes);
  return std::nullopt;
}

cv::Mat DecodeWithOpenCv(const cv::Mat& bytes, int flags) {
  static auto* const decode =
      OpenCvFunction<cv::Mat(cv::InputArray, int)>("_ZN2cv8imdecodeERKNS_11_InputArrayEi");
  return decode(bytes, flags);
}

cv::Mat ReadWithOpenCv(const std::string& file, int flags) {
  static auto* const read = OpenCvFunction<cv::Mat(const std::string&, int)>(
      "_ZN2cv6imreadERKNSt7__cxx1112basic_stringIcSt11char_traitsIcESaIcEEEi");
  return read(file, flags);
}

bool WriteWithOpenCv(const std::string& file, const cv::Mat& picture) {
  static auto* const write =
      OpenCvFunction<bool(const std::string&, cv::InputArray, const std::vector<int>&)>(
          "_ZN2cv7imwriteERKNSt7__cxx1112basic_stringIcSt11char_traitsIcESaIcEEERKNS_11_"
          "InputArrayERKSt6vectorIiSaIiEE");
  return write(file, picture, {});
}

}  // namespace airslam
