#include "revisit/maps/large_maps.h"
#include "revisit/proto/error.h"

// Stands for faiss/*.cpp in a build without FAISS.

namespace revisit::pipeline {
namespace {

[[noreturn]] void fail() {
  throw UsageError(
      "candidates of a large map: this program was built without FAISS; install libfaiss-dev and "
      "build it with -DREVISIT_FAISS=ON");
}

}  // namespace

void need_faiss() {
  fail();
}

std::unique_ptr<CandidateSource> graph_of_keys(const PlaceIndex&, const GraphOptions&) {
  fail();
}

std::unique_ptr<CandidateSource> lists_of_keys(const PlaceIndex&, const ListOptions&) {
  fail();
}

}  // namespace revisit::pipeline
