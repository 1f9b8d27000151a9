#include <bit>

#include "revisit/base/error.h"
#include "revisit/base/hash.h"
#include "revisit/loops/loop_detector.h"

namespace revisit {
namespace {

/// Lower than 1, because descriptors may be stored as float16; scans of a standing sensor are less
/// similar.
constexpr double kSameScan = 0.9999;
constexpr double kSameTime = 0.8;  // for scans with equal times, which may differ in deskewing
constexpr int64_t kMinAllowedGap = 100;  // [frames]

/// Hash of the points: equal on all machines, unlike the feature, which depends on the CPU.
std::string content_of(const PointsView& points) {
  PointCloud cloud;
  copy_points(points, cloud);
  uint64_t hash = kFnv1aStart;
  for (const Point& p : cloud.points)
    for (const float value : {p.x, p.y, p.z}) hash = fnv1a(hash, std::bit_cast<uint32_t>(value));
  return str(hash);
}

}  // namespace

bool is_same_scan(const Map& map, const Description& scan, std::optional<double> time,
                  int64_t index) {
  const bool same_time = time && *time != 0 && time == map.entry(index).time;
  return map.similarity(scan, index) >= (same_time ? kSameTime : kSameScan);
}

bool may_belong_to(const DriveEntries& entries, int64_t frame) {
  const int64_t first = entries.begin()->first, last = entries.rbegin()->first;
  const int64_t gap = std::max(last - first, kMinAllowedGap);
  return frame >= first - gap && frame <= last + gap;
}

std::string drive_in_map(Map& map, const std::string& name, const PointsView& first,
                         const std::function<bool(const DriveEntries&)>& is_it) {
  const std::string content = content_of(first);
  // merge_maps() names the second recording of a name MAP/NAME.
  for (const std::string& merged : map.drives())
    if (merged.ends_with("/" + name) && is_it(map.entries_of(merged))) return merged;
  std::string drive = name;
  for (int number = 2;; ++number) {
    const DriveEntries entries = map.entries_of(drive);
    bool is_free = false;
    if (entries.empty())
      map.use_store([&](MapStore& store) { is_free = store.reserve_drive(drive, content); });
    if (is_free || (!entries.empty() && is_it(entries))) return drive;
    drive = str(name, "-", number);
  }
}

}  // namespace revisit
