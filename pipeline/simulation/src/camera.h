#pragma once

#include <Eigen/Core>
#include <vector>

#include "light.h"
#include "ray_caster.h"
#include "revisit/datasets/gray_png.h"
#include "revisit/datasets/pose.h"
#include "texture.h"

namespace revisit::pipeline::simulation {

/// A camera without distortion, as KITTI's are after rectification.
struct CameraModel {
  int width = 0, height = 0;
  Eigen::Matrix3d K;  // pixel = K * direction, camera axes x right, y down, z forward
  Pose T_velo_cam;
};

/// One per thread.
class Camera {
 public:
  Camera(const CameraModel& model, const Textures& textures, uint64_t seed);

  /// The picture depends on seed, frame, pose, light and scene only.
  GrayImage picture(int frame, const Pose& T_world_velo, const Light& light, RayCaster& scene);

 private:
  /// Radiance along each of `directions_`.
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
  std::vector<uint32_t> pixels_;             // [ray] where in the image it belongs
  std::vector<Eigen::Vector3f> directions_;  // [ray] unit, in the town
  std::vector<Hit> hits_;                    // [ray]
  std::vector<float> radiance_;              // [ray]
  std::vector<uint8_t> obstructed_;

  /// Light that comes if nothing is in between.
  struct Incoming {
    std::vector<uint32_t> rays;
    std::vector<Eigen::Vector3f> points;
    std::vector<float> radiance;  // reflected to the camera
    void clear() { rays.clear(), points.clear(), radiance.clear(); }
    void add(size_t ray, const Eigen::Vector3f& point, float reflected);
  };
  void receive(const Incoming& light, const Eigen::Vector3f& direction, float reach,
               RayCaster& scene);
  Incoming from_sun_, from_zenith_;
};

}  // namespace revisit::pipeline::simulation
