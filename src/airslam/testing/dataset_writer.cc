// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/testing/dataset_writer.h"

#include <fmt/format.h>

#include <fstream>
#include <opencv2/imgcodecs.hpp>

#include "airslam/common/error.h"

namespace airslam {
namespace {

namespace fs = std::filesystem;

// A text file that says so when it could not be written.
class TextFile {
 public:
  explicit TextFile(const fs::path& path) : path_(path), stream_(path) {
    if (!stream_) Fail("cannot create {}", path_.string());
  }
  template <typename... Args>
  void Print(fmt::format_string<Args...> format, Args&&... args) {
    stream_ << fmt::format(format, std::forward<Args>(args)...);
  }
  void Close() {
    stream_.close();
    if (!stream_) Fail("cannot write {}", path_.string());
  }

 private:
  fs::path path_;
  std::ofstream stream_;
};

void MakeFolder(const fs::path& folder) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) Fail("cannot create the folder {}: {}", folder.string(), error.message());
}

void WritePng(const fs::path& path, const cv::Mat& image) {
  if (!cv::imwrite(path.string(), image, {cv::IMWRITE_PNG_COMPRESSION, 1})) {
    Fail("cannot write the image {}", path.string());
  }
}

void PrintTransform(TextFile& file, const Rigid3& body_from_sensor) {
  const Eigen::Matrix4d m = body_from_sensor.ToMatrix();
  file.Print("T_BS:\n  cols: 4\n  rows: 4\n  data: [");
  for (int row = 0; row < 4; ++row) {
    file.Print("{}{:.15g}, {:.15g}, {:.15g}, {:.15g}", row ? ",\n         " : "", m(row, 0),
               m(row, 1), m(row, 2), m(row, 3));
  }
  file.Print("]\n");
}

// EuRoC has one camera model with a name; without distortion its coefficients are zero.
void WriteCameraYaml(const fs::path& path, const RigCamera& camera, double rate_hz) {
  if (camera.camera.model == Distortion::kEquidistant) {
    Fail("an EuRoC sensor.yaml has no equidistant distortion");
  }
  const Pinhole& pinhole = camera.camera.pinhole;
  const auto& k = camera.camera.coefficients;
  TextFile file(path);
  file.Print("sensor_type: camera\ncomment: synthetic\n");
  PrintTransform(file, camera.body_from_cam);
  file.Print("rate_hz: {:g}\nresolution: [{}, {}]\ncamera_model: pinhole\n", rate_hz, pinhole.width,
             pinhole.height);
  file.Print("intrinsics: [{:.15g}, {:.15g}, {:.15g}, {:.15g}]\n", pinhole.fx, pinhole.fy,
             pinhole.cx, pinhole.cy);
  file.Print("distortion_model: radial-tangential\n");
  file.Print("distortion_coefficients: [{:.15g}, {:.15g}, {:.15g}, {:.15g}]\n", k[0], k[1], k[2],
             k[3]);
  file.Close();
}

void WriteImu(const fs::path& folder, const ImuNoise& noise,
              const std::vector<ImuSample>& samples) {
  MakeFolder(folder);
  TextFile yaml(folder / "sensor.yaml");
  yaml.Print("sensor_type: imu\ncomment: synthetic\n");
  PrintTransform(yaml, Rigid3());
  yaml.Print("rate_hz: {:g}\n", noise.rate_hz);
  yaml.Print("gyroscope_noise_density: {:.15g}\n", noise.gyroscope_noise_density);
  yaml.Print("gyroscope_random_walk: {:.15g}\n", noise.gyroscope_random_walk);
  yaml.Print("accelerometer_noise_density: {:.15g}\n", noise.accelerometer_noise_density);
  yaml.Print("accelerometer_random_walk: {:.15g}\n", noise.accelerometer_random_walk);
  yaml.Close();
  TextFile csv(folder / "data.csv");
  csv.Print(
      "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
      "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]\n");
  for (const ImuSample& sample : samples) {
    const Eigen::Vector3d &w = sample.angular_velocity, &a = sample.acceleration;
    csv.Print("{},{:.12f},{:.12f},{:.12f},{:.12f},{:.12f},{:.12f}\n", sample.timestamp_ns, w.x(),
              w.y(), w.z(), a.x(), a.y(), a.z());
  }
  csv.Close();
}

void PrintVector(TextFile& file, const Eigen::Vector3d& v) {
  file.Print(",{:.9f},{:.9f},{:.9f}", v.x(), v.y(), v.z());
}

