#include "fabmap.h"
#include "fuzz.h"
#include "revisit/datasets/scan_file.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace revisit;
  const fuzz::InputFile file(fuzz::text(data, size), ".png");
  fuzz::works_or_refuses([&] {
    const GrayImage image = read_gray_png(file.path());
    fuzz::require(image.pixels.size() == static_cast<size_t>(image.width) * image.height,
                  "an image has its pixels");
    if (image.pixels.size() <= 100'000) sift_descriptors(image);
  });
  return 0;
}
