#include "revisit/recognition/retrieve.h"

#include <algorithm>
#include <cmath>

#include "linear_algebra/linear_algebra.h"
#include "retrieve/by_similarity.h"
#include "retrieve/ranking.h"
#include "retrieve/shortlist.h"
#include "revisit/proto/error.h"
#include "revisit/recognition/cosine.h"

namespace revisit::pipeline {
namespace {

constexpr int64_t kBlockRows = 512;
constexpr int64_t kBlockFloats = int64_t{16} << 20;  // of each of the two blocks of unit vectors

/// Copies a row scaled to unit length; a zero row stays zero.
void copy_unit(std::span<const float> row, double length, float* out) {
  const double scale = length > 0 ? 1 / length : 0;
  for (size_t i = 0; i < row.size(); ++i) out[i] = static_cast<float>(row[i] * scale);
}

bool is_candidate(const TaskQuery& query, int64_t position) {
  return (position >= query.candidates[0].begin && position < query.candidates[0].end) ||
         (position >= query.candidates[1].begin && position < query.candidates[1].end);
}

/// One descriptor a query against the stored ones.
class Retrieval {
 public:
  Retrieval(const FloatMatrix& stored, const std::vector<double>& stored_lengths,
            const RetrievalTask& task, const RetrieveOptions& options)
      : stored_(stored),
        stored_lengths_(stored_lengths),
        task_(task),
        options_(options),
        block_rows_(
            std::clamp<int64_t>(kBlockFloats / std::max<int64_t>(1, stored.d), 8, kBlockRows)),
        slack_(rounding_of_cosines(stored.d)) {}

  /// Calls `done(query index, match)` for each query, in order.
  template <class Done>
  void run(const FloatMatrix& asked, const std::vector<double>& asked_lengths, int which_case,
           Done done) {
    const auto n_queries = static_cast<int64_t>(task_.queries.size());
    std::vector<float> units(block_rows_ * stored_.d);
    for (int64_t first = 0; first < n_queries; first += block_rows_) {
      if (options_.stop && options_.stop()) throw Interrupted("retrieval stopped");
      const int64_t count = std::min(block_rows_, n_queries - first);
      for (int64_t q = 0; q < count; ++q) {
        const int64_t scan = task_.queries[first + q].scan;
        copy_unit(asked.row(scan), asked_lengths[scan], units.data() + q * stored_.d);
      }
      std::vector<Shortlist> shortlists(count, Shortlist(options_.k, slack_));
      compare(first, count, units, shortlists);
      for (int64_t q = 0; q < count; ++q)
        done(first + q, exact(first + q, shortlists[q], asked, asked_lengths, which_case));
    }
  }

 private:
  void compare(int64_t first, int64_t count, const std::vector<float>& units,
               std::vector<Shortlist>& shortlists) {
    // Stored scans beyond the last candidate of the block (online: the future) need no product.
    int64_t end = 0;
    for (int64_t q = first; q < first + count; ++q)
      for (const CandidateRange& range : task_.queries[q].candidates)
        if (range.size() > 0) end = std::max(end, range.end);
    stored_units_.resize(block_rows_ * stored_.d);
    cosines_.resize(count * block_rows_);
    for (int64_t begin = 0; begin < end; begin += block_rows_) {
      const int64_t columns = std::min(block_rows_, end - begin);
      for (int64_t s = 0; s < columns; ++s) {
        const int64_t scan = task_.stored[begin + s];
        copy_unit(stored_.row(scan), stored_lengths_[scan], stored_units_.data() + s * stored_.d);
      }
      multiply_transposed(count, columns, stored_.d, units.data(), stored_.d, stored_units_.data(),
                          stored_.d, cosines_.data(), columns);
      for (int64_t q = 0; q < count; ++q)
        for (int64_t s = 0; s < columns; ++s)
          if (is_candidate(task_.queries[first + q], begin + s))
            shortlists[q].offer(cosines_[q * columns + s], begin + s);
    }
  }

