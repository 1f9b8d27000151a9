#include "revisit/evaluation/retrieve.h"

#include <algorithm>

#include "revisit/base/error.h"

namespace revisit {
namespace {

void check(const Descriptors& descriptors, const Task& task, QueryCase query_case) {
  const FloatMatrix& case1 = descriptors.case1;
  if (query_case != QueryCase::kAsStored) {
    if (!descriptors.case2) throw Error("there are no descriptors of alignment case 2");
    if (descriptors.case2->n != case1.n || descriptors.case2->d != case1.d)
      throw Error("descriptors of alignment case 2 are ", descriptors.case2->n, " x ",
                  descriptors.case2->d, ", of case 1 ", case1.n, " x ", case1.d);
  }
  check_finite(descriptors);
  const auto has_row = [&](int64_t row) { return row >= 0 && row < case1.n; };
  for (const int64_t row : task.stored)
    if (!has_row(row)) throw Error("task ", task.name, " stores scan ", row, " of ", case1.n);
  for (const TaskQuery& query : task.queries) {
    if (!has_row(query.scan))
      throw Error("task ", task.name, " asks scan ", query.scan, " of ", case1.n);
    for (const CandidateRange& range : query.candidates)
      if (range.begin < 0 || range.end < range.begin ||
          range.end > static_cast<int64_t>(task.stored.size()))
        throw Error("task ", task.name, ": scan ", query.scan, " has candidates [", range.begin,
                    ", ", range.end, ") of ", task.stored.size());
    if (query.n_candidates() == 0)
      throw Error("task ", task.name, ": scan ", query.scan, " has no candidates");
  }
}

/// If compact codes preselected fewer than k candidates, appends the first of the others.
void add_left_out(Match& match, const TaskQuery& query, const SearchOptions& options) {
  const auto wanted = static_cast<size_t>(std::min<int64_t>(options.k, query.n_candidates()));
  const std::vector<int64_t> chosen = match.ranks;
  for (const CandidateRange& range : query.candidates)
    for (int64_t place = range.begin; place < range.end && match.ranks.size() < wanted; ++place) {
      if (std::ranges::find(chosen, place) != chosen.end()) continue;
      match.ranks.push_back(place);
      match.similarities.push_back(-1);
      if (options.score == Score::kMargin) match.score = 2 * match.similarities.front() + 1;
    }
}

/// Queries and ranks of the result are rows of the data set.
std::vector<Match> search(const PlaceIndex& index, const FloatMatrix& descriptors, int which_case,
                          const Task& task, const SearchOptions& options) {
  std::vector<Query> queries;
  for (const TaskQuery& query : task.queries)
    queries.push_back({descriptors.row(query.scan), query.candidates});
  std::vector<Match> matches;
  try {
    matches = index.best_of_many(queries, options);
  } catch (const NotFinite& error) {
    throw Error("the similarity of scan ", task.queries.at(error.query).scan, " to scan ",
                task.stored.at(error.place), " is not finite: ", error.similarity);
  }
  for (size_t q = 0; q < matches.size(); ++q) {
    if (options.score != Score::kDistinctMargin)  // may return fewer than k
      add_left_out(matches[q], task.queries[q], options);
    matches[q].query = task.queries[q].scan;
    matches[q].which_case = which_case;
    for (int64_t& rank : matches[q].ranks) rank = task.stored[rank];
  }
  return matches;
}

}  // namespace

std::vector<Match> retrieve(const Descriptors& descriptors, const Task& task,
                            const SearchOptions& options, QueryCase query_case) {
  check(descriptors, task, query_case);
  PlaceIndex index(descriptors.case1.d, descriptors.comparison);
  for (const int64_t row : task.stored) index.add_view(descriptors.case1.row(row));
  if (query_case == QueryCase::kTwo) return search(index, *descriptors.case2, 2, task, options);
  if (query_case == QueryCase::kAsStored) return search(index, descriptors.case1, 1, task, options);

  SearchOptions half = options;
  int64_t before = 0;
  if (options.progress)
    half.progress = [&](int64_t done, int64_t n) { options.progress(before + done, 2 * n); };
  std::vector<Match> matches = search(index, descriptors.case1, 1, task, half);
  before = static_cast<int64_t>(matches.size());
  std::vector<Match> turned = search(index, *descriptors.case2, 2, task, half);
  for (size_t q = 0; q < matches.size(); ++q)
    if (turned[q].score > matches[q].score) matches[q] = std::move(turned[q]);
  return matches;
}

}  // namespace revisit
