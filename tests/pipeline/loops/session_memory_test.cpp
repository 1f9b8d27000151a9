// REVISIT_MEMORY_SCANS=20000 measures a drive of 20,000 scans by rings.
#include <unistd.h>

#include "revisit/loops/loop_detector.h"
#include "revisit/recognition/place_index.h"
#include "revisit/recognition/ring/descriptor.h"
#include "testing.h"

namespace revisit {
namespace {

/// Cheap; equal for a scan and its repetition only.
FeatureExtractor hash_of_points() {
  FeatureExtractor extractor;
  extractor.name = extractor.key = "hash of points";
  extractor.dim = 16;
  extractor.make = []() -> FeatureFunction<PointCloud> {
    return [](const PointCloud& cloud, std::span<float> feature) {
      for (size_t i = 0; i < feature.size(); ++i) feature[i] = cloud.points[100 * i].x;
    };
  };
  extractor.comparison.relative_yaw = [](std::span<const float>, std::span<const float>) {
    return 0.0;
  };
  return extractor;
}

/// Every 25th scan is one of the first 200, so that it is registered.
PointCloud scan_of_drive(int64_t frame) {
  std::mt19937 random(static_cast<uint32_t>(frame % 25 == 24 ? frame % 200 : frame));
  const auto number = [&](float least, float most) {
    return least + (most - least) * static_cast<float>(random() % 65536) / 65536;
  };
  PointCloud cloud;
  for (int thing = 0; thing < 60; ++thing) {
    const float x = number(-50, 50), y = number(-50, 50), along = number(0.2F, 12),
                up = number(1, 8), heading = number(0, 6.28F);
    for (int i = 0; i < 150; ++i) {
      const float s = number(0, along);
      cloud.points.push_back(
          {x + s * std::cos(heading), y + s * std::sin(heading), number(-1.7F, up), 0});
    }
  }
  for (int i = 0; i < 6000; ++i)
    cloud.points.push_back({number(-40, 40), number(-40, 40), -1.73F, 0});
  return cloud;
}

int64_t resident_bytes() {
  std::ifstream statm("/proc/self/statm");
  int64_t size = 0, resident = 0;
  statm >> size >> resident;
  return resident * ::sysconf(_SC_PAGESIZE);
}

/// Returns resident memory [bytes] before each frame of `scans`, which ascend.
std::vector<int64_t> memory_at(const std::vector<int64_t>& scans, const FeatureExtractor& extractor,
                               std::unique_ptr<MapStore> map, int64_t& registered) {
  PlaceRecognizer recognizer(extractor, {.warmup = 200, .threshold = 1.1}, std::move(map));
  LoopDetector detector(recognizer, {.drive = "long", .verify = true});
  std::vector<int64_t> bytes;
  for (int64_t frame = 0; std::ssize(bytes) < std::ssize(scans); ++frame) {
    if (frame == scans[bytes.size()]) bytes.push_back(resident_bytes());
    const PointCloud cloud = scan_of_drive(frame);
    const Detection found = detector.take(view_of(cloud), {.frame = frame});
    registered += found.registered ? 1 : 0;
  }
  return bytes;
}

constexpr bool kFreedIsKept =
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
    true;
#else
    false;
#endif

TEST(SessionMemory, HasNoDescriptorsOfEntries) {
  if (kFreedIsKept) GTEST_SKIP() << "by sanitizers it is";
  constexpr int64_t kPlaces = 12'000;  // 48 MB
  const RingLayout layout{{500, 250}};
  PlaceIndex index(layout.dim(), ring_comparison(layout, 100));
  const std::vector<float> descriptor(static_cast<size_t>(layout.dim()), 0.01F);
  const int64_t before = resident_bytes();
  for (int64_t i = 0; i < kPlaces; ++i) index.add(descriptor);
  EXPECT_LT(resident_bytes() - before, 16'000'000);
}

/// Points of a entry are 10 kB and more. At 20,000 scans a entry takes 0.3 kB.
TEST(SessionMemory, HasNoPointsOfEntries) {
  if (kFreedIsKept) GTEST_SKIP() << "by sanitizers it is";
  const char* const given = std::getenv("REVISIT_MEMORY_SCANS");
  const RingModel model = shipped_ring_model("vlp16");
  const FeatureExtractor extractor =
      given != nullptr ? ring_recognizer(model, ring_net(model), {.candidates = 1000})
                       : hash_of_points();
  std::vector<int64_t> marks = {200, 600};
  const int64_t last = given != nullptr ? std::atoll(given) : 0;
  for (const int64_t mark : {1000, 2000, 5000, 10000, 20000})
    if (mark <= last) marks.push_back(mark);
  const TempDir dir;
  const MapFingerprint fingerprint = PlaceRecognizer::fingerprint_of(extractor, {});
  for (const bool with_map : {false, true}) {
    int64_t registered = 0;
    const std::vector<int64_t> bytes =
        memory_at(marks, extractor,
                  with_map ? open_map(dir / "long.map", MapAccess::kWrite, &fingerprint) : nullptr,
                  registered);
    EXPECT_GT(registered, 3);
    for (size_t i = 0; i < marks.size() && given != nullptr; ++i)
      std::printf("%s, %6ld scans: %.1f MB\n", with_map ? "map on disk" : "without map",
                  static_cast<long>(marks[i]), static_cast<double>(bytes[i]) / 1e6);
    const int64_t a_scan = (bytes.back() - bytes.front()) / (marks.back() - marks.front());
    EXPECT_LT(a_scan, last >= 10'000 ? 1000 : 6000) << (with_map ? "with a map" : "without a map");
  }
}

}  // namespace
}  // namespace revisit
