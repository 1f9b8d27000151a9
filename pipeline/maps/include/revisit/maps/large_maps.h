#pragma once

#include <memory>

#include "revisit/recognition/place_index.h"

namespace revisit::pipeline {

/// Candidate source for PlaceIndex::set_candidate_source() in maps too large for exhaustive search:
/// an HNSW graph (FAISS) over half-precision descriptors, compared by cosine. Contains the entries
/// of `index`; later entries are added to it. The graph is built by `threads` threads and depends
/// on their number. Throws UsageError if the index is empty or has another comparison, or in a
/// build without FAISS.
std::unique_ptr<CandidateSource> make_hnsw_source(const PlaceIndex& index, int threads = 1);

}  // namespace revisit::pipeline
