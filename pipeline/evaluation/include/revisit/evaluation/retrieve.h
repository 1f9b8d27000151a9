#pragma once

#include <vector>

#include "revisit/evaluation/descriptors.h"
#include "revisit/evaluation/protocols.h"
#include "revisit/recognition/place_index.h"

namespace revisit {

/// Alignment cases in which queries are described; stored scans always use case 1.
enum class QueryCase { kAsStored, kTwo, kBoth };

/// Retrieves the k most similar stored scans for every query of `task`. With both cases the higher
/// score wins, case 1 on a tie. Candidates that compact codes exclude have similarity -1.
///
/// Throws UsageError for k or threads < 1, Error if shapes do not match or a descriptor or
/// similarity is not finite, and Interrupted.
std::vector<Match> retrieve(const Descriptors& descriptors, const Task& task,
                            const SearchOptions& options = {},
                            QueryCase query_case = QueryCase::kAsStored);

}  // namespace revisit
