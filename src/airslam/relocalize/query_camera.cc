// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/relocalize/query_camera.h"

namespace airslam {
namespace {

// Two of the camera, side by side: rectifying them turns neither and takes out the distortion.
StereoRig Twins(const RigCamera& camera) {
  StereoRig rig;
  rig.left = camera;
  rig.right = camera;
  rig.right.body_from_cam.translation += camera.body_from_cam.rotation * Eigen::Vector3d::UnitX();
  rig.already_rectified = camera.camera.model == Distortion::kNone;
  return rig;
}

}  // namespace

QueryCamera::QueryCamera(const RigCamera& camera) : rectifier_(Twins(camera)) {}

}  // namespace airslam
