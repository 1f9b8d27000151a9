#include "retrieve/by_similarity.h"

#include <algorithm>
#include <cmath>

#include "retrieve/ranking.h"
#include "revisit/engine/parallel_for.h"
#include "revisit/proto/error.h"

namespace revisit::pipeline {
namespace {

std::vector<int64_t> candidates_of(const RetrievalTask& task, const TaskQuery& query) {
  std::vector<int64_t> scans;
  for (const CandidateRange& range : query.candidates)
    scans.insert(scans.end(), task.stored.begin() + range.begin, task.stored.begin() + range.end);
  return scans;
}

Match answer(const FloatMatrix& asked, const FloatMatrix& stored, const RetrievalTask& task,
             const TaskQuery& query, const RetrieveOptions& options, int which_case) {
  const std::vector<int64_t> scans = candidates_of(task, query);
  std::vector<double> similarities(scans.size());
  options.similarity(asked.row(query.scan), stored, scans, similarities);
  std::vector<RankedScan> ranked;
  for (size_t i = 0; i < scans.size(); ++i) {
    if (!std::isfinite(similarities[i]))
      throw Error(str("the similarity of scan ", query.scan, " to scan ", scans[i],
                      " is not finite: ", similarities[i]));
    ranked.emplace_back(-similarities[i], scans[i]);
  }
  return best_match(query.scan, ranked, which_case, options);
}

}  // namespace

void retrieve_by_similarity(const FloatMatrix& asked, const FloatMatrix& stored,
                            const RetrievalTask& task, const RetrieveOptions& options,
                            int which_case,
                            const std::function<void(int64_t index, Match match)>& done) {
  // Blocks, so that progress and stop are called from this thread and often enough.
  constexpr int64_t kBlock = 64;
  const auto n_queries = static_cast<int64_t>(task.queries.size());
  for (int64_t first = 0; first < n_queries; first += kBlock) {
    if (options.stop && options.stop()) throw Interrupted("retrieval stopped");
    const int64_t count = std::min(kBlock, n_queries - first);
    std::vector<Match> matches(static_cast<size_t>(count));
    parallel_for(count, options.threads, [&](int64_t q) {
      matches[static_cast<size_t>(q)] = answer(
          asked, stored, task, task.queries[static_cast<size_t>(first + q)], options, which_case);
    });
    for (int64_t q = 0; q < count; ++q) done(first + q, std::move(matches[static_cast<size_t>(q)]));
  }
}

}  // namespace revisit::pipeline
