#pragma once

#include <Eigen/Core>
#include <vector>

#include "light.h"
#include "ray_caster.h"
#include "revisit/datasets/dataset.h"
#include "revisit/datasets/scan_file.h"
#include "texture.h"

namespace revisit::simulation {

/// Without distortion, like KITTI's rectified cameras.
struct CameraModel {
  int width = 0, height = 0;
  Eigen::Matrix3d K;  // pixel = K * direction, camera axes x right, y down, z forward
  Pose T_velo_cam;
};

/// Each thread needs its own.
class Camera {
 public:
  Camera(const CameraModel& model, const Textures& textures, uint64_t seed);

  /// Depends only on seed, frame, pose, light and scene.
  GrayImage picture(int frame, const Pose& T_world_velo, const Light& light, RayCaster& scene);

 private:
  void look(const Eigen::Vector3f& origin, const Light& light, RayCaster& scene);
  void add_ray(double column, double row, const Eigen::Matrix3f& R_world_cam);
  void smooth_edges(const Eigen::Vector3f& origin, const Eigen::Matrix3f& R_world_cam,
                    const Light& light, RayCaster& scene);

  CameraModel model_;
  const Textures& textures_;
  uint64_t seed_;
  Eigen::Matrix3d K_inverse_;
  float pixel_angle_;                        // [rad]
  std::vector<float> image_;                 // [height][width] radiance
  std::vector<uint32_t> pixels_;             // [ray], pixel index
  std::vector<Eigen::Vector3f> directions_;  // [ray], unit, town frame
  std::vector<Hit> hits_;                    // [ray]
  std::vector<float> radiance_;              // [ray]
  std::vector<uint8_t> obstructed_;

  /// Light that arrives unless it is occluded.
  struct Incoming {
    std::vector<uint32_t> rays;
    std::vector<Eigen::Vector3f> points;
    std::vector<float> radiance;  // [ray], reflected to the camera
    void clear() { rays.clear(), points.clear(), radiance.clear(); }
    void add(size_t ray, const Eigen::Vector3f& point, float reflected);
  };
  void receive(const Incoming& light, const Eigen::Vector3f& direction, float reach,
               RayCaster& scene);
  Incoming from_sun_, from_zenith_;
};

}  // namespace revisit::simulation
