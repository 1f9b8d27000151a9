#pragma once

#include <functional>

#include "revisit/recognition/retrieve.h"

namespace revisit::pipeline {

/// Answers every query of a checked task by `options.similarity`, all candidates compared; calls
/// `done(query index, match)` for each, in order. Throws Error for a similarity that is not finite,
/// Interrupted.
void retrieve_by_similarity(const FloatMatrix& asked, const FloatMatrix& stored,
                            const RetrievalTask& task, const RetrieveOptions& options,
                            int which_case,
                            const std::function<void(int64_t index, Match match)>& done);

}  // namespace revisit::pipeline
