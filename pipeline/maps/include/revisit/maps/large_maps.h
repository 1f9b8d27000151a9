#pragma once

#include <memory>

#include "revisit/recognition/place_index.h"

namespace revisit::pipeline {

/// Candidates for PlaceIndex::choose_by() in maps too large to compare every place: a graph from
/// place to similar place (HNSW, by FAISS), of descriptors compared by cosine, in half precision.
/// It knows the places in `index` and takes new ones. `threads` build it, and it depends on them.
/// Throws UsageError for an index without places or with another comparison, and in a program built
/// without FAISS.
std::unique_ptr<CandidateSource> graph_of_keys(const PlaceIndex& index, int threads = 1);

}  // namespace revisit::pipeline
