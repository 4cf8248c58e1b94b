// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace airslam {

// Of the program and the Python package; the same as in CMakeLists.txt.
inline constexpr char kVersion[] = "0.1.0";

}  // namespace airslam
