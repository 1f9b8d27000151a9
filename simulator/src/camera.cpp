#include "camera.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "film.h"
#include "paint.h"

namespace revisit::simulation {
namespace {

using Vec3 = Eigen::Vector3f;

constexpr float kFar = 260;         // [m]
constexpr float kHaze = 900;        // distance at which 2/3 of the radiance is air [m]
constexpr float kShadowReach = 80;  // [m]
// Ambient occlusion under cars and benches: this fraction of the sky's light on the ground comes
// from the zenith, and is blocked by anything nearer than kCoverReach.
constexpr float kFromZenith = 0.6f, kCoverReach = 1.5f;
constexpr int kRayTile = 4;
constexpr int kBand = 16;  // image rows per batch, so that their rays stay in the cache
constexpr float kEdgeContrast = 0.1f;
constexpr size_t kEdgeBatch = 8192;  // [rays]

/// Positions of an edge pixel's four rays: a rotated grid, which gives nearly horizontal and
/// vertical edges four steps.
constexpr double kSamples[4][2] = {
    {-0.125, -0.375}, {0.375, -0.125}, {0.125, 0.375}, {-0.375, 0.125}};

float ambient(const Light& light, const Vec3& normal) {
  constexpr float kGround = 0.2f;
  const float up = 0.5f + 0.5f * normal.z();
  const float from_ground = kGround * (light.sky + 0.6f * light.sun * light.to_sun.z());
  return light.sky * up + from_ground * (1 - up);
}

}  // namespace

Camera::Camera(const CameraModel& model, const Textures& textures, uint64_t seed)
    : model_(model),
      textures_(textures),
      seed_(seed),
      K_inverse_(model.K.inverse()),
      pixel_angle_(static_cast<float>(1 / model.K(0, 0))),
      image_(static_cast<size_t>(model.width) * static_cast<size_t>(model.height)) {}

void Camera::add_ray(double column, double row, const Eigen::Matrix3f& R_world_cam) {
  const Eigen::Vector3d d = K_inverse_ * Eigen::Vector3d(column, row, 1);
  directions_.push_back((R_world_cam * d.cast<float>()).normalized());
}

void Camera::Incoming::add(size_t ray, const Vec3& point, float reflected) {
  rays.push_back(static_cast<uint32_t>(ray));
  points.push_back(point);
  radiance.push_back(reflected);
}

void Camera::receive(const Incoming& light, const Vec3& direction, float reach, RayCaster& scene) {
  obstructed_.resize(light.points.size());
  scene.obstructed(light.points, direction, reach, obstructed_);
  for (size_t k = 0; k < light.rays.size(); ++k)
    if (!obstructed_[k]) radiance_[light.rays[k]] += light.radiance[k];
}

void Camera::look(const Vec3& origin, const Light& light, RayCaster& scene) {
  constexpr float kPi = std::numbers::pi_v<float>;
  hits_.resize(directions_.size()), radiance_.resize(directions_.size());
  scene.cast(origin, directions_, kFar, hits_);
  from_sun_.clear(), from_zenith_.clear();
  const float haze = haze_radiance(light);
  for (size_t i = 0; i < directions_.size(); ++i) {
    const Hit& hit = hits_[i];
    const Vec3& d = directions_[i];
    if (hit.range < 0) {
      radiance_[i] = sky_radiance(light, d, textures_);
      continue;
    }
    const auto& t = hit.mesh->triangles[hit.triangle];
    const auto& v = hit.mesh->vertices;
    Vec3 normal = (v[t[1]] - v[t[0]]).cross(v[t[2]] - v[t[0]]).normalized();
    if (normal.dot(d) > 0) normal = -normal;
    const SurfacePoint point{
        &hit, origin + hit.range * d, normal,
        hit.range * pixel_angle_ / std::sqrt(std::max(hit.cos_incidence, 0.02f))};
    const Paint paint = paint_at(point, textures_);
    const Vec3 outside = point.position + 1e-3f * (1 + 0.1f * hit.range) * normal;
    const float clear = std::exp(-hit.range / kHaze), given_back = paint.albedo / kPi * clear;

    const float diffuse = given_back * ambient(light, normal);
    const bool on_ground = hit.surface.look == Look::kGround;
    radiance_[i] = (on_ground ? 1 - kFromZenith : 1) * diffuse + haze * (1 - clear);
    if (on_ground) from_zenith_.add(i, outside, kFromZenith * diffuse);
    if (paint.gloss > 0) {
      const float flat = 1 - hit.cos_incidence, grazing = flat * flat * flat * flat * flat;
      const Vec3 mirrored = d + 2 * hit.cos_incidence * normal;
      radiance_[i] +=
          clear * (paint.gloss + (1 - paint.gloss) * grazing) *
          (mirrored.z() > 0.1f ? sky_radiance(light, mirrored, textures_) : 0.5f * haze);
    }
    // Leaves transmit light, so their shaded side is bright, too.
    const float facing = normal.dot(light.to_sun);
    const float share =
        hit.surface.look == Look::kLeaves ? 0.25f + 0.5f * std::abs(facing) : std::max(facing, 0.f);
    if (share > 0) from_sun_.add(i, outside, given_back * light.sun * share);
  }
  receive(from_sun_, light.to_sun, kShadowReach, scene);
  receive(from_zenith_, Vec3::UnitZ(), kCoverReach, scene);
}

void Camera::smooth_edges(const Vec3& origin, const Eigen::Matrix3f& R_world_cam,
                          const Light& light, RayCaster& scene) {
  const auto width = static_cast<size_t>(model_.width), height = static_cast<size_t>(model_.height);
  const auto differ = [&](size_t a, size_t b) {
    return std::abs(image_[a] - image_[b]) > kEdgeContrast * (image_[a] + image_[b]);
  };
  pixels_.clear();
  for (size_t row = 0; row < height; ++row)
    for (size_t column = 0; column < width; ++column) {
      const size_t i = row * width + column;
      if ((column > 0 && differ(i, i - 1)) || (column + 1 < width && differ(i, i + 1)) ||
          (row > 0 && differ(i, i - width)) || (row + 1 < height && differ(i, i + width)))
        pixels_.push_back(static_cast<uint32_t>(i));
    }
  for (size_t first = 0; first < pixels_.size(); first += kEdgeBatch / 4) {
    const size_t last = std::min(first + kEdgeBatch / 4, pixels_.size());
    directions_.clear();
    for (size_t k = first; k < last; ++k) {
      const auto column = pixels_[k] % width, row = pixels_[k] / width;
      for (const auto& [right, down] : kSamples)
        add_ray(static_cast<double>(column) + right, static_cast<double>(row) + down, R_world_cam);
    }
    look(origin, light, scene);
    for (size_t k = first; k < last; ++k) {
      const float* const four = &radiance_[4 * (k - first)];
      image_[pixels_[k]] = (four[0] + four[1] + four[2] + four[3]) / 4;
    }
  }
}

GrayImage Camera::picture(int frame, const Pose& T_world_velo, const Light& light,
                          RayCaster& scene) {
  const Pose T_world_cam = T_world_velo * model_.T_velo_cam;
  const Vec3 origin = T_world_cam.translation().cast<float>();
  const Eigen::Matrix3f R_world_cam = T_world_cam.linear().cast<float>();
  for (int top = 0; top < model_.height; top += kBand) {
    directions_.clear(), pixels_.clear();
    const int bottom = std::min(top + kBand, model_.height);
    for (int tile_row = top; tile_row < bottom; tile_row += kRayTile)
      for (int tile_column = 0; tile_column < model_.width; tile_column += kRayTile)
        for (int row = tile_row; row < std::min(tile_row + kRayTile, bottom); ++row)
          for (int column = tile_column; column < std::min(tile_column + kRayTile, model_.width);
               ++column) {
            add_ray(column, row, R_world_cam);
            pixels_.push_back(static_cast<uint32_t>(row * model_.width + column));
          }
    look(origin, light, scene);
    for (size_t i = 0; i < pixels_.size(); ++i) image_[pixels_[i]] = radiance_[i];
  }
  smooth_edges(origin, R_world_cam, light, scene);
  return develop(image_, model_.width, model_.height, light.exposure_error,
                 random_bits(seed_, 0x66696c6d, static_cast<uint64_t>(frame)));
}

}  // namespace revisit::simulation
