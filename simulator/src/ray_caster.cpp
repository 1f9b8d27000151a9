#include "ray_caster.h"

#if __has_include(<embree4/rtcore.h>)
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

#include <algorithm>
#include <cmath>
#include <new>

#include "revisit/base/error.h"

namespace revisit::simulation {
namespace {

constexpr unsigned kPacket = 16;
constexpr float kShortestRay = 0.05f;  // [m]

struct DeviceDeleter {
  void operator()(RTCDevice device) const { rtcReleaseDevice(device); }
};
struct SceneDeleter {
  void operator()(RTCScene scene) const { rtcReleaseScene(scene); }
};
using Device = std::unique_ptr<std::remove_pointer_t<RTCDevice>, DeviceDeleter>;
using SceneHandle = std::unique_ptr<std::remove_pointer_t<RTCScene>, SceneDeleter>;

Device make_device() {
  Device device(rtcNewDevice("threads=1"));
  if (!device && rtcGetDeviceError(nullptr) == RTC_ERROR_OUT_OF_MEMORY) throw std::bad_alloc();
  if (!device) throw Error("Embree cannot start on this machine");
  return device;
}

void check(RTCDevice device) {
  switch (rtcGetDeviceError(device)) {
    case RTC_ERROR_NONE:
      return;
    case RTC_ERROR_OUT_OF_MEMORY:
      throw Error("the town does not fit in memory: simulate a shorter route");
    default:
      throw Error("Embree cannot build the scene");
  }
}

SceneHandle build(RTCDevice device, const Mesh& mesh, RTCBuildQuality quality) {
  SceneHandle scene(rtcNewScene(device));
  rtcSetSceneBuildQuality(scene.get(), quality);
  rtcSetSceneFlags(scene.get(), RTC_SCENE_FLAG_ROBUST);
  if (!mesh.triangles.empty()) {
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    // Copies, because Embree requires a padded vertex buffer.
    void* vertices = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                             sizeof(Mesh::Vec), mesh.vertices.size());
    void* triangles = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                              3 * sizeof(uint32_t), mesh.triangles.size());
    if (vertices && triangles) {
      std::copy(mesh.vertices.begin(), mesh.vertices.end(), static_cast<Mesh::Vec*>(vertices));
      std::copy(mesh.triangles.begin(), mesh.triangles.end(),
                static_cast<std::array<uint32_t, 3>*>(triangles));
      rtcCommitGeometry(geometry);
      rtcAttachGeometry(scene.get(), geometry);
    }
    rtcReleaseGeometry(geometry);
  }
  rtcCommitScene(scene.get());
  check(device);
  return scene;
}

#if RTC_VERSION_MAJOR == 3
void intersect(const int* valid, RTCScene scene, RTCRayHit16* packet) {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  rtcIntersect16(valid, scene, &context, packet);
}
void occlude(const int* valid, RTCScene scene, RTCRay16* packet) {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  rtcOccluded16(valid, scene, &context, packet);
}
#else
void intersect(const int* valid, RTCScene scene, RTCRayHit16* packet) {
  RTCIntersectArguments arguments;
  rtcInitIntersectArguments(&arguments);
  arguments.flags = RTC_RAY_QUERY_FLAG_COHERENT;
  rtcIntersect16(valid, scene, packet, &arguments);
}
void occlude(const int* valid, RTCScene scene, RTCRay16* packet) {
  RTCOccludedArguments arguments;
  rtcInitOccludedArguments(&arguments);
  arguments.flags = RTC_RAY_QUERY_FLAG_COHERENT;
  rtcOccluded16(valid, scene, packet, &arguments);
}
#endif

void set_ray(const Eigen::Vector3f& origin, const Eigen::Vector3f& direction, float max_range,
             unsigned k, RTCRay16* rays) {
  rays->org_x[k] = origin.x(), rays->org_y[k] = origin.y(), rays->org_z[k] = origin.z();
  rays->dir_x[k] = direction.x(), rays->dir_y[k] = direction.y(), rays->dir_z[k] = direction.z();
  rays->tnear[k] = kShortestRay, rays->tfar[k] = max_range;
  rays->time[k] = 0, rays->mask[k] = ~0u, rays->flags[k] = 0, rays->id[k] = k;
}

}  // namespace

