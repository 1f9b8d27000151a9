// A second session. Localizes a robot globally in the maps of several floors, replaces the matched
// map entry with the new scan, and merges the maps into a new one.
//   two_sessions MERGED SCAN MAP...      # maps of loop_closure
// Maps of more than 128 distinct places need the same descriptor projection: call copy_projection()
// before adding the first entry.
#include <revisit/datasets/scan_file.h>
#include <revisit/maps/place_recognizer.h>
#include <revisit/recognition/ring/descriptor.h>
#include <revisit/registration/registration.h>

#include <cstdio>
#include <deque>
#include <stdexcept>
#include <vector>

using namespace revisit;

namespace {

void run(int argc, char** argv) {
  const RingModel model = shipped_ring_model("hdl64");
  const FeatureExtractor rings = ring_recognizer(model, ring_net(model), {});
  const RecognizerOptions options;
  const MapFingerprint identity = PlaceRecognizer::fingerprint_of(rings, options);
  const std::vector<std::filesystem::path> maps(argv + 3, argv + argc);
  {
    std::deque<PlaceRecognizer> floors;
    for (const auto& map : maps)
      floors.emplace_back(rings, options, open_map(map, MapAccess::kWrite, &identity));

    const PointCloud cloud = read_scan(argv[2]);
    const Description scan = floors.front().describe(view_of(cloud));
    std::optional<Loop> here;
    size_t floor = 0;
    for (size_t f = 0; f < floors.size(); ++f)
      if (const auto loop = floors[f].query(scan); loop && (!here || loop->score > here->score)) {
        here = loop;
        floor = f;
      }
    if (!here) throw std::runtime_error("no map has a place");
    std::printf("place %ld of %s, score %.3f: %s\n", static_cast<long>(here->id), argv[3 + floor],
                here->score, here->accepted ? "replaced" : "not sure enough to replace it");
    if (here->accepted) {
      floors[floor].remove(std::vector{here->index});
      floors[floor].add(scan,
                        {.drive = "today", .frame = here->frame, .cloud = compact_cloud(cloud)});
    }
  }  // the maps are closed
  const int64_t merged = merge_maps(maps, argv[1], [](const std::string& message) {
    std::fprintf(stderr, "%s\n", message.c_str());
  });
  std::printf("%ld places in %s\n", static_cast<long>(merged), argv[1]);
}

}  // namespace

int main(int argc, char** argv) {
  try {
    if (argc < 4) return std::puts("usage: two_sessions MERGED SCAN MAP..."), 2;
    return run(argc, argv), 0;
  } catch (const std::exception& error) {
    return std::fprintf(stderr, "two_sessions: %s\n", error.what()), 1;
  }
}
