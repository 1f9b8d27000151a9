#include <algorithm>
#include <map>
#include <memory>

#include "cli/terminal.h"
#include "map_graph.h"
#include "revisit/base/error.h"
#include "revisit/base/files.h"
#include "revisit/registration/free_space.h"
#include "voxel_means.h"

namespace revisit::cli {
namespace {

struct SiteScan {
  PointCloud cloud;  // x forward, y left, z up
  FreeSpace space;
  Eigen::Isometry3d T_world_points;
};

/// Scans of entries. Recent ones stay in memory, because those nearby need them, too.
class SiteScans {
 public:
  SiteScans(const MapStore& map, const MapGraph& graph) : map_(map), graph_(graph) {}

  /// Null without readable points.
  std::shared_ptr<const SiteScan> at(size_t index) {
    constexpr size_t kMost = 300;  // some 0.7 MB each
    if (const auto found = known_.find(index); found != known_.end()) return found->second;
    if (known_.size() >= kMost) known_.clear();
    return known_[index] = read(graph_.entries[index]);
  }

 private:
  std::shared_ptr<const SiteScan> read(const MapEntry& entry) const try {
    const std::string bytes = map_.cloud(entry.id);
    if (bytes.empty()) return nullptr;
    auto [cloud, mount] = expand_cloud(bytes);
    const FreeSpace space(cloud, PreparedScan(cloud));
    return std::make_shared<SiteScan>(
        SiteScan{std::move(cloud), space, *entry.pose * mount.inverse()});
  } catch (const InputError& error) {
    warn(str("entry ", entry.id, ": ", error.what()));
    return nullptr;
  }

  const MapStore& map_;
  const MapGraph& graph_;
  std::map<size_t, std::shared_ptr<const SiteScan>> known_;
};

/// Entries that may have seen what an entry saw: of those within 40 m, some at other times.
std::vector<size_t> entries_near(const MapGraph& graph, size_t index) {
  constexpr double kNearby = 40;  // [m]
  constexpr size_t kMost = 16;
  const Eigen::Vector3d here = graph.entries[index].pose->translation();
  std::vector<size_t> nearby, chosen;
  for (size_t i = 0; i < graph.entries.size(); ++i)
    if (i != index && (graph.entries[i].pose->translation() - here).norm() < kNearby)
      nearby.push_back(i);
  const size_t n = std::min(kMost, nearby.size());
  for (size_t i = 0; i < n; ++i) chosen.push_back(nearby[(2 * i + 1) * nearby.size() / (2 * n)]);
  return chosen;
}

}  // namespace

int64_t write_site_cloud(const std::filesystem::path& file, const MapStore& map,
                         const MapGraph& graph, double voxel,
                         const std::function<void(int64_t done, int64_t total)>& progress) {
  check_target(file);
  SiteScans scans(map, graph);
  VoxelMeans means(voxel);
  for (size_t i = 0; i < graph.entries.size(); ++i) {
    if (interrupted()) throw Interrupted("interrupted; ", file.string(), " is not written");
    const auto scan = scans.at(i);
    progress(static_cast<int64_t>(i) + 1, std::ssize(graph.entries));
    if (!scan) continue;
    std::vector<PlacedSpace> others;
    for (const size_t index : entries_near(graph, i))
      if (const auto other = scans.at(index))
        others.emplace_back(other->space, other->T_world_points.inverse() * scan->T_world_points);
    for (const Point& p : standing_points(scan->cloud, scan->space, others).points)
      means.add(scan->T_world_points * Eigen::Vector3d(p.x, p.y, p.z));
  }
  const std::vector<Eigen::Vector3d> points = means.points();
  write_atomically(file, [&](std::ostream& out) {
    out << "ply\nformat binary_little_endian 1.0\nelement vertex " << points.size()
        << "\nproperty double x\nproperty double y\nproperty double z\nend_header\n";
    out.write(reinterpret_cast<const char*>(points.data()),
              static_cast<std::streamsize>(points.size() * sizeof(Eigen::Vector3d)));
  });
  return std::ssize(points);
}

}  // namespace revisit::cli
