#pragma once

#include <memory>

#include "revisit/recognition/place_index.h"

/// Candidates for PlaceIndex::choose_by() in maps too large to compare every place, by FAISS, of
/// descriptors compared by cosine. Both sources know the places in `index` by their keys, which are
/// descriptors at unit length, and take new ones. They throw UsageError for an index without places
/// or with another comparison, for bad options, and in a program built without FAISS.
namespace revisit::pipeline {

/// A graph from place to similar place (HNSW), keys in half precision.
struct GraphOptions {
  int links = 16;           // of a place; twice as many in the lowest layer
  int build_effort = 80;    // places that adding one looks for
  int search_effort = 160;  // places that a query keeps in view; at least those asked for
  int threads = 1;          // to build it; the graph depends on them
};
std::unique_ptr<CandidateSource> graph_of_keys(const PlaceIndex& index,
                                               const GraphOptions& options = {});

/// Lists of neighbours, keys by product quantisation (IVF-PQ): the smallest. The lists and codes
/// are learnt from the places in `index`; 256 of them are the least.
struct ListOptions {
  int lists = 0;             // 0: the root of the number of places
  int probes = 128;          // lists that a query looks at; all when there are fewer
  int numbers_per_byte = 4;  // of a key, in its code
  int threads = 1;           // to build it
};
std::unique_ptr<CandidateSource> lists_of_keys(const PlaceIndex& index,
                                               const ListOptions& options = {});

}  // namespace revisit::pipeline
