#include "revisit/evaluation/precision_recall.h"

#include <algorithm>
#include <cmath>
#include <iomanip>

#include "ballots.h"
#include "revisit/base/error.h"
#include "revisit/base/files.h"

namespace revisit {
namespace {

struct Cell {
  double value;
  friend std::ostream& operator<<(std::ostream& out, const Cell& cell) {
    return std::isnan(cell.value) ? out : out << cell.value;
  }
};

}  // namespace

std::vector<MatchLabel> label_matches(const std::vector<Match>& matches, const Task& task,
                                      const Trajectory& trajectory, const TrueMatchRule& rule) {
  need_distances(trajectory, rule.distance, "judging matches");
  if (matches.size() != task.queries.size())
    throw Error("task ", task.name, " has ", task.queries.size(), " queries but ", matches.size(),
                " matches were given");
  std::vector<MatchLabel> labels(matches.size());
  for (size_t i = 0; i < matches.size(); ++i) {
    const TaskQuery& query = task.queries[i];
    if (matches[i].query != query.scan || matches[i].ranks.empty())
      throw Error("match ", i, " does not answer query ", i, " of task ", task.name, " (scan ",
                  query.scan, ")");
    const auto has_best = [&](const CandidateRange& range) {
      const auto first = task.stored.begin();
      return std::find(first + range.begin, first + range.end, matches[i].ranks[0]) !=
             first + range.end;
    };
    if (std::ranges::none_of(query.candidates, has_best))
      throw Error("match ", i, " of task ", task.name, ": scan ", matches[i].ranks[0],
                  " is no candidate of the query, scan ", query.scan);
    labels[i].score = matches[i].score;
    const PairLabel best = pair_label(trajectory, rule, query.scan, matches[i].ranks[0]);
    labels[i].correct = best == PairLabel::kCorrect;
    labels[i].ignored = best == PairLabel::kIgnored;
    for (const CandidateRange& range : query.candidates)
      for (int64_t c = range.begin; c < range.end && !labels[i].positive; ++c)
        labels[i].positive =
            pair_label(trajectory, rule, query.scan, task.stored.at(c)) == PairLabel::kCorrect;
  }
  return labels;
}

Ballots<double> ballots_of(const std::vector<MatchLabel>& labels, Missed missed) {
  using B = Ballot<double>;
  Ballots<double> ballots;
  ballots.missed = missed;
  for (const MatchLabel& verdict : labels) {
    if (std::isnan(verdict.score)) throw Error("precision and recall: a score is not a number");
    if (verdict.correct && !verdict.positive)
      throw Error("precision and recall: a match is correct where no candidate is");
    if (verdict.correct && verdict.ignored)
      throw Error("precision and recall: a match is both correct and ignored");
    // Queries with an ignored match are positives only if missing means rejecting.
    const bool positive = verdict.positive && (missed == Missed::kRejected || !verdict.ignored);
    const auto query = static_cast<uint32_t>(ballots.positives.size());
    ballots.by_score.push_back(
        {verdict.score, query << B::kQueryShift | (verdict.correct ? B::kCorrect : 0) |
                            (positive ? B::kPositive : 0) | (verdict.ignored ? B::kIgnored : 0)});
    ballots.positives.push_back(positive);
    ballots.sought.push_back(verdict.positive);
  }
  ballots.sort();
  return ballots;
}

std::vector<PrPoint> precision_recall(const std::vector<MatchLabel>& labels, Missed missed) {
  return curve_of(ballots_of(labels, missed));
}

PrSummary summarize(const std::vector<MatchLabel>& labels, Missed missed) {
  PrSummary summary = summary_of(ballots_of(labels, missed));
  summary.n_queries = static_cast<int64_t>(labels.size());
  summary.n_positives =
      std::count_if(labels.begin(), labels.end(), [](const MatchLabel& v) { return v.positive; });
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

}  // namespace revisit
