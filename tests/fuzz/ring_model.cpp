// Content of a ring model's file with a valid checksum, because a wrong one hides all other faults.
#include <ring_model.pb.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "fuzz.h"
#include "revisit/base/hash.h"
#include "revisit/recognition/ring/descriptor.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace revisit;
  ring::File file;
  file.set_version(2);
  file.set_model(fuzz::text(data, size));
  uint64_t checksum = kFnv1aStart;
  for (size_t i = 0; i < size; ++i) checksum = fnv1a(checksum, data[i]);
  file.set_checksum(checksum);
  fuzz::works_or_refuses([&] {
    const RingModel model = parse_ring_model(file.SerializeAsString(), "<case>");
    const Projection projection = ring_projection(model, {.dim = 64});
    fuzz::require(projection.dim <= 64, "at most the dimensions asked for");
    // As the basis of a map, it describes that map's scans.
    const std::vector<float> rings(static_cast<size_t>(model.dim()), 0.5F);
    std::vector<float> descriptor(static_cast<size_t>(projection.dim));
    projection.describe(rings, descriptor);
    fuzz::require(std::ranges::all_of(descriptor, [](float v) { return std::isfinite(v); }),
                  "descriptors are finite");
    const double similarity = projection.comparison.similarity_of(descriptor, descriptor);
    fuzz::require(similarity >= -1.001 && similarity <= 1.001, "a similarity is a cosine");
  });
  return 0;
}
