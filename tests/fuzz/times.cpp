#include "fuzz.h"
#include "revisit/datasets/dataset.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace revisit;
  const fuzz::InputFile file(fuzz::text(data, size));
  fuzz::works_or_refuses([&] { read_kitti_times(file.path()); });
  return 0;
}
