// A loop-closure front end: every scan is described, asked for, registered with what it looks like,
// and added to a map that outlives the program.
//   loop_closure MAP SCAN...      # scans of an HDL-64E in the order they were taken
#include <revisit/datasets/scan_file.h>
#include <revisit/maps/place_recognizer.h>
#include <revisit/recognition/ring/features.h>
#include <revisit/registration/registration.h>

#include <algorithm>
#include <cstdio>
#include <exception>
#include <map>

using namespace revisit::pipeline;

namespace {

constexpr int64_t kSameMoment = 50;  // scans before this one that are not asked

void run(int argc, char** argv) {
  const RingModel model = shipped_ring_model("hdl64");
  const FeatureExtractor rings = ring_recogniser(model, ring_net(model), {});
  const RecognizerOptions options;  // what is accepted is right in 99 of 100 cases
  const MapIdentity identity = PlaceRecognizer::identity_of(rings, options);
  PlaceRecognizer recognizer(rings, options, open_map(argv[1], MapAccess::kWrite, &identity));

  std::map<int64_t, PointCloud> scans;  // of this drive, by position
  for (int i = 2; i < argc; ++i) {
    PointCloud cloud = read_scan(argv[i]);  // or PointsView{message.data.data(), n, point_step}
    const Description scan = recognizer.describe(view_of(cloud));
    if (!scan.described()) {
      std::printf("%s: %s\n", argv[i], scan.why_not.c_str());
      continue;
    }
    std::vector<int64_t> recent;
    for (int64_t p = std::max(int64_t{0}, recognizer.size() - kSameMoment); p < recognizer.size();
         ++p)
      recent.push_back(p);
    if (const auto loop = recognizer.query(scan, recent); loop && loop->accepted) {
      std::printf("%s is place %ld, score %.3f, turned by %.1f degrees\n", argv[i],
                  static_cast<long>(loop->id), loop->score, *loop->turn * 57.2958);
      if (const auto there = scans.find(loop->position); there != scans.end()) {
        const Registration r =
            register_scans(PreparedScan(cloud), PreparedScan(there->second), *loop->turn);
        const Eigen::Vector3d t = r.T_place_query.translation();
        if (r.accepted)  // an edge of the pose graph, with r.information
          std::printf("  %.2f m ahead of it, %.2f m to its left\n", t.x(), t.y());
      }
    }
    scans.emplace(recognizer.add(scan, {.frame = i - 2}), std::move(cloud));
  }
  std::printf("%ld places known\n", static_cast<long>(recognizer.size()));
}

}  // namespace

int main(int argc, char** argv) {
  try {
    if (argc < 3) return std::puts("usage: loop_closure MAP SCAN..."), 2;
    return run(argc, argv), 0;
  } catch (const std::exception& error) {
    return std::fprintf(stderr, "loop_closure: %s\n", error.what()), 1;
  }
}