  /// The k best in double precision, ties by row.
  Match exact(int64_t index, Shortlist& shortlist, const FloatMatrix& asked,
              const std::vector<double>& asked_lengths, int which_case) const {
    const int64_t query = task_.queries[index].scan;
    std::vector<RankedScan> best;
    for (const Shortlist::Entry& entry : shortlist.finish()) {
      const int64_t scan = task_.stored[entry.position];
      best.emplace_back(
          -cosine(asked.row(query), asked_lengths[query], stored_.row(scan), stored_lengths_[scan]),
          scan);
    }
    return best_match(query, best, which_case, options_);
  }

  const FloatMatrix& stored_;
  const std::vector<double>& stored_lengths_;
  const RetrievalTask& task_;
  const RetrieveOptions& options_;
  int64_t block_rows_;
  float slack_;
  std::vector<float> stored_units_, cosines_;
};

void check(const FloatMatrix& case1, const RetrievalTask& task, const RetrieveOptions& options,
           const FloatMatrix* case2) {
  if (options.k < 1) throw UsageError(str("k: expected at least 1, found ", options.k));
  if (options.threads < 1)
    throw UsageError(str("threads: expected at least 1, found ", options.threads));
  if (case2 && (case2->n != case1.n || case2->d != case1.d))
    throw Error(str("descriptors of alignment case 2 are ", case2->n, " x ", case2->d,
                    ", of case 1 ", case1.n, " x ", case1.d));
  const auto has_row = [&](int64_t row) { return row >= 0 && row < case1.n; };
  for (const int64_t row : task.stored)
    if (!has_row(row)) throw Error(str("task ", task.name, " stores scan ", row, " of ", case1.n));
  for (const TaskQuery& query : task.queries) {
    if (!has_row(query.scan))
      throw Error(str("task ", task.name, " asks scan ", query.scan, " of ", case1.n));
    for (const CandidateRange& range : query.candidates)
      if (range.begin < 0 || range.end < range.begin ||
          range.end > static_cast<int64_t>(task.stored.size()))
        throw Error(str("task ", task.name, ": scan ", query.scan, " has candidates [", range.begin,
                        ", ", range.end, ") of ", task.stored.size()));
    if (query.n_candidates() == 0)
      throw Error(str("task ", task.name, ": scan ", query.scan, " has no candidates"));
  }
}

}  // namespace

Score parse_score(const std::string& text) {
  if (text == "margin") return Score::kMargin;
  if (text == "cosine") return Score::kBest;
  throw UsageError(str("score: expected margin or cosine, found '", text, "'"));
}

const char* name_of(Score score) {
  return score == Score::kMargin ? "margin" : "cosine";
}

std::vector<Match> retrieve(const FloatMatrix& case1, const RetrievalTask& task,
                            const RetrieveOptions& options, const FloatMatrix* case2) {
  check(case1, task, options, case2);
  const int64_t n_queries = static_cast<int64_t>(task.queries.size());
  const int64_t total = case2 ? 2 * n_queries : n_queries;
  int64_t answered = 0;
  const auto report = [&] {
    if (options.progress) options.progress(++answered, total);
  };

  std::vector<Match> matches(n_queries);
  const auto take = [&](int64_t index, Match match) {
    matches[index] = std::move(match);
    report();
  };
  const auto take_better = [&](int64_t index, Match match) {
    if (match.score > matches[index].score) matches[index] = std::move(match);
    report();
  };
  if (options.similarity) {
    retrieve_by_similarity(case1, case1, task, options, 1, take);
    if (case2) retrieve_by_similarity(*case2, case1, task, options, 2, take_better);
    return matches;
  }
  const std::vector<double> lengths = row_lengths(case1, 1);
  Retrieval retrieval(case1, lengths, task, options);
  retrieval.run(case1, lengths, 1, take);
  if (case2) retrieval.run(*case2, row_lengths(*case2, 2), 2, take_better);
  return matches;
}

}  // namespace revisit::pipeline
