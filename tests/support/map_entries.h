#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "revisit/maps/map_store.h"

namespace revisit::test {

inline const MapFingerprint kFingerprint{
    {"feature", "numbers"}, {"weights", "sha256 0123"}, {"image", "1024x64"}};

/// Creates it if missing. `map`: a file, or the address of a map on a server.
inline std::unique_ptr<MapStore> writer_of(const std::filesystem::path& map,
                                           DescriptorType format = DescriptorType::kFloat32) {
  return open_map(map, MapAccess::kWrite, &kFingerprint, format);
}

inline std::unique_ptr<MapStore> reader_of(const std::filesystem::path& map) {
  return open_map(map, MapAccess::kRead);
}

/// Appends messages.
inline MapStore::Warn into(std::vector<std::string>& messages) {
  return [&messages](const std::string& message) { messages.push_back(message); };
}

struct ReadMap {
  std::vector<MapEntry> entries;
  std::vector<std::string> problems;
  MapState state;
};

inline ReadMap read_all(const MapStore& map, int64_t after = 0) {
  ReadMap read;
  read.state = map.read(
      after, [&](MapEntry&& entry) { read.entries.push_back(std::move(entry)); },
      [&](const std::string& problem) { read.problems.push_back(problem); });
  return read;
}

inline bool has_updates_soon(MapStore& map) {
  for (int tries = 0; tries < 20'000; ++tries) {
    if (map.has_updates()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return false;
}

/// Ignores the id.
inline bool same(const MapEntry& a, const MapEntry& b) {
  return a.drive == b.drive && a.frame == b.frame && a.time == b.time &&
         a.pose.has_value() == b.pose.has_value() &&
         (!a.pose || a.pose->matrix() == b.pose->matrix()) && a.descriptor == b.descriptor &&
         a.feature == b.feature && a.questioned == b.questioned &&
         std::ranges::equal(a.loops, b.loops, [](const MapLoop& one, const MapLoop& other) {
           return one.place == other.place && one.information == other.information &&
                  one.T_place_query.matrix() == other.T_place_query.matrix();
         });
}

/// Descriptors are exact in float16, too, features in bfloat16.
inline MapEntry made_entry(const std::string& drive, int64_t frame) {
  MapEntry entry;
  entry.drive = drive;
  entry.frame = frame;
  if (frame % 2 == 0) entry.time = 1.6e9 + 0.1 * static_cast<double>(frame);
  if (frame % 4 != 0) {
    entry.pose = Eigen::Isometry3d(
        Eigen::AngleAxisd(0.1 * static_cast<double>(frame), Eigen::Vector3d(1, 2, 3).normalized()));
    entry.pose->translation() = Eigen::Vector3d(static_cast<double>(frame), -1.0 / 3, 1e-300);
  }
  for (int64_t i = 0; i < 100; ++i)
    entry.descriptor.push_back(static_cast<float>((frame * 37 + i) % 512 - 256) / 64);
  if (frame % 5 == 0)
    entry.feature = {-0.25F, std::ldexp(3.0F, static_cast<int>(frame % 60)), 0x1p100F};
  if (frame % 6 == 0) {
    Eigen::Matrix<double, 6, 6> information = Eigen::Matrix<double, 6, 6>::Constant(1.0 / 3);
    information(2, 5) = information(5, 2) = static_cast<double>(frame);
    entry.loops.assign(
        2, {frame - 5, entry.pose.value_or(Eigen::Isometry3d::Identity()), information});
  }
  if (frame % 9 == 0) entry.questioned = {frame - 8, frame - 5};
  if (frame % 7 == 0) entry.cloud = "points of " + std::to_string(frame);
  return entry;
}

/// Entries of drive "x" whose frames are equal to their ids.
inline std::vector<MapEntry> made_entries(int64_t first, int64_t last) {
  std::vector<MapEntry> entries;
  for (int64_t id = first; id <= last; ++id) entries.push_back(made_entry("x", id));
  return entries;
}

/// Expects entries 1 to `n` without the removed ones, equal to made_entries().
inline void expect_entries(const MapStore& map, int64_t n, const std::set<int64_t>& removed = {}) {
  const ReadMap read = read_all(map);
  EXPECT_EQ(read.problems, std::vector<std::string>());
  EXPECT_EQ(read.state.last, n);
  EXPECT_EQ(read.state.removed, static_cast<int64_t>(removed.size()));
  EXPECT_EQ(map.size(), n - static_cast<int64_t>(removed.size()));
  size_t i = 0;
  for (int64_t id = 1; id <= n; ++id) {
    if (removed.contains(id)) continue;
    ASSERT_LT(i, read.entries.size());
    ASSERT_EQ(read.entries[i].id, id);
    EXPECT_TRUE(same(read.entries[i], made_entry("x", id))) << id;
    ++i;
  }
  EXPECT_EQ(i, read.entries.size());
}

}  // namespace revisit::test
