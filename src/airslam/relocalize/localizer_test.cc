// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/relocalize/localizer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>
#include <random>
#include <thread>

#include "airslam/map/map_file.h"
#include "airslam/place/test_place.h"
#include "airslam/sensor/temporary_folder.h"
#include "airslam/testing/image_renderer.h"

namespace airslam {
namespace {

using testing::HasSubstr;

class LocalizerTest : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    place_ = new SyntheticPlace;
    map_ = new LocalizationMap{place_->map(), place_->MakeIndex()};
  }
  static void TearDownTestSuite() {
    delete map_;
    delete place_;
  }

  // The camera of the map.
  static QueryCamera SameCamera() { return QueryCamera(place_->sequence().rig().left); }

  static Localization Localize(const cv::Mat& image, const QueryCamera& camera,
                               const LocalizationOptions& options = {}) {
    SyntheticLineDetector detector;
    SyntheticMatcher matcher;
    return Localizer(*map_, detector, matcher, options).Localize(image, camera);
  }

  static Rigid3 TruePose(int frame) {
    return place_->sequence().states()[static_cast<std::size_t>(frame)].world_from_body;
  }

  static void ExpectNear(const Localization& answer, const Rigid3& world_from_body) {
    ASSERT_TRUE(answer.pose.has_value()) << answer.refusal;
    const Rigid3 error = answer.pose->world_from_body.Inverse() * world_from_body;
    EXPECT_LT(error.translation.norm(), 0.06);
    EXPECT_LT(error.Angle(), 0.02);
  }

  static const SyntheticPlace* place_;
  static const LocalizationMap* map_;
};
const SyntheticPlace* LocalizerTest::place_ = nullptr;
const LocalizationMap* LocalizerTest::map_ = nullptr;

TEST_F(LocalizerTest, LocatesImagesBetweenTheKeyframes) {
  for (const int frame : {1, 14, 27}) {
    const Localization answer = Localize(place_->Image(frame), SameCamera());
    ExpectNear(answer, TruePose(frame));
    EXPECT_EQ(answer.stage, LocalizationStage::kVerified);
    EXPECT_TRUE(answer.refusal.empty());
    EXPECT_EQ(answer.pose->component, 0);
    EXPECT_GT(answer.pose->inliers, 20);
    EXPECT_GT(answer.pose->covariance.trace(), 0);
    EXPECT_GT(answer.milliseconds.Total(), 0);
    EXPECT_LE(answer.candidates.size(), 3U);
    EXPECT_GE(answer.retrieved, static_cast<int>(answer.candidates.size()));
  }
}

TEST_F(LocalizerTest, TheQueryMayComeFromAnotherDistortedCamera) {
  RigCamera other = EurocLikeRig(376, 240).left;
  other.camera.pinhole.fx *= 1.05;
  other.camera.pinhole.fy *= 1.05;
  const Rigid3 body(place_->WorldFromCam(10) * other.body_from_cam.Inverse());
  const ImageRenderer renderer(place_->sequence().world(), other.camera);
  const cv::Mat image = renderer.Render(body * other.body_from_cam).image;
  ExpectNear(Localize(image, QueryCamera(other)), body);
}

TEST_F(LocalizerTest, RefusesAnotherPlaceAndAnEmptyImage) {
  SyntheticWorldOptions options;
  options.seed = 77;
  const SyntheticWorld elsewhere(options);
  const ImageRenderer renderer(elsewhere, place_->sequence().rig().left.camera);
  for (const int frame : {0, 13, 26, 39}) {
    const Localization answer =
        Localize(renderer.Render(place_->WorldFromCam(frame)).image, SameCamera());
    EXPECT_FALSE(answer.pose.has_value());
    EXPECT_THAT(answer.refusal, HasSubstr("agree on a pose, more than 20 are needed"));
    EXPECT_EQ(answer.stage, LocalizationStage::kVerified);
  }
  const Localization answer = Localize(cv::Mat(208, 320, CV_8UC1, cv::Scalar(3)), SameCamera());
  EXPECT_FALSE(answer.pose.has_value());
  EXPECT_EQ(answer.refusal, "the image shows no features");
  EXPECT_EQ(answer.stage, LocalizationStage::kDetected);
}

