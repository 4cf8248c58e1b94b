// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/odometry/motion_model.h"

#include <gtest/gtest.h>

#include "airslam/geometry/so3.h"

namespace airslam {
namespace {

constexpr std::int64_t kPeriod = 50'000'000;  // ns
const Rigid3 kStep(ExpSO3({0.01, -0.03, 0.02}), {0.02, 0.01, 0.06});
const Rigid3 kReference(ExpSO3({0.3, 0.2, -0.5}), {1, 2, 3});

void ExpectNear(const Rigid3& a, const Rigid3& b) {
  EXPECT_LT((a.ToMatrix() - b.ToMatrix()).cwiseAbs().maxCoeff(), 1e-9);
}

// Frames 0 and 1 of a motion by kStep a frame, on keyframe 7 at kReference.
MotionModel AfterTwoFrames() {
  MotionModel model;
  model.Observe(0, 7, {}, kReference);
  model.Observe(kPeriod, 7, kStep, kReference);
  return model;
}

TEST(MotionModel, ContinuesAConstantVelocity) {
  const MotionModel model = AfterTwoFrames();
  EXPECT_EQ(model.reference(), 7);
  ExpectNear(model.Predict(2 * kPeriod, kReference).world_from_cam, kReference * kStep * kStep);
}

TEST(MotionModel, IsLessSureOfALaterTime) {
  const MotionModel model = AfterTwoFrames();
  const PosePrior near = model.Predict(2 * kPeriod, kReference);
  const PosePrior far = model.Predict(4 * kPeriod, kReference);
  EXPECT_GT(near.SigmaRotation(), 0);
  EXPECT_GT(far.SigmaRotation(), 2 * near.SigmaRotation());
  EXPECT_GT(far.SigmaPosition(), 2 * near.SigmaPosition());
}

TEST(MotionModel, ExpectsTheLastPoseWhereTheVelocityIsNotKnown) {
  MotionModel one_frame;
  one_frame.Observe(0, 7, kStep, kReference);
  MotionModel reset = AfterTwoFrames();
  reset.Reset();
  MotionModel after_gap;
  after_gap.Observe(0, 7, {}, kReference);
  after_gap.Observe(20 * kPeriod, 7, kStep, kReference);
  for (const MotionModel* model : {&one_frame, &reset, &after_gap}) {
    const PosePrior prior = model->Predict(21 * kPeriod, kReference);
    ExpectNear(prior.world_from_cam, kReference * kStep);
    EXPECT_GT(prior.SigmaPosition(), 100);
    EXPECT_GT(prior.SigmaRotation(), 100);
  }
}

TEST(MotionModel, DoesNotExtrapolateFar) {
  const PosePrior prior = AfterTwoFrames().Predict(20 * kPeriod, kReference);
  ExpectNear(prior.world_from_cam, kReference * kStep);
  EXPECT_GT(prior.SigmaPosition(), 100);
}

TEST(MotionModel, FollowsItsKeyframeWhenThatIsOptimized) {
  MotionModel model = AfterTwoFrames();
  const Rigid3 moved(ExpSO3({0.31, 0.21, -0.52}), {1.1, 2.0, 2.8});
  model.Rebase(moved);
  ExpectNear(model.Predict(2 * kPeriod, moved).world_from_cam, moved * kStep * kStep);
  // The keyframe's jump is not the camera's velocity.
  model.Observe(2 * kPeriod, 7, kStep * kStep, moved);
  ExpectNear(model.Predict(3 * kPeriod, moved).world_from_cam, moved * kStep * kStep * kStep);
}

TEST(MotionModel, HangsOnANewKeyframe) {
  MotionModel model = AfterTwoFrames();
  model.MoveTo(8);
  EXPECT_EQ(model.reference(), 8);
  const Rigid3 world_from_new = kReference * kStep;
  ExpectNear(model.Predict(2 * kPeriod, world_from_new).world_from_cam, world_from_new * kStep);
}

}  // namespace
}  // namespace airslam