struct Scene::Impl {
  Device device = make_device();
  Mesh mesh;
  SceneHandle scene;
};

Scene::Scene(Mesh mesh) : impl_(std::make_unique<Impl>()) {
  impl_->mesh = std::move(mesh);
  impl_->scene = build(impl_->device.get(), impl_->mesh, RTC_BUILD_QUALITY_MEDIUM);
}
Scene::~Scene() = default;
const Mesh& Scene::mesh() const {
  return impl_->mesh;
}

struct RayCaster::Impl {
  const Scene& still;
  Mesh moving;
  SceneHandle moving_scene;
};

RayCaster::RayCaster(const Scene& scene) : impl_(new Impl{scene, {}, {}}) {}
RayCaster::~RayCaster() = default;

void RayCaster::place(Mesh moving) {
  impl_->moving = std::move(moving);
  impl_->moving_scene =
      impl_->moving.triangles.empty()
          ? nullptr
          : build(impl_->still.impl_->device.get(), impl_->moving, RTC_BUILD_QUALITY_LOW);
}

void RayCaster::cast(std::span<const Eigen::Vector3f> origins,
                     std::span<const Eigen::Vector3f> directions, float max_range,
                     std::span<Hit> hits) {
  const Scene::Impl& still = *impl_->still.impl_;
  alignas(64) RTCRayHit16 packet;
  alignas(64) int valid[kPacket];
  for (size_t first = 0; first < directions.size(); first += kPacket) {
    const auto count = static_cast<unsigned>(std::min<size_t>(kPacket, directions.size() - first));
    for (unsigned k = 0; k < kPacket; ++k) {
      valid[k] = k < count ? -1 : 0;
      const size_t i = first + std::min(k, count - 1);
      set_ray(origins[origins.size() == 1 ? 0 : i], directions[i], max_range, k, &packet.ray);
      packet.hit.geomID[k] = RTC_INVALID_GEOMETRY_ID;
    }
    const auto take_hits = [&](const Mesh& mesh) {
      for (unsigned k = 0; k < count; ++k) {
        if (packet.hit.geomID[k] == RTC_INVALID_GEOMETRY_ID) continue;
        const Eigen::Vector3f n(packet.hit.Ng_x[k], packet.hit.Ng_y[k], packet.hit.Ng_z[k]);
        hits[first + k] = {packet.ray.tfar[k],
                           std::abs(n.normalized().dot(directions[first + k])),
                           mesh.surfaces[packet.hit.primID[k]],
                           &mesh,
                           packet.hit.primID[k],
                           packet.hit.u[k],
                           packet.hit.v[k]};
        packet.hit.geomID[k] = RTC_INVALID_GEOMETRY_ID;  // tfar stays, so only nearer hits count
      }
    };
    std::fill_n(hits.begin() + static_cast<std::ptrdiff_t>(first), count, Hit{});
    intersect(valid, still.scene.get(), &packet);
    take_hits(still.mesh);
    if (!impl_->moving_scene) continue;
    intersect(valid, impl_->moving_scene.get(), &packet);
    take_hits(impl_->moving);
  }
}

void RayCaster::obstructed(std::span<const Eigen::Vector3f> origins,
                           const Eigen::Vector3f& direction, float max_range,
                           std::span<uint8_t> result) {
  alignas(64) RTCRay16 packet;
  alignas(64) int valid[kPacket];
  for (size_t first = 0; first < origins.size(); first += kPacket) {
    const auto count = static_cast<unsigned>(std::min<size_t>(kPacket, origins.size() - first));
    for (unsigned k = 0; k < kPacket; ++k) {
      valid[k] = k < count ? -1 : 0;
      set_ray(origins[first + std::min(k, count - 1)], direction, max_range, k, &packet);
    }
    // Embree sets tfar = -infinity for occluded rays.
    occlude(valid, impl_->still.impl_->scene.get(), &packet);
    if (impl_->moving_scene) {
      for (unsigned k = 0; k < count; ++k) valid[k] = packet.tfar[k] < 0 ? 0 : -1;
      occlude(valid, impl_->moving_scene.get(), &packet);
    }
    for (unsigned k = 0; k < count; ++k) result[first + k] = packet.tfar[k] < 0;
  }
}

}  // namespace revisit::simulation
