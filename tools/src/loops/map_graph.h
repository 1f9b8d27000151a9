#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <vector>

#include "pose_graph.h"
#include "revisit/maps/map_store.h"

namespace revisit::cli {

/// Pose graph of all drives of a map, in the world of the first drive's poses.
struct MapGraph {
  std::vector<MapEntry> entries;  // with poses, by id; without descriptors
  std::vector<PoseEdge> edges;    // odometry of each drive, and accepted loops; indices of entries
  int64_t loops = 0;
};

/// Relates the worlds of drives by the loops between them, places entries without poses by their
/// loops, and optimizes all. Warns of corrupt entries, of those that nothing places, and of drives
/// that no loop relates to the first.
MapGraph graph_of(const MapStore& map);

/// Writes the points of all entries as binary PLY, the mean of each voxel with the edge `voxel`
/// [m], without things that moved (standing_points()). Returns the number of points.
int64_t write_site_cloud(const std::filesystem::path& file, const MapStore& map,
                         const MapGraph& graph, double voxel,
                         const std::function<void(int64_t done, int64_t total)>& progress);

}  // namespace revisit::cli
