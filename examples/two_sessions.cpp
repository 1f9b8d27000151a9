// A second session. Locates a robot in the maps of several floors, replaces the matched
// map entry with the new scan, and merges the maps into a new one.
//   two_sessions MERGED SCAN MAP...      # maps of loop_closure
// Maps of more than 128 distinct places need the same descriptor projection: call copy_projection()
// before adding the first entry.
#include <revisit/datasets/scan_file.h>
#include <revisit/loops/loop_detector.h>
#include <revisit/registration/registration.h>

#include <cstdio>
#include <deque>
#include <stdexcept>
#include <vector>

int main(int argc, char** argv) try {
  using namespace revisit;
  if (argc < 4) return std::puts("usage: two_sessions MERGED SCAN MAP..."), 2;
  const std::vector<std::filesystem::path> paths(argv + 3, argv + argc);
  {
    const PointCloud cloud = read_scan(argv[2]);
    std::deque<Map> floors;
    std::optional<Detection> here;
    size_t floor = 0;
    for (const auto& path : paths) {
      Map& map = floors.emplace_back(path);
      const Detection found = LoopDetector(map, {}).locate(view_of(cloud)).front();
      if (!found.loop || (here && found.loop->score <= here->loop->score)) continue;
      here = found;
      floor = floors.size() - 1;
    }
    if (!here) throw std::runtime_error("no map has a place");
    const Loop& loop = *here->loop;
    std::printf("place %ld of %s, score %.3f: %s\n", static_cast<long>(loop.id), argv[3 + floor],
                loop.score, here->accepted ? "replaced" : "not sure enough to replace it");
    if (here->accepted) {
      Map& map = floors[floor];
      map.remove(std::vector{loop.index});
      map.add({{.drive = "today",
                .frame = loop.frame,
                .feature = map.describe(view_of(cloud)).feature,
                .cloud = compact_cloud(cloud)}});
    }
  }  // the maps are closed
  const int64_t merged = merge_maps(paths, argv[1], [](const std::string& message) {
    std::fprintf(stderr, "%s\n", message.c_str());
  });
  std::printf("%ld places in %s\n", static_cast<long>(merged), argv[1]);
} catch (const std::exception& error) {
  return std::fprintf(stderr, "two_sessions: %s\n", error.what()), 1;
}
