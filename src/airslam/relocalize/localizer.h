// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "airslam/map/map.h"
#include "airslam/neural/feature_detector.h"
#include "airslam/neural/feature_matcher.h"
#include "airslam/neural/model_pack.h"
#include "airslam/place/candidate_search.h"
#include "airslam/place/match_verification.h"
#include "airslam/place/place_index.h"
#include "airslam/relocalize/query_camera.h"

namespace airslam {

// Everything that `airslam localize --config` can change. What each field means stands in Visit.
struct LocalizationOptions {
  int max_keypoints = 400;
  double min_score_share = 0.3;
  bool structure_graph = true;
  int candidates = 3;
  int min_inliers = 20;
  int sure_inliers = 50;
  double rival_share = 0.7;
  double rival_distance = 1.0;
  VerificationOptions verification = {};

  template <class V>
  void Visit(V& v) {
    v.Field("max_keypoints", max_keypoints, {1, 100000},
            "Keypoints detected in the query (paper, section VII-D).");
    v.Field("min_score_share", min_score_share, {0, 0.99},
            "Stage 1: keyframes below this share of the best score are left out.");
    v.Field("structure_graph", structure_graph,
            "Stage 2 filters by junctions where the map has their words (`--no-structure-graph`: "
            "false).");
    v.Field("candidates", candidates, {1, 1000},
            "Keyframes that stage 2 leaves to be matched (`--candidates`).");
    v.Field("min_inliers", min_inliers, {4, 10000}, "A pose is valid with more inliers than this.");
    v.Field("sure_inliers", sure_inliers, {5, 100000},
            "Candidates are verified in order; one with this many inliers, which would make a "
            "loop, ends the search. More than min_inliers.");
    v.Field("rival_share", rival_share, {0.01, 1},
            "No answer when another candidate has at least this share of the best one's inliers "
            "for a place farther away than `rival_distance`.");
    v.Field("rival_distance", rival_distance, {0.001, 1e6, "m"},
            "Places that look alike cannot be told apart by one image: see `rival_share`.");
    v.Field("pixel_sigma", verification.pixel_sigma, {0.01, 100, "px"},
            "Standard deviation of a keypoint: keypoints lie on whole pixels, and those of a night "
            "and a day image differ by about one.");
    v.Field("ransac_error", verification.ransac.max_error, {0.1, 100, "px"},
            "What PnP-RANSAC takes for an inlier.");
  }

  // Throws Error that names the wrong field.
  void Validate() const;
};

// A map that is only read, with what place recognition knows of it. Shared by many threads.
struct LocalizationMap {
  Map map;
  PlaceIndex places;

  // Reads a map file; the pack must be that whose network made the map. Throws Error otherwise.
  static LocalizationMap Load(const std::filesystem::path& file, const ModelPack& pack);
};

// How far a query came (design, section 1).
enum class LocalizationStage { kDetected, kRetrieved, kFiltered, kVerified };
const char* ToString(LocalizationStage stage);

// The answer when there is one.
struct LocalizedPose {
  Rigid3 world_from_body;
  // Order: rotation about the body's axes (rad), position of the body in world (m).
  Matrix6d covariance = Matrix6d::Zero();
  int component = 0;         // of the map, whose world it is
  KeyframeId keyframe = -1;  // that was matched
  int inliers = 0;
};

// What became of a query: a pose, or the reason why there is none.
struct Localization {
  std::optional<LocalizedPose> pose;
  std::string refusal;  // one sentence; empty with a pose
  LocalizationStage stage = LocalizationStage::kDetected;
  int keypoints = 0;
  int retrieved = 0;                       // keyframes that stage 1 kept
  std::vector<ScoredKeyframe> candidates;  // that stage 2 left, best first
  std::vector<PlaceMatch> verified;        // of stage 3, in the order of the candidates
  struct Milliseconds {
    double undistort = 0, detect = 0, retrieve = 0, filter = 0, verify = 0;
    double Total() const { return undistort + detect + retrieve + filter + verify; }
  } milliseconds;
};

// Finds where an image was taken, from the image alone (paper, section VI-B; design, section 1):
// 1 keyframes with similar keypoint words, 2 of these the best by junction words and structure
// graph as well, 3 matching, PnP-RANSAC and refinement. One instance is used by one thread at a
// time; any number of them may share one map. The answer depends on map, image and options only.
class Localizer {
 public:
  // All arguments must outlive it. Throws Error when the options are wrong or the detector's
  // descriptors are not those of the map.
  Localizer(const LocalizationMap& map, FeatureDetector& detector, FeatureMatcher& matcher,
            const LocalizationOptions& options);

  // Whether stage 2 uses the structure graph: it is wanted, the map has junction words and the
  // detector finds lines.
  bool uses_structure_graph() const { return structure_graph_; }

  // raw: CV_8UC1, of the size of `camera`. Throws Error on another image.
  Localization Localize(const cv::Mat& raw, const QueryCamera& camera);

 private:
  std::vector<ScoredKeyframe> Filter(const std::vector<ScoredKeyframe>& retrieved,
                                     const Detections& query) const;
  void Verify(const Detections& query, const QueryCamera& camera, Localization& answer);
  void Judge(const QueryCamera& camera, Localization& answer) const;

  const LocalizationMap& map_;
  FeatureDetector& detector_;
  FeatureMatcher& matcher_;
  LocalizationOptions options_;
  bool structure_graph_;
};

// The covariance of world_from_body from that of world_from_cam, both in the order (rotation about
// own axes, position in world).
Matrix6d BodyCovariance(const Matrix6d& of_cam, const Rigid3& world_from_cam,
                        const Rigid3& body_from_cam);

}  // namespace airslam
