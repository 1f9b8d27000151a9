#pragma once

#include <map>
#include <string>
#include <utility>
#include <vector>

namespace revisit::test {

/// Random decisions and scikit-learn's results: `tests/fixtures/precision_recall/`.
struct DecisionCase {
  struct Point {
    double threshold, precision, recall;
  };
  std::vector<std::pair<double, bool>> decisions;  // score, positive
  std::vector<Point> curve;                        // highest threshold first
  double average_precision = 0, f1_max = 0, max_recall_at_precision_1 = 0, extended_precision = 0;
};
std::map<std::string, DecisionCase> decision_cases();

}  // namespace revisit::test