TEST_F(LocalizerTest, RefusesToChooseBetweenPlacesThatLookAlike) {
  // The map holds the same place twice, 10 m apart.
  Map map = place_->map();
  const auto count = static_cast<KeyframeId>(map.keyframes.size());
  const auto landmarks = static_cast<LandmarkId>(map.landmarks.size());
  for (KeyframeId id = 0; id < count; ++id) {
    Keyframe copy = map.keyframes.at(id);
    copy.id += count;
    copy.world_from_cam.translation.x() += 10;
    for (LandmarkId& landmark : copy.landmarks) landmark += landmarks;
    map.keyframes[copy.id] = copy;
  }
  for (LandmarkId id = 0; id < landmarks; ++id) {
    Landmark copy = map.landmarks.at(id);
    copy.id += landmarks;
    copy.point_in_world.x() += 10;
    map.landmarks[copy.id] = copy;
  }
  const PlaceIndex places(map, place_->TrainKeypointVocabulary(), nullptr);
  const LocalizationMap twice{map, places};
  SyntheticDetector detector;
  SyntheticMatcher matcher;
  LocalizationOptions options;
  options.sure_inliers = 10000;
  Localizer localizer(twice, detector, matcher, options);
  EXPECT_FALSE(localizer.uses_structure_graph());
  const Localization answer = localizer.Localize(place_->Image(9), SameCamera());
  EXPECT_FALSE(answer.pose.has_value());
  EXPECT_THAT(answer.refusal, HasSubstr("lie apart, but both fit"));
}

TEST_F(LocalizerTest, TheStructureGraphTakesPart) {
  SyntheticLineDetector lines;
  SyntheticDetector no_lines;
  SyntheticMatcher matcher;
  LocalizationOptions options;
  EXPECT_TRUE(Localizer(*map_, lines, matcher, options).uses_structure_graph());
  EXPECT_FALSE(Localizer(*map_, no_lines, matcher, options).uses_structure_graph());
  options.sure_inliers = 10000;
  const auto with = Localize(place_->Image(8), SameCamera(), options);
  options.structure_graph = false;
  const auto without = Localize(place_->Image(8), SameCamera(), options);
  // Frame 8 is keyframe 2: junctions and lines agree with its own graph, n of them.
  ASSERT_EQ(with.candidates.front().id, 2);
  ASSERT_EQ(without.candidates.front().id, 2);
  const double n = 40;
  EXPECT_NEAR(with.candidates.front().score, without.candidates.front().score + 1 * (1 + n),
              0.15 * n);
}

TEST_F(LocalizerTest, ASureCandidateEndsTheSearch) {
  LocalizationOptions options;
  options.sure_inliers = 21;
  EXPECT_EQ(Localize(place_->Image(8), SameCamera(), options).verified.size(), 1U);
  options.sure_inliers = 10000;
  options.candidates = 2;
  EXPECT_EQ(Localize(place_->Image(8), SameCamera(), options).verified.size(), 2U);
}

TEST_F(LocalizerTest, ManyThreadsShareAMap) {
  constexpr int kThreads = 4;
  std::vector<Localization> answers(kThreads);
  std::vector<std::thread> threads;
  const QueryCamera camera = SameCamera();
  const cv::Mat image = place_->Image(5);
  for (int i = 0; i < kThreads; ++i) {
    threads.emplace_back(
        [&, i] { answers[static_cast<std::size_t>(i)] = Localize(image, camera); });
  }
  for (std::thread& thread : threads) thread.join();
  for (const Localization& answer : answers) {
    ASSERT_TRUE(answer.pose.has_value());
    EXPECT_EQ(answer.pose->world_from_body.translation,
              answers.front().pose->world_from_body.translation);
    EXPECT_EQ(answer.pose->covariance, answers.front().pose->covariance);
  }
}

