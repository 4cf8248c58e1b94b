// SPDX-License-Identifier: BSD-3-Clause
//
// What a fuzzer throws bytes at: every reader of a file that comes from outside. libFuzzer
// (fuzz_main.cc) and the tests (replay_test.cc) run the same functions.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

namespace airslam {

// Reads a file with these bytes. Whatever they are, the reader must return or throw Error with a
// text; any other exception leaves this function.
using FuzzFunction = void (*)(std::span<const std::uint8_t> bytes);

struct FuzzTarget {
  std::string_view name;  // also of its folder in fuzz/corpus/
  FuzzFunction run;
};

// map, euroc_calibration, kalibr_calibration, kitti_calibration, image_list, imu_list, kitti_times,
// trajectory, options, model_pack.
std::span<const FuzzTarget> FuzzTargets();

// The target of a name, or null.
const FuzzTarget* FindFuzzTarget(std::string_view name);

}  // namespace airslam
