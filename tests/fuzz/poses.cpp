#include "fuzz.h"
#include "revisit/evaluation/ground_truth.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace revisit;
  const fuzz::InputFile file(fuzz::text(data, size));
  fuzz::works_or_refuses([&] {
    const auto trajectory = make_trajectory(read_kitti_poses(file.path()));
    find_loops(trajectory, {}, {Exclusion::Kind::kMeters, 10});
  });
  return 0;
}
