#include "drive.h"

#include <cmath>
#include <cstdio>
#include <sstream>

#include "random.h"
#include "revisit/base/error.h"
#include "revisit/base/files.h"
#include "revisit/datasets/dataset.h"

namespace revisit::simulation {
namespace {

constexpr double kImageWidth = 1241, kImageHeight = 376;  // as in KITTI's sequence 00 [px]

/// Camera 8 cm below and 27 cm in front of the LiDAR. Its small rotations expose readers that
/// ignore the rotation of Tr.
Pose typical_calibration() {
  const auto about = [](double degrees, const Eigen::Vector3d& axis) {
    return Eigen::AngleAxisd(degrees * 3.14159265358979323846 / 180, axis);
  };
  Pose T_cam_velo = Pose::Identity();
  T_cam_velo.linear() = axes_of_camera().linear() * (about(0.05, Eigen::Vector3d::UnitZ()) *
                                                     about(-0.4, Eigen::Vector3d::UnitY()) *
                                                     about(0.1, Eigen::Vector3d::UnitX()))
                                                        .toRotationMatrix();
  T_cam_velo.translation() = Eigen::Vector3d(-0.01, -0.08, -0.27);
  return T_cam_velo;
}

Eigen::Quaterniond tilt(const SimulationConfig& config) {
  return Eigen::AngleAxisd(config.sensor_pitch * kDegree, Eigen::Vector3d::UnitY()) *
         Eigen::AngleAxisd(config.sensor_roll * kDegree, Eigen::Vector3d::UnitX());
}

void append_matrix(const Eigen::Matrix<double, 3, 4>& m, const char* format, std::string* text) {
  char number[40];
  for (int row = 0; row < 3; ++row)
    for (int column = 0; column < 4; ++column) {
      std::snprintf(number, sizeof number, format, m(row, column));
      *text += number;
      *text += row == 2 && column == 3 ? "\n" : " ";
    }
}

using Projection = Eigen::Matrix<double, 3, 4>;

Projection typical_projection(int camera) {
  constexpr double kFocal = 720, kX = 610, kY = 185, kBaseline = 0.54;  // [px], [m]
  Projection P;
  P << kFocal, 0, kX, camera % 2 ? -kFocal * kBaseline : 0,  //
      0, kFocal, kY, 0,                                      //
      0, 0, 1, 0;
  return P;
}

/// Pixels become 1 / `scale` times as large; the middle of the first pixel is 0.
Projection scaled(const Projection& P, double scale) {
  Eigen::Matrix3d S;
  S << scale, 0, (scale - 1) / 2,  //
      0, scale, (scale - 1) / 2,   //
      0, 0, 1;
  return S * P;
}

/// Scales projections P0, P1..., and replaces Tr if `T_cam_velo` is given.
std::string changed_calibration(const std::filesystem::path& file, double scale,
                                const Pose* T_cam_velo) {
  std::istringstream lines(read_content(file));
  std::string line, result;
  while (std::getline(lines, line)) {
    const size_t colon = line.find(':');
    const std::string name = line.substr(0, colon);
    if (T_cam_velo && (name == "Tr" || name == "Tr_velo_to_cam")) {
      result += name + ": ";
      append_matrix(T_cam_velo->matrix().topRows<3>(), "%.12e", &result);
    } else if (scale != 1 && line.starts_with('P') && colon != std::string::npos) {
      result += name + ": ";
      append_matrix(scaled(read_kitti_projection(file, name), scale), "%.12e", &result);
    } else {
      result += line + "\n";
    }
  }
  return result;
}

std::string calibration_text(const Pose& T_cam_velo, double scale) {
  std::string text;
  for (int camera = 0; camera < 4; ++camera) {
    text += str("P", camera, ": ");
    append_matrix(scaled(typical_projection(camera), scale), "%.12e", &text);
  }
  text += "Tr: ";
  append_matrix(T_cam_velo.matrix().topRows<3>(), "%.12e", &text);
  return text;
}

}  // namespace

Drive make_drive(const SimulationConfig& config, const std::vector<Pose>& site) {
  Drive drive;
  const double scale = config.camera ? config.image_scale : 1;
  const bool tilted = config.sensor_pitch != 0 || config.sensor_roll != 0;
  const Pose T_cam_level =
      config.calibration ? read_kitti_calibration(*config.calibration) : typical_calibration();
  drive.R_level_velo = tilt(config);
  drive.T_cam_velo = tilted ? T_cam_level * drive.R_level_velo : T_cam_level;
  if (!config.calibration)
    drive.calibration = calibration_text(drive.T_cam_velo, scale);
  else if (tilted || scale != 1)
    drive.calibration =
        changed_calibration(*config.calibration, scale, tilted ? &drive.T_cam_velo : nullptr);
  else
    drive.calibration = read_content(*config.calibration);
  if (config.camera) {
    const Projection P0 = config.calibration ? read_kitti_projection(*config.calibration, "P0")
                                             : typical_projection(0);
    drive.camera = {static_cast<int>(std::lround(kImageWidth * scale)),
                    static_cast<int>(std::lround(kImageHeight * scale)),
                    scaled(P0, scale).leftCols<3>(), drive.T_cam_velo.inverse()};
  }
  if (config.poses) {
    drive.poses = flatten(read_kitti_poses(*config.poses), T_cam_level, *config.poses);
    drive.given_poses = read_content(*config.poses);
  } else if (!site.empty()) {
    for (const Pose& T : site)
      drive.poses.push_back(
          {T.translation().x(), T.translation().y(), std::atan2(T(1, 0), T(0, 0))});
  } else {
    drive.poses = generate_route(config.route, config.length, config.seed);
  }
  return drive;
}

std::string times_text(size_t frames) {
  std::string text;
  char line[40];
  for (size_t i = 0; i < frames; ++i) {
    std::snprintf(line, sizeof line, "%.6e\n", static_cast<double>(i) * kFramePeriod);
    text += line;
  }
  return text;
}

std::string poses_text(const std::vector<Pose>& T_town_velo, const Pose& T_cam_velo) {
  std::string text;
  const Pose T_velo_cam = T_cam_velo.inverse();
  const Pose T_world_town = (T_town_velo.front() * T_velo_cam).inverse();
  for (const Pose& T : T_town_velo) {
    const Pose T_world_cam = T_world_town * T * T_velo_cam;
    append_matrix(T_world_cam.matrix().topRows<3>(), "%.9e", &text);
  }
  return text;
}

}  // namespace revisit::simulation
