#include "map_graph.h"

#include <algorithm>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>

#include "cli/terminal.h"
#include "revisit/base/error.h"
#include "revisit/base/text.h"

namespace revisit::cli {
namespace {

using Pose3d = Eigen::Isometry3d;

struct StoredLoop {
  size_t place, query;  // indices of entries
  const MapLoop* loop;
};

class GraphBuilder {
 public:
  explicit GraphBuilder(const MapStore& map) {
    map.read(
        0,
        [&](MapEntry&& entry) {
          std::vector<float>().swap(entry.descriptor);
          std::vector<float>().swap(entry.feature);
          index_[entry.id] = entries_.size();
          drives_[entry.drive][entry.frame] = entries_.size();
          entries_.push_back(std::move(entry));
        },
        warn);
    std::set<int64_t> questioned;
    for (const MapEntry& entry : entries_)
      questioned.insert(entry.questioned.begin(), entry.questioned.end());
    for (size_t i = 0; i < entries_.size(); ++i)
      for (const MapLoop& loop : entries_[i].loops)
        if (const auto place = index_.find(loop.place);
            place != index_.end() && !questioned.contains(entries_[i].id))
          loops_.push_back({place->second, i, &loop});
  }

  MapGraph build() {
    if (entries_.empty()) return {};
    MapGraph graph;
    add_odometry(graph);  // before poses change
    relate_drives();
    place_by_loops();
    for (const StoredLoop& one : loops_)
      graph.edges.push_back(
          {one.place, one.query, one.loop->T_place_query, one.loop->information, true});
    drop_without_pose(graph);
    graph.loops = std::ranges::count(graph.edges, true, &PoseEdge::is_loop);
    std::vector<Pose3d> poses;
    for (const MapEntry& entry : graph.entries) poses.push_back(*entry.pose);
    if (graph.loops > 0) optimize(graph.edges, poses);
    for (size_t i = 0; i < poses.size(); ++i) graph.entries[i].pose = poses[i];
    return graph;
  }

 private:
  void add_odometry(MapGraph& graph) const {
    for (const auto& [drive, by_frame] : drives_) {
      std::optional<size_t> before;
      for (const auto& [frame, i] : by_frame) {
        if (before && entries_[i].pose) {
          const Pose3d step = entries_[*before].pose->inverse() * *entries_[i].pose;
          graph.edges.push_back({*before, i, step, odometry_information(step), false});
        }
        before = entries_[i].pose ? std::optional(i) : std::nullopt;
      }
    }
  }

  /// T_related_drive by each loop between the drive and the related ones, with a pose of the drive.
  std::vector<std::pair<Pose3d, Pose3d>> relations_of(const std::string& drive,
                                                      const std::set<std::string>& related) const {
    std::vector<std::pair<Pose3d, Pose3d>> found;
    for (const auto& [place, query, loop] : loops_) {
      const MapEntry &a = entries_[place], &b = entries_[query];
      if (!a.pose || !b.pose) continue;
      if (b.drive == drive && related.contains(a.drive))
        found.emplace_back(*a.pose * loop->T_place_query * b.pose->inverse(), *b.pose);
      if (a.drive == drive && related.contains(b.drive))
        found.emplace_back(*b.pose * loop->T_place_query.inverse() * a.pose->inverse(), *a.pose);
    }
    return found;
  }

  /// The relation that agrees with most others within some meters.
  static Pose3d most_agreed(const std::vector<std::pair<Pose3d, Pose3d>>& relations) {
    constexpr double kAgreed = 3;  // [m]
    constexpr size_t kCompared = 100;
    const size_t stride = relations.size() / kCompared + 1;
    std::pair<int64_t, size_t> best(-1, 0);
    for (size_t i = 0; i < relations.size(); i += stride) {
      int64_t agreeing = 0;
      for (const auto& [T, pose] : relations)
        agreeing +=
            (relations[i].first * pose.translation() - T * pose.translation()).norm() < kAgreed ? 1
                                                                                                : 0;
      if (agreeing > best.first) best = {agreeing, i};
    }
    return relations[best.second].first;
  }

  void relate_drives() {
    std::set<std::string> related, rest;
    for (const auto& [drive, frames] : drives_) rest.insert(drive);
    related.insert(rest.extract(entries_.front().drive));
    while (!rest.empty()) {
      std::vector<std::pair<Pose3d, Pose3d>> most;
      std::string next;
      for (const std::string& drive : rest)
        if (auto relations = relations_of(drive, related); relations.size() > most.size())
          std::tie(most, next) = std::pair(std::move(relations), drive);
      if (most.empty()) break;
      const Pose3d T_related_drive = most_agreed(most);
      for (const auto& [frame, i] : drives_[next])
        if (entries_[i].pose) entries_[i].pose = T_related_drive * *entries_[i].pose;
      related.insert(rest.extract(next));
    }
    for (const std::string& drive : rest)
      if (std::ranges::any_of(drives_[drive], [&](const auto& one) {
            return entries_[one.second].pose.has_value();
          }))
        warn(str("drive '", drive, "': no loop relates it to drive '", entries_.front().drive,
                 "'; its poses are taken as of the same world"));
  }

  void place_by_loops() {
    for (bool changed = true; std::exchange(changed, false);)
      for (const auto& [place, query, loop] : loops_) {
        std::optional<Pose3d>&a = entries_[place].pose, &b = entries_[query].pose;
        if (a.has_value() == b.has_value()) continue;
        (a ? b : a) = a ? *a * loop->T_place_query : *b * loop->T_place_query.inverse();
        changed = true;
      }
  }

  void drop_without_pose(MapGraph& graph) {
    std::vector<size_t> positions(entries_.size());
    for (size_t i = 0; i < entries_.size(); ++i) {
      positions[i] = graph.entries.size();
      if (entries_[i].pose) graph.entries.push_back(entries_[i]);
    }
    std::erase_if(graph.edges, [&](const PoseEdge& edge) { return !entries_[edge.from].pose; });
    for (PoseEdge& edge : graph.edges) {
      edge.from = positions[edge.from];
      edge.to = positions[edge.to];
    }
    const size_t without = entries_.size() - graph.entries.size();
    if (without > 0)
      warn(
          str(without, " entries have neither a pose nor a loop to one that has, and are skipped"));
  }

  std::vector<MapEntry> entries_;
  std::map<int64_t, size_t> index_;                          // by id
  std::map<std::string, std::map<int64_t, size_t>> drives_;  // by frame
  std::vector<StoredLoop> loops_;
};

}  // namespace

MapGraph graph_of(const MapStore& map) {
  return GraphBuilder(map).build();
}

}  // namespace revisit::cli
