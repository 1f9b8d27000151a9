#include "simulation/drive.h"

#include <cstdio>
#include <fstream>
#include <sstream>

#include "revisit/proto/error.h"

namespace revisit::pipeline::simulation {
namespace {

std::string file_content(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::ostringstream content;
  content << in.rdbuf();
  if (!in) throw InputError(file.string() + ": cannot be read");
  return std::move(content).str();
}

/// Camera 8 cm below and 27 cm in front of the LiDAR, with the fractions of a degree that a real
/// mounting has: who forgets the rotation of Tr shall see it.
Pose typical_calibration() {
  Eigen::Matrix3d axes;  // camera x right, y down, z forward from LiDAR x forward, y left, z up
  axes << 0, -1, 0,      //
      0, 0, -1,          //
      1, 0, 0;
  const auto about = [](double degrees, const Eigen::Vector3d& axis) {
    return Eigen::AngleAxisd(degrees * 3.14159265358979323846 / 180, axis);
  };
  Pose T_cam_velo = Pose::Identity();
  T_cam_velo.linear() =
      axes * (about(0.05, Eigen::Vector3d::UnitZ()) * about(-0.4, Eigen::Vector3d::UnitY()) *
              about(0.1, Eigen::Vector3d::UnitX()))
                 .toRotationMatrix();
  T_cam_velo.translation() = Eigen::Vector3d(-0.01, -0.08, -0.27);
  return T_cam_velo;
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

std::string calibration_text(const Pose& T_cam_velo) {
  std::string text;
  for (int camera = 0; camera < 4; ++camera) {
    constexpr double kFocal = 720, kX = 610, kY = 185, kBaseline = 0.54;  // [px], [m]
    Eigen::Matrix<double, 3, 4> P;
    P << kFocal, 0, kX, camera % 2 ? -kFocal * kBaseline : 0,  //
        0, kFocal, kY, 0,                                      //
        0, 0, 1, 0;
    text += str("P", camera, ": ");
    append_matrix(P, "%.12e", &text);
  }
  text += "Tr: ";
  append_matrix(T_cam_velo.matrix().topRows<3>(), "%.12e", &text);
  return text;
}

}  // namespace

Drive make_drive(const SimulationConfig& config) {
  Drive drive;
  if (config.calibration) {
    drive.T_cam_velo = read_kitti_calibration(*config.calibration);
    drive.calibration = file_content(*config.calibration);
  } else {
    drive.T_cam_velo = typical_calibration();
    drive.calibration = calibration_text(drive.T_cam_velo);
  }
  if (config.poses) {
    drive.poses = flatten(read_kitti_poses(*config.poses), drive.T_cam_velo, *config.poses);
    drive.given_poses = file_content(*config.poses);
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

}  // namespace revisit::pipeline::simulation
