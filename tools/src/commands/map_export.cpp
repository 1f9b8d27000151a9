#include <algorithm>
#include <iostream>
#include <set>

#include "cli/built_in.h"
#include "cli/command.h"
#include "cli/terminal.h"
#include "loops/loop_outputs.h"
#include "loops/map_graph.h"
#include "revisit/base/text.h"
#include "revisit/maps/map_store.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

struct ExportOptions {
  fs::path map, cloud, g2o, tum;
  double voxel = 0.2;

  void declare(Options& options) {
    options.argument("MAP", &map)
        .option("cloud", "FILE", "points of all entries without moving things, as .ply", &cloud)
        .option("voxel", "METERS", str("edge of the voxels of --cloud (default ", voxel, ")"),
                &voxel)
        .at_least(0.01)
        .needs("cloud")
        .option("g2o", "FILE", "pose graph of all drives: poses, odometry and accepted loops", &g2o)
        .option("tum", "FILE", "optimized poses of all entries by time", &tum)
        .check([this] {
          need_built_in_for_map("revisit map export", map);
          if (cloud.empty() && g2o.empty() && tum.empty())
            throw UsageError("nothing to export: give --cloud, --g2o or --tum");
          if (!cloud.empty() && cloud.extension() != ".ply")
            throw UsageError("--cloud: expected a name that ends with .ply, found ",
                             cloud.string());
        });
  }
};

void write_g2o(const fs::path& file, const MapGraph& graph) {
  PoseGraphWriter out(file);
  for (const MapEntry& entry : graph.entries)
    out.known_vertex(entry.id, entry.pose, scan_name(entry.drive, entry.frame, entry.time));
  for (const PoseEdge& edge : graph.edges)
    out.edge(graph.entries[edge.from].id, graph.entries[edge.to].id, edge.T_from_to,
             edge.information);
}

void write_tum(const fs::path& file, const MapGraph& graph) {
  TrajectoryWriter out(file);
  const auto time_of = [](const MapEntry& entry) {
    return entry.time.value_or(static_cast<double>(entry.frame));
  };
  std::vector<const MapEntry*> entries;
  std::set<double> times;
  for (const MapEntry& entry : graph.entries) {
    entries.push_back(&entry);
    times.insert(time_of(entry));
  }
  if (times.size() < entries.size())
    warn(file.string() + ": drives have the same times, so its lines are not of one trajectory");
  std::ranges::stable_sort(entries, {}, [&](const MapEntry* entry) { return time_of(*entry); });
  for (const MapEntry* entry : entries) out.add(time_of(*entry), *entry->pose);
}

int export_map(ExportOptions& o) {
  const auto map = open_map(o.map, MapAccess::kRead);
  const MapGraph graph = graph_of(*map);
  if (graph.entries.empty())
    throw InputError(display_name(o.map),
                     ": no entry has a pose; build the map from scans with poses");
  std::set<std::string> drives;
  for (const MapEntry& entry : graph.entries) drives.insert(entry.drive);
  std::cout << display_name(o.map) << ": " << graph.entries.size() << " entries of "
            << plural(std::ssize(drives), "drive") << ", " << plural(graph.loops, "loop") << "\n";
  if (graph.loops == 0)
    note("the map has no accepted loops, so its poses are exported as they are");
  if (!o.g2o.empty()) write_g2o(o.g2o, graph);
  if (!o.tum.empty()) write_tum(o.tum, graph);
  if (o.cloud.empty()) return kOk;
  Progress progress("exporting", "entries");
  const int64_t points = write_site_cloud(o.cloud, *map, graph, o.voxel, progress.callback());
  if (points == 0)
    throw InputError(display_name(o.map), ": its entries have no readable points (--no-clouds)");
  std::cout << o.cloud.string() << ": " << plural(points, "point") << "\n";
  return kOk;
}

}  // namespace

Command map_export_command() {
  return {"export", "point cloud, pose graph and trajectory of all drives",
          "Exports a map of scans with poses. Accepted loops relate the drives and correct their "
          "drift: the poses are optimized in the world of the first drive.",
          "  revisit map export site.map --cloud site.ply\n"
          "  revisit map export site.map --g2o site.g2o --tum site.tum\n",
          with_options<ExportOptions>(export_map)};
}

}  // namespace revisit::cli