void WriteGroundTruth(const fs::path& folder, const SyntheticSequence& sequence) {
  MakeFolder(folder);
  TextFile csv(folder / "data.csv");
  csv.Print(
      "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], "
      "q_RS_z [], v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], v_RS_R_z [m s^-1], "
      "b_w_RS_S_x [rad s^-1], b_w_RS_S_y [rad s^-1], b_w_RS_S_z [rad s^-1], "
      "b_a_RS_S_x [m s^-2], b_a_RS_S_y [m s^-2], b_a_RS_S_z [m s^-2]\n");
  const ImuRecording& imu = sequence.imu_recording();
  const std::size_t rows = imu.samples.empty() ? sequence.states().size() : imu.samples.size();
  for (std::size_t i = 0; i < rows; ++i) {
    const BodyState state = imu.samples.empty()
                                ? sequence.states()[i]
                                : sequence.trajectory().At(imu.samples[i].timestamp_ns);
    const Eigen::Quaterniond& q = state.world_from_body.rotation;
    csv.Print("{}", state.timestamp_ns);
    PrintVector(csv, state.world_from_body.translation);
    csv.Print(",{:.9f},{:.9f},{:.9f},{:.9f}", q.w(), q.x(), q.y(), q.z());
    PrintVector(csv, state.velocity_in_world);
    const Eigen::Vector3d none = Eigen::Vector3d::Zero();
    PrintVector(csv, imu.samples.empty() ? none : imu.gyroscope_biases[i]);
    PrintVector(csv, imu.samples.empty() ? none : imu.accelerometer_biases[i]);
    csv.Print("\n");
  }
  csv.Close();
}

}  // namespace

void WriteEurocFolder(const SyntheticSequence& sequence, const fs::path& folder) {
  const fs::path mav0 = folder / "mav0";
  const StereoRig& rig = sequence.rig();
  for (const auto& [name, camera] : {std::pair("cam0", &rig.left), {"cam1", &rig.right}}) {
    MakeFolder(mav0 / name / "data");
    WriteCameraYaml(mav0 / name / "sensor.yaml", *camera, rig.rate_hz);
    TextFile csv(mav0 / name / "data.csv");
    csv.Print("#timestamp [ns],filename\n");
    for (int i = 0; i < sequence.size(); ++i) {
      csv.Print("{0},{0}.png\n", sequence.timestamp_ns(i));
    }
    csv.Close();
  }
  for (int i = 0; i < sequence.size(); ++i) {
    const StereoPair pair = sequence.Read(i);
    const std::string file = fmt::format("{}.png", pair.timestamp_ns);
    WritePng(mav0 / "cam0" / "data" / file, pair.left);
    WritePng(mav0 / "cam1" / "data" / file, pair.right);
  }
  if (rig.imu) WriteImu(mav0 / "imu0", *rig.imu, sequence.imu());
  WriteGroundTruth(mav0 / "state_groundtruth_estimate0", sequence);
}

void WriteKittiFolder(const SyntheticSequence& sequence, const fs::path& folder) {
  const StereoRig& rig = sequence.rig();
  if (!rig.already_rectified || rig.left.body_from_cam.translation.norm() > 1e-9 ||
      rig.left.body_from_cam.Angle() > 1e-9) {
    Fail("a KITTI folder needs a rectified rig whose body is the left camera");
  }
  MakeFolder(folder / "image_0");
  MakeFolder(folder / "image_1");
  const Pinhole& p = rig.left.camera.pinhole;
  TextFile calibration(folder / "calib.txt");
  for (const auto& [name, shift] : {std::pair("P0", 0.0), {"P1", -p.fx * rig.Baseline()}}) {
    calibration.Print("{}: {:.12e} 0 {:.12e} {:.12e} 0 {:.12e} {:.12e} 0 0 0 1 0\n", name, p.fx,
                      p.cx, shift, p.fy, p.cy);
  }
  calibration.Close();
  TextFile times(folder / "times.txt"), poses(folder / "poses.txt");
  const Rigid3 first_from_world = sequence.states().front().world_from_body.Inverse();
  for (int i = 0; i < sequence.size(); ++i) {
    const StereoPair pair = sequence.Read(i);
    const std::string file = fmt::format("{:06d}.png", i);
    WritePng(folder / "image_0" / file, pair.left);
    WritePng(folder / "image_1" / file, pair.right);
    times.Print("{:.6e}\n",
                1e-9 * static_cast<double>(pair.timestamp_ns - sequence.timestamp_ns(0)));
    const Eigen::Matrix4d m = (first_from_world * sequence.states()[i].world_from_body).ToMatrix();
    for (int k = 0; k < 12; ++k) poses.Print("{}{:.9e}", k ? " " : "", m(k / 4, k % 4));
    poses.Print("\n");
  }
  times.Close();
  poses.Close();
}

}  // namespace airslam
