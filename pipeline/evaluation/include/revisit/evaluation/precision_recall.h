#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

#include "revisit/evaluation/protocols.h"
#include "revisit/recognition/match.h"

namespace revisit::pipeline {

struct Verdict {
  double score = 0;
  bool correct = false;   // the best retrieved scan is a true match
  bool positive = false;  // some candidate of the query is a true match
  bool ignored = false;   // the best retrieved scan is neither right nor wrong (TrueMatchRule)
};

/// Judges `matches` (the answers to `task.queries`, in that order). Throws UsageError when the
/// trajectory has no positions (or places), Error when the matches are not those of the task.
std::vector<Verdict> judge(const std::vector<Match>& matches, const Task& task,
                           const Trajectory& trajectory, const TrueMatchRule& rule);

/// Accepting every query with score >= threshold gives:
///   tp  accepted, and the match is true
///   fp  accepted, and the match is not true (nor ignored)
///   fn  has a true match among its candidates, but is no tp. Missed::kNotFound: rejected, or
///       accepted with a wrong match (then it is an fp as well, and tp + fn = positives at every
///       threshold); never one whose match is ignored. Missed::kRejected: rejected
///   tn  rejected, and has no true match
struct PrPoint {
  double threshold = 0;
  int64_t tp = 0, fp = 0, fn = 0, tn = 0;
  double precision = 0;  // tp / (tp + fp); NaN when all that is accepted is ignored
  double recall = 0;     // tp / (tp + fn), 0 for tp = 0; NaN without positives
  double f1 = 0;         // 2 tp / (2 tp + fp + fn), 0 for tp = 0; NaN without positives
};

/// A point per distinct score, highest first. Throws Error for NaN or contradictory verdicts.
std::vector<PrPoint> precision_recall(const std::vector<Verdict>& verdicts,
                                      Missed missed = Missed::kNotFound);

/// The usual one-number summaries. NaN (not computed) when there are no positives.
struct PrSummary {
  int64_t n_queries = 0;                  // with at least one decision
  int64_t n_positives = 0;                // of them, with something true to find
  int64_t n_pairs = 0, n_true_pairs = 0;  // of tasks that decide on pairs; else 0
  double f1_max = 0;
  double f1_max_threshold = 0;   // the highest threshold that reaches f1_max
  double average_precision = 0;  // sum over the points of (R_i - R_{i-1}) P_i, no interpolation
  double recall_at_1 = 0;  // positives whose best retrieved scan is true / positives; NaN for pairs
  double max_recall_at_precision_1 = 0;  // 0 when the best score is already wrong
  /// (P_R0 + R_P100) / 2: precision at the highest threshold and maximum recall at 100 % precision
  /// (Ferrarini, Waheed, Waheed, Ehsan, Milford, McDonald-Maier, RA-L 2020).
  double extended_precision = 0;
};
PrSummary summarize(const std::vector<Verdict>& verdicts, Missed missed = Missed::kNotFound);

/// Writes `threshold,tp,fp,fn,tn,precision,recall,f1`, atomically; what was not computed is blank.
void write_precision_recall_csv(const std::filesystem::path& file,
                                const std::vector<PrPoint>& curve);

}  // namespace revisit::pipeline
