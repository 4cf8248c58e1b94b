// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/odometry/map_run.h"

#include <future>

#include "airslam/common/options.h"
#include "airslam/neural/make_matcher.h"

namespace airslam {
namespace {

const MapRunRequest& Checked(const MapRunRequest& request) {
  request.options.Validate();
  return request;
}

}  // namespace

MapRun::MapRun(const StereoRig& rig, const MapRunRequest& request)
    : request_(Checked(request)),
      rig_(rig),
      rectifier_(rig_),
      pack_(LoadModelPack(request_.model_pack)),
      detector_(pack_.features),
      line_detector_(pack_.features),
      matcher_(LoadNetworks()) {
  if (request_.out.empty()) return;
  out_.emplace(request_.out);
  recorder_.emplace(out_->partial() / "map.db", MakeMapCalibration(rig_, rectifier_), pack_.name,
                    pack_.features.network.sha256, times_);
}

// Side by side, because a frame that waits for one is late: the detectors' networks are theirs, the
// matcher is returned.
std::unique_ptr<FeatureMatcher> MapRun::LoadNetworks() {
  const Pinhole& camera = rectifier_.stereo().camera;
  const cv::Size size(camera.width, camera.height);
  auto matcher = std::async(std::launch::async, [this] { return MakeMatcher(pack_); });
  auto lines = std::async(std::launch::async, [this, size] {
    if (request_.options.lines.enabled) line_detector_.PrepareLines(size);
  });
  detector_.PrepareFeatures(size);
  lines.get();
  return matcher.get();
}

RunInfo MapRun::Commit(const PipelineResult& result, int sequence_frames,
                       const std::string& stopped_by) {
  const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - start_;
  RunInfo info{request_.dataset, pack_.name,      DumpOptions(request_.options),
               seconds.count(),  sequence_frames, stopped_by};
  if (out_) {
    WriteRunOutputs(out_->partial(), result, times_, info);
    out_->Commit();
  }
  return info;
}

}  // namespace airslam
