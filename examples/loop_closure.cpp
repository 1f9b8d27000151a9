// Loop closure front end: describes every scan, queries a map, registers the matches, and adds the
// scan to the map, which persists.
//   loop_closure MAP SCAN...      # in the order they were taken
#include <revisit/datasets/scan_file.h>
#include <revisit/loops/loop_detector.h>

#include <cstdio>
#include <exception>

int main(int argc, char** argv) try {
  using namespace revisit;
  if (argc < 3) return std::puts("usage: loop_closure MAP SCAN..."), 2;
  LoopDetector detector({.map = argv[1]});  // target precision 0.99
  for (int i = 2; i < argc; ++i) {
    const PointCloud cloud = read_scan(argv[i]);  // or PointsView{message.data.data(), n, step}
    const Detection found = detector.take(view_of(cloud), {.frame = i - 2});
    if (!found.error.empty()) std::printf("%s: %s\n", argv[i], found.error.c_str());
    for (const int64_t frame : found.questioned)  // remove its edge from the pose graph
      std::printf("later loops contradict that of %s\n", argv[frame + 2]);
    if (!found.accepted) continue;
    std::printf("%s matches entry %ld, score %.3f, relative yaw %.1f degrees\n", argv[i],
                static_cast<long>(found.loop->id), found.loop->score,
                *found.loop->relative_yaw * 57.2958);
    // A pose graph gets an edge, with its information matrix.
    const Eigen::Vector3d t = found.registered->T_place_query.translation();
    std::printf("  %.2f m ahead of it, %.2f m to its left\n", t.x(), t.y());
  }
  std::printf("%ld map entries\n", static_cast<long>(detector.map().size()));
} catch (const std::exception& error) {
  return std::fprintf(stderr, "loop_closure: %s\n", error.what()), 1;
}
