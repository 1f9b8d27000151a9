#pragma once

#include <memory>

#include "revisit/recognition/place_index.h"

namespace revisit {

/// HNSW graph (FAISS) over half-precision descriptors of `index`, compared by cosine, for maps too
/// large for exhaustive search. Later entries are added to it. Built by `threads` threads; depends
/// on their number. Throws UsageError if the index is empty or has another comparison, or in a
/// build without FAISS.
std::unique_ptr<CandidateSource> make_hnsw_source(const PlaceIndex& index, int threads = 1);

}  // namespace revisit
