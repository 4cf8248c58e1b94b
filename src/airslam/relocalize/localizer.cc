// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/relocalize/localizer.h"

#include <algorithm>
#include <chrono>
#include <utility>

#include "airslam/common/options.h"
#include "airslam/geometry/so3.h"
#include "airslam/map/map_file.h"

namespace airslam {
namespace {

// Milliseconds since it was made or last asked.
class LapTimer {
 public:
  double Lap() {
    const auto now = Clock::now();
    const double lap = std::chrono::duration<double, std::milli>(now - start_).count();
    start_ = now;
    return lap;
  }

 private:
  using Clock = std::chrono::steady_clock;
  Clock::time_point start_ = Clock::now();
};

bool Better(const PlaceMatch& a, const PlaceMatch& b) {
  return a.inliers.size() > b.inliers.size();
}

}  // namespace

void LocalizationOptions::Validate() const {
  RequireRanges(*this);
  RequireOption(sure_inliers > min_inliers, "sure_inliers", sure_inliers,
                "must be more than min_inliers");
  verification.Validate();
}

const char* ToString(LocalizationStage stage) {
  switch (stage) {
    case LocalizationStage::kDetected:
      return "detect";
    case LocalizationStage::kRetrieved:
      return "retrieve";
    case LocalizationStage::kFiltered:
      return "filter";
    case LocalizationStage::kVerified:
      return "verify";
  }
  return "";
}

LocalizationMap LocalizationMap::Load(const std::filesystem::path& file, const ModelPack& pack) {
  Map map = ReadMap(file);
  if (map.model_pack_sha256 != pack.features.network.sha256) {
    Fail(
        "map file {} was made with the model pack {} ({:.12}), not with {} ({:.12}): their "
        "descriptors do not match",
        file.string(), map.model_pack, map.model_pack_sha256, pack.name,
        pack.features.network.sha256);
  }
  PlaceIndex places = PlaceIndex::FromRecord(map, LoadVocabulary(pack), ReadPlaceRecord(file));
  return {std::move(map), std::move(places)};
}

Localizer::Localizer(const LocalizationMap& map, FeatureDetector& detector, FeatureMatcher& matcher,
                     const LocalizationOptions& options)
    : map_(map),
      detector_(detector),
      matcher_(matcher),
      options_(options),
      structure_graph_(options.structure_graph && map.places.has_junction_words() &&
                       detector.finds_lines()) {
  options_.Validate();
  if (detector.descriptor_size() != map.places.vocabulary().descriptor_size()) {
    Fail("the detector's descriptors have {} values, those of the map {}",
         detector.descriptor_size(), map.places.vocabulary().descriptor_size());
  }
}

std::vector<ScoredKeyframe> Localizer::Filter(const std::vector<ScoredKeyframe>& retrieved,
                                              const Detections& query) const {
  std::vector<ScoredKeyframe> filtered = retrieved;
  if (structure_graph_ && !query.junctions.empty()) {
    const Vocabulary& vocabulary = map_.places.junction_vocabulary();
    Junctions junctions{query.junction_descriptors, vocabulary.Words(query.junction_descriptors),
                        JoinLines(query.lines, query.junctions)};
    const BagOfWords bag = vocabulary.Bag(junctions.words);
    for (ScoredKeyframe& keyframe : filtered) {
      const PlaceIndex::Place& place = map_.places.place(keyframe.id);
      // S = S_K + S_J (1 + S_G / n)
      keyframe.score +=
          BagScore(bag, place.junction_bag) * (1 + StructureScore(junctions, place.junctions));
    }
    filtered = KeepHighScores(filtered, 0);
  }
  filtered.resize(std::min(filtered.size(), static_cast<std::size_t>(options_.candidates)));
  return filtered;
}

void Localizer::Verify(const Detections& query, const QueryCamera& camera, Localization& answer) {
  const PlaceView view{query.keypoints, query.descriptors, camera.pinhole()};
  for (const ScoredKeyframe& candidate : answer.candidates) {
    answer.verified.push_back(VerifyPlace(view, map_.map, map_.map.keyframes.at(candidate.id),
                                          matcher_, options_.verification));
    if (static_cast<int>(answer.verified.back().inliers.size()) >= options_.sure_inliers) break;
  }
}

void Localizer::Judge(const QueryCamera& camera, Localization& answer) const {
  const auto best = std::min_element(answer.verified.begin(), answer.verified.end(), Better);
  const auto inliers = static_cast<int>(best->inliers.size());
  if (inliers <= options_.min_inliers) {
    answer.refusal =
        fmt::format("{} of {} matches with keyframe {} agree on a pose, more than {} are needed",
                    inliers, best->matches, best->keyframe, options_.min_inliers);
    return;
  }
  const int component = map_.map.keyframes.at(best->keyframe).component;
  for (const PlaceMatch& other : answer.verified) {
    if (static_cast<double>(other.inliers.size()) < options_.rival_share * inliers) continue;
    const double distance =
        (other.world_from_cam.translation - best->world_from_cam.translation).norm();
    const bool elsewhere = map_.map.keyframes.at(other.keyframe).component != component ||
                           distance > options_.rival_distance;
    if (!elsewhere) continue;
    answer.refusal = fmt::format("keyframes {} and {} lie apart, but both fit: {} and {} inliers",
                                 best->keyframe, other.keyframe, inliers, other.inliers.size());
    return;
  }
  answer.pose =
      LocalizedPose{best->world_from_cam * camera.body_from_cam().Inverse(),
                    BodyCovariance(best->covariance, best->world_from_cam, camera.body_from_cam()),
                    component, best->keyframe, inliers};
}

Localization Localizer::Localize(const cv::Mat& raw, const QueryCamera& camera) {
  Localization answer;
  LapTimer timer;
  const cv::Mat image = camera.Undistort(raw);
  answer.milliseconds.undistort = timer.Lap();
  const DetectionRequest request(options_.max_keypoints, structure_graph_);
  const Detections query = detector_.Detect(image, camera.mask(), request);
  answer.milliseconds.detect = timer.Lap();
  answer.keypoints = static_cast<int>(query.keypoints.size());

  const Vocabulary& vocabulary = map_.places.vocabulary();
  const BagOfWords bag = vocabulary.Bag(vocabulary.Words(query.descriptors));
  const std::vector<ScoredKeyframe> retrieved =
      KeepHighScores(map_.places.index().Scores(bag), options_.min_score_share);
  answer.milliseconds.retrieve = timer.Lap();
  answer.retrieved = static_cast<int>(retrieved.size());
  if (retrieved.empty()) {
    answer.refusal = query.keypoints.empty()
                         ? "the image shows no features"
                         : "no keyframe of the map shares a word with the image";
    return answer;
  }
  answer.stage = LocalizationStage::kRetrieved;
  answer.candidates = Filter(retrieved, query);
  answer.milliseconds.filter = timer.Lap();
  answer.stage = LocalizationStage::kFiltered;
  Verify(query, camera, answer);
  answer.stage = LocalizationStage::kVerified;
  Judge(camera, answer);
  answer.milliseconds.verify = timer.Lap();
  return answer;
}

Matrix6d BodyCovariance(const Matrix6d& of_cam, const Rigid3& world_from_cam,
                        const Rigid3& body_from_cam) {
  // world_from_body = world_from_cam * cam_from_body; a small rotation d of the camera moves the
  // body's origin by R_world_cam (d x t) = -R_world_cam [t]x d, t the translation of cam_from_body.
  const Rigid3 cam_from_body = body_from_cam.Inverse();
  Matrix6d jacobian = Matrix6d::Identity();
  jacobian.topLeftCorner<3, 3>() = body_from_cam.rotation.toRotationMatrix();
  jacobian.bottomLeftCorner<3, 3>() =
      -world_from_cam.rotation.toRotationMatrix() * Skew(cam_from_body.translation);
  return jacobian * of_cam * jacobian.transpose();
}

}  // namespace airslam
