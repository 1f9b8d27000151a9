// A NumPy array, by the reader of both proto (whole) and pipeline (rows, memory-mapped).
#include "revisit/proto/npy.h"

#include <cstring>

#include "fuzz.h"
#ifdef REVISIT_HAVE_PIPELINE
#include "revisit/recognition/feature_file.h"
#endif

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace revisit;
  const fuzz::InputFile file(fuzz::text(data, size));
  fuzz::works_or_refuses([&] {
    const proto::Blob array = proto::read_npy(file.path());
    uint64_t count = 1;
    for (const int64_t axis : array.shape) count *= static_cast<uint64_t>(axis);
    fuzz::require(count == array.data.size(), "as many values as the shape says");
  });
#ifdef REVISIT_HAVE_PIPELINE
  fuzz::works_or_refuses([&] {
    const FeatureFile features(file.path());
    for (int64_t i = 0; features.d() > 0 && i < features.n(); ++i) {
      std::vector<float> read(static_cast<size_t>(features.d()));
      features.read(i, 0, features.d(), read.data());
      const auto mapped = features.row(i);
      fuzz::require(std::memcmp(read.data(), mapped.data(), mapped.size_bytes()) == 0,
                    "a row is the same mapped and read");
    }
  });
#endif
  return 0;
}
