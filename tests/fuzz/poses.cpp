#include "fuzz.h"
#include "revisit/evaluation/ground_truth.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace revisit;
  const fuzz::InputFile file(fuzz::text(data, size));
  fuzz::works_or_refuses([&] {
    const auto trajectory = pipeline::make_trajectory(pipeline::read_kitti_poses(file.path()));
    pipeline::find_loops(trajectory, {}, {pipeline::Exclusion::Kind::kMeters, 10});
  });
  return 0;
}
