#pragma once

#include <cstdint>
#include <functional>
#include <span>

#include "revisit/recognition/matrix.h"

namespace revisit::pipeline {

/// How alike a query is to each of its candidates, for features that are not compared by cosine:
/// larger is more alike. All candidates of a query come in one call, because a probability over
/// places needs them together. Called from several threads at once.
///
/// `query` [d] is the descriptor asked, candidate i is row `candidates[i]` of `stored` [n][d], and
/// its similarity goes to `similarities[i]`.
using Similarity =
    std::function<void(std::span<const float> query, const FloatMatrix& stored,
                       std::span<const int64_t> candidates, std::span<double> similarities)>;

}  // namespace revisit::pipeline
