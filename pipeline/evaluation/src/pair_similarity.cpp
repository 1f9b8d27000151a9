#include <memory>

#include "revisit/evaluation/pairs.h"
#include "revisit/recognition/cosine.h"

namespace revisit::pipeline {

PairSimilarity pair_similarity(const FloatMatrix& descriptors, const Similarity& own) {
  const auto lengths = std::make_shared<std::vector<double>>(row_lengths(descriptors, 1));
  if (own)
    return [&descriptors, own](int64_t query, std::span<const int64_t> candidates,
                               std::span<double> similarities) {
      own(descriptors.row(query), descriptors, candidates, similarities);
    };
  return [&descriptors, lengths](int64_t query, std::span<const int64_t> candidates,
                                 std::span<double> similarities) {
    for (size_t i = 0; i < candidates.size(); ++i)
      similarities[i] = cosine(descriptors.row(query), (*lengths)[query],
                               descriptors.row(candidates[i]), (*lengths)[candidates[i]]);
  };
}

}  // namespace revisit::pipeline
