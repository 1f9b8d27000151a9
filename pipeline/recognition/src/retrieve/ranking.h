#pragma once

#include <utility>
#include <vector>

#include "revisit/recognition/retrieve.h"

namespace revisit::pipeline {

/// (-similarity, stored scan): sorts with the most similar first and equals by row.
using RankedScan = std::pair<double, int64_t>;

/// The k best of `candidates`, which is reordered, as the answer to a query.
Match best_match(int64_t query, std::vector<RankedScan>& candidates, int which_case,
                 const RetrieveOptions& options);

}  // namespace revisit::pipeline
