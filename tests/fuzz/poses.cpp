#include "../support/trajectory.h"
#include "fuzz.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace revisit;
  const fuzz::InputFile file(fuzz::text(data, size));
  fuzz::works_or_refuses([&] {
    find_loops(trajectory_of(read_kitti_poses(file.path())), {}, {Exclusion::Kind::kMeters, 10});
  });
  return 0;
}
