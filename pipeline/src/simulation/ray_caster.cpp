#include "simulation/ray_caster.h"

#include <embree3/rtcore.h>

#include <algorithm>
#include <cmath>

#include "revisit/proto/error.h"

namespace revisit::pipeline::simulation {
namespace {

constexpr unsigned kPacket = 16;
constexpr float kMinRange = 0.05f;  // [m]

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
    // Copies: Embree wants its vertex buffer padded.
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
};

RayCaster::RayCaster(const Scene& scene) : impl_(new Impl{scene}) {}
RayCaster::~RayCaster() = default;

void RayCaster::cast(const Mesh& moving, const Eigen::Vector3f& origin,
                     std::span<const Eigen::Vector3f> directions, float max_range,
                     std::span<Hit> hits) {
  const Scene::Impl& still = *impl_->still.impl_;
  const SceneHandle cars = build(still.device.get(), moving, RTC_BUILD_QUALITY_LOW);
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;

  alignas(64) RTCRayHit16 packet;
  alignas(64) int valid[kPacket];
  for (size_t first = 0; first < directions.size(); first += kPacket) {
    const auto count = static_cast<unsigned>(std::min<size_t>(kPacket, directions.size() - first));
    for (unsigned k = 0; k < kPacket; ++k) {
      valid[k] = k < count ? -1 : 0;
      const Eigen::Vector3f& d = directions[first + std::min(k, count - 1)];
      packet.ray.org_x[k] = origin.x(), packet.ray.org_y[k] = origin.y(),
      packet.ray.org_z[k] = origin.z();
      packet.ray.dir_x[k] = d.x(), packet.ray.dir_y[k] = d.y(), packet.ray.dir_z[k] = d.z();
      packet.ray.tnear[k] = kMinRange, packet.ray.tfar[k] = max_range;
      packet.ray.time[k] = 0, packet.ray.mask[k] = ~0u, packet.ray.flags[k] = 0,
      packet.ray.id[k] = k;
      packet.hit.geomID[k] = RTC_INVALID_GEOMETRY_ID;
    }
    rtcIntersect16(valid, still.scene.get(), &context, &packet);
    unsigned primitive[kPacket];
    for (unsigned k = 0; k < count; ++k) {
      const bool met = packet.hit.geomID[k] != RTC_INVALID_GEOMETRY_ID;
      primitive[k] = packet.hit.primID[k];
      hits[first + k] = Hit{};
      if (met) {
        hits[first + k].range = packet.ray.tfar[k];
        hits[first + k].surface = still.mesh.surfaces[primitive[k]];
      }
      packet.hit.geomID[k] = RTC_INVALID_GEOMETRY_ID;  // tfar stays: only a nearer car counts
    }
    if (!moving.triangles.empty()) rtcIntersect16(valid, cars.get(), &context, &packet);
    for (unsigned k = 0; k < count; ++k) {
      Hit& hit = hits[first + k];
      if (packet.hit.geomID[k] != RTC_INVALID_GEOMETRY_ID) {
        hit.range = packet.ray.tfar[k];
        hit.surface = moving.surfaces[packet.hit.primID[k]];
      }
      if (hit.range < 0) continue;
      const Eigen::Vector3f n(packet.hit.Ng_x[k], packet.hit.Ng_y[k], packet.hit.Ng_z[k]);
      hit.cos_incidence = std::abs(n.normalized().dot(directions[first + k]));
    }
  }
}

}  // namespace revisit::pipeline::simulation
