#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "random.h"
#include "ray_caster.h"
#include "revisit/datasets/dataset.h"
#include "revisit/datasets/scan_file.h"
#include "texture.h"

namespace revisit::simulation {

/// Unit of irradiance: direct sunlight through clear air.
struct Light {
  Eigen::Vector3f to_sun;                          // unit
  float sun = 1;                                   // irradiance, perpendicular to the sun
  float sky = 0.3f;                                // irradiance of the whole sky on level ground
  float exposure_error = 0;                        // auto exposure [stops]
  Eigen::Vector2f wind = Eigen::Vector2f::Zero();  // displacement of the clouds, in sky widths
};

/// `time` [s]. If `changing`, the sun moves an hour per minute, clouds pass, exposure has errors.
Light light_at(uint64_t seed, double time, bool changing);

/// Returns the radiance of air between the camera and distant objects, and of hills at the horizon.
float haze_radiance(const Light& light);
/// Returns the radiance of the sky towards the unit `direction`; hazy hills below the horizon.
float sky_radiance(const Light& light, const Eigen::Vector3f& direction, const Textures& textures);

/// `radiance` is [height][width]. Auto exposure uses the lower two thirds of the image (without the
/// sky) and has an error of `stops`. Photon and read noise, saturation and gamma follow.
GrayImage develop(std::span<const float> radiance, int width, int height, float stops,
                  uint64_t noise_seed);

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
