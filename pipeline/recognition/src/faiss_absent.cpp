#include "revisit/recognition/optional_library.h"
#include "revisit/recognition/place_index.h"

namespace revisit {

std::unique_ptr<CandidateSource> make_hnsw_source(const PlaceIndex&, int) {
  built_without("candidates of a large map", "FAISS");
}

}  // namespace revisit
