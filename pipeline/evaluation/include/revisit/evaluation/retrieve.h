#pragma once

#include <vector>

#include "revisit/evaluation/descriptors.h"
#include "revisit/evaluation/protocols.h"
#include "revisit/recognition/place_index.h"

namespace revisit::pipeline {

/// The alignment cases queries are described in; stored scans always use case 1.
enum class QueryCase { kAsStored, kTwo, kBoth };

/// The k most similar stored scans of every query of `task`. In both cases the higher score wins,
/// case 1 on a tie. Candidates that keys leave out have the similarity -1.
///
///   auto matches = retrieve(descriptors, task, {.k = 4});
///
/// Throws UsageError for k or threads < 1, Error when shapes do not fit or a descriptor or a
/// similarity is not finite, Interrupted.
std::vector<Match> retrieve(const Descriptors& descriptors, const Task& task,
                            const SearchOptions& options = {},
                            QueryCase asked = QueryCase::kAsStored);

}  // namespace revisit::pipeline