TEST_F(LocalizerTest, BodyCovarianceMatchesSampledPoses) {
  const Rigid3 world_from_cam(Eigen::Quaterniond(0.4, -0.5, 0.6, 0.2), {1, 2, 3});
  const Rigid3 body_from_cam(Eigen::Quaterniond(0.9, 0.2, -0.1, 0.3), {0.4, -0.2, 0.7});
  const Rigid3 world_from_body = world_from_cam * body_from_cam.Inverse();
  // The body's pose errors as functions of the camera's, numerically, one column an error.
  Matrix6d jacobian;
  constexpr double kStep = 1e-6;
  for (int i = 0; i < 6; ++i) {
    Eigen::Matrix<double, 6, 1> d = Eigen::Matrix<double, 6, 1>::Zero();
    d[i] = kStep;
    Rigid3 moved = world_from_cam;
    moved.rotation =
        moved.rotation * Eigen::Quaterniond(1, d[0] / 2, d[1] / 2, d[2] / 2).normalized();
    moved.translation += d.tail<3>();
    const Rigid3 body = moved * body_from_cam.Inverse();
    jacobian.col(i) << 2 * (world_from_body.rotation.conjugate() * body.rotation).vec() / kStep,
        (body.translation - world_from_body.translation) / kStep;
  }
  std::mt19937 random(2);
  std::normal_distribution<double> normal;
  const Matrix6d root = Matrix6d::NullaryExpr([&] { return normal(random); });
  const Matrix6d of_cam = root * root.transpose();
  EXPECT_TRUE(BodyCovariance(of_cam, world_from_cam, body_from_cam)
                  .isApprox(jacobian * of_cam * jacobian.transpose(), 1e-5));
}

TEST_F(LocalizerTest, SaysWhatIsWrong) {
  SyntheticDetector detector;
  SyntheticMatcher matcher;
  const auto with = [&](const LocalizationOptions& options) {
    return ErrorOf([&] { Localizer(*map_, detector, matcher, options); });
  };
  EXPECT_THAT(with({.candidates = 0}), HasSubstr("candidates is 0"));
  EXPECT_THAT(with({.min_inliers = 3}), HasSubstr("min_inliers is 3"));
  EXPECT_THAT(with({.sure_inliers = 20}), HasSubstr("sure_inliers = 20"));
  EXPECT_THAT(with({.rival_share = 0}), HasSubstr("rival_share"));
  const TemporaryFolder folder;
  const std::filesystem::path file = folder.path() / "map.db";
  MapWriter(file, place_->map().calibration, "other", "0123456789abcdef").Close();
  ModelPack pack;
  pack.name = "mine";
  pack.features.network.sha256 = "fedcba9876543210";
  EXPECT_THAT(ErrorOf([&] { LocalizationMap::Load(file, pack); }),
              HasSubstr("made with the model pack other (0123456789ab), not with mine"));
}

TEST_F(LocalizerTest, LoadsAMapWithItsPlaceRecord) {
  const TemporaryFolder folder;
  ModelPack pack;
  pack.name = "mine";
  pack.features.network.sha256 = place_->map().model_pack_sha256;
  map_->places.vocabulary().Write(folder.path() / "vocabulary.bin");
  pack.vocabulary = PackFile{(folder.path() / "vocabulary.bin").string(), ""};
  MapWriter writer(folder.path() / "map.db", place_->map().calibration, "synthetic", "synthetic");
  for (const auto& [id, keyframe] : place_->map().keyframes) {
    std::vector<Landmark> landmarks;
    for (const LandmarkId landmark : keyframe.landmarks) {
      landmarks.push_back(place_->map().landmarks.at(landmark));
    }
    writer.AddKeyframe(keyframe, landmarks);
  }
  writer.WritePlaceRecord(map_->places.Record());
  writer.Close();
  const LocalizationMap loaded = LocalizationMap::Load(folder.path() / "map.db", pack);
  EXPECT_TRUE(loaded.places.has_junction_words());
  SyntheticLineDetector detector;
  SyntheticMatcher matcher;
  Localizer localizer(loaded, detector, matcher, {});
  ExpectNear(localizer.Localize(place_->Image(6), SameCamera()), TruePose(6));
}

}  // namespace
}  // namespace airslam
