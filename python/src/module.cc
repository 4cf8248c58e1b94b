// SPDX-License-Identifier: BSD-3-Clause
#include <nanobind/nanobind.h>

#include <opencv2/core/utility.hpp>

#include "airslam/common/error.h"
#include "airslam/common/log.h"
#include "airslam/common/version.h"
#include "src/bindings.h"

namespace nb = nanobind;

NB_MODULE(_core, module) {
  module.doc() = "The C++ core of AirSLAM; use it as `airslam`.";
  // As in the program: the stages have threads of their own, and equal input must give equal bits.
  cv::setNumThreads(1);
  nb::exception<airslam::Error>(module, "Error", PyExc_RuntimeError).attr("__doc__") =
      "What went wrong with the input or the environment, as one sentence that names the file, "
      "line "
      "or field and what was expected.";
  module.attr("__version__") = airslam::kVersion;
  module.def(
      "set_quiet",
      [](bool quiet) {
        airslam::SetLogLevel(quiet ? airslam::LogLevel::kWarning : airslam::LogLevel::kInfo);
      },
      nb::arg("quiet"), "Whether only warnings are written to the standard error stream.");
  airslam::python::BindRig(module);
  airslam::python::BindTrajectory(module);
  airslam::python::BindMap(module);
  airslam::python::BindFrame(module);
  airslam::python::BindOdometry(module);
  airslam::python::BindRefinement(module);
  airslam::python::BindDetection(module);
  airslam::python::BindLocalization(module);
  airslam::python::BindEvaluation(module);
}
