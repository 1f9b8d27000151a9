#include "revisit/pipeline/precision_recall.h"

#include <algorithm>
#include <cmath>
#include <iomanip>
#include <limits>

#include "revisit/proto/atomic_file.h"
#include "revisit/proto/error.h"

namespace revisit::pipeline {
namespace {

constexpr double kNotComputed = std::numeric_limits<double>::quiet_NaN();

int64_t count_positives(const std::vector<Verdict>& verdicts) {
  return std::count_if(verdicts.begin(), verdicts.end(),
                       [](const Verdict& v) { return v.positive; });
}

/// Blank for NaN: not computed is never 0.
struct Cell {
  double value;
  friend std::ostream& operator<<(std::ostream& out, const Cell& cell) {
    return std::isnan(cell.value) ? out : out << cell.value;
  }
};

}  // namespace

std::vector<Verdict> judge(const std::vector<Match>& matches, const Task& task,
                           const Trajectory& trajectory, const TrueMatchRule& rule) {
  if (trajectory.positions.empty())
    throw UsageError("judging matches needs poses; this data set has none");
  if (matches.size() != task.queries.size())
    throw Error(str("task ", task.name, " has ", task.queries.size(), " queries but ",
                    matches.size(), " matches were given"));
  const auto is_true = [&](int64_t a, int64_t b) {
    return is_true_match(trajectory.positions.at(a), trajectory.positions.at(b), rule);
  };
  std::vector<Verdict> verdicts(matches.size());
  for (size_t i = 0; i < matches.size(); ++i) {
    const TaskQuery& query = task.queries[i];
    if (matches[i].query != query.scan || matches[i].ranks.empty())
      throw Error(str("match ", i, " does not answer query ", i, " of task ", task.name, " (scan ",
                      query.scan, ")"));
    verdicts[i].score = matches[i].score;
    verdicts[i].correct = is_true(query.scan, matches[i].ranks[0]);
    for (const CandidateRange& range : query.candidates)
      for (int64_t c = range.begin; c < range.end && !verdicts[i].positive; ++c)
        verdicts[i].positive = is_true(query.scan, task.stored.at(c));
  }
  return verdicts;
}

std::vector<PrPoint> precision_recall(const std::vector<Verdict>& verdicts) {
  for (const Verdict& verdict : verdicts) {
    if (std::isnan(verdict.score)) throw Error("precision and recall: a score is not a number");
    if (verdict.correct && !verdict.positive)
      throw Error("precision and recall: a match is correct where no candidate is");
  }
  std::vector<Verdict> sorted = verdicts;
  std::sort(sorted.begin(), sorted.end(),
            [](const Verdict& a, const Verdict& b) { return a.score > b.score; });
  const int64_t n_positives = count_positives(sorted);
  const int64_t n_negatives = static_cast<int64_t>(sorted.size()) - n_positives;

  std::vector<PrPoint> curve;
  int64_t tp = 0, fp = 0, accepted_negatives = 0;
  for (size_t i = 0; i < sorted.size(); ++i) {
    tp += sorted[i].correct;
    fp += !sorted[i].correct;
    accepted_negatives += !sorted[i].positive;
    if (i + 1 < sorted.size() && sorted[i + 1].score == sorted[i].score)
      continue;  // one threshold, all ties
    PrPoint point{
        sorted[i].score, tp, fp, n_positives - tp, n_negatives - accepted_negatives, 0, 0, 0};
    point.precision = static_cast<double>(tp) / static_cast<double>(tp + fp);
    point.recall =
        n_positives ? static_cast<double>(tp) / static_cast<double>(n_positives) : kNotComputed;
    point.f1 = n_positives
                   ? 2.0 * static_cast<double>(tp) / static_cast<double>(2 * tp + fp + point.fn)
                   : kNotComputed;
    curve.push_back(point);
  }
  return curve;
}

PrSummary summarize(const std::vector<Verdict>& verdicts) {
  const std::vector<PrPoint> curve = precision_recall(verdicts);
  PrSummary summary;
  summary.n_queries = static_cast<int64_t>(verdicts.size());
  summary.n_positives = count_positives(verdicts);
  if (summary.n_positives == 0) {
    summary.f1_max = summary.f1_max_threshold = summary.average_precision = summary.recall_at_1 =
        summary.max_recall_at_precision_1 = summary.extended_precision = kNotComputed;
    return summary;
  }
  summary.f1_max = -1;
  double last_recall = 0;
  for (const PrPoint& point : curve) {
    if (point.f1 > summary.f1_max) {
      summary.f1_max = point.f1;
      summary.f1_max_threshold = point.threshold;
    }
    summary.average_precision += (point.recall - last_recall) * point.precision;
    last_recall = point.recall;
    if (point.fp == 0) summary.max_recall_at_precision_1 = point.recall;
  }
  summary.recall_at_1 = curve.back().recall;  // everything accepted
  summary.extended_precision = (curve.front().precision + summary.max_recall_at_precision_1) / 2;
  return summary;
}

void write_precision_recall_csv(const std::filesystem::path& file,
                                const std::vector<PrPoint>& curve) {
  write_atomically(file, [&](std::ostream& out) {
    out << "threshold,tp,fp,fn,tn,precision,recall,f1\n" << std::setprecision(17);
    for (const PrPoint& p : curve)
      out << p.threshold << ',' << p.tp << ',' << p.fp << ',' << p.fn << ',' << p.tn << ','
          << Cell{p.precision} << ',' << Cell{p.recall} << ',' << Cell{p.f1} << '\n';
  });
}

}  // namespace revisit::pipeline
