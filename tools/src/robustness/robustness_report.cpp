#include "robustness/robustness_report.h"

#include <google/protobuf/util/message_differencer.h>

#include <algorithm>
#include <limits>

#include "revisit/base/error.h"

namespace revisit::cli {
namespace {

std::string ratio(bool there, double value, int digits = 2) {
  return number(there ? value : std::numeric_limits<double>::quiet_NaN(), digits);
}

reports::Robustness question_of(const reports::Robustness& report) {
  reports::Robustness question = report;
  question.clear_version();
  question.clear_folder();
  question.clear_features();
  return question;
}

}  // namespace

Table robustness_table(const reports::Robustness& report) {
  std::vector<std::string> header = {"perturbation"};
  for (const reports::RobustnessFeature& feature : report.features())
    for (const char* column : {"self", "neighbor", "recall@1", "AP", "ratio", "minimum"})
      header.push_back(column == std::string("self") ? feature.label() + ": self" : column);
  Table table(std::move(header));
  if (report.features().empty()) return table;
  for (int i = 0; i < report.features(0).rows_size(); ++i) {
    std::vector<std::string> cells = {report.features(0).rows(i).name()};
    for (const reports::RobustnessFeature& feature : report.features()) {
      const reports::RobustnessRow& row = feature.rows(i);
      cells.insert(cells.end(), {str(row.own(), "/", row.asked()),
                                 row.asked_near() ? str(row.near(), "/", row.asked_near()) : "",
                                 ratio(row.has_recall_at_1(), row.recall_at_1(), 3),
                                 ratio(row.has_average_precision(), row.average_precision(), 3),
                                 ratio(row.has_ratio_median(), row.ratio_median()),
                                 ratio(row.has_ratio_least(), row.ratio_least())});
    }
    table.row(std::move(cells));
  }
  return table;
}

Table robustness_lines(const reports::Robustness& report) {
  Table table({"feature", "alteration", "name", "asked", "own", "asked_near", "near",
               "ratio_median", "ratio_least", "not_described", "recall_at_1", "average_precision"});
  for (const reports::RobustnessFeature& feature : report.features())
    for (const reports::RobustnessRow& row : feature.rows())
      table.row({feature.label(), row.alteration(), row.name(), str(row.asked()), str(row.own()),
                 str(row.asked_near()), str(row.near()),
                 row.has_ratio_median() ? number(row.ratio_median(), 6) : "",
                 row.has_ratio_least() ? number(row.ratio_least(), 6) : "",
                 str(row.not_described()), ratio(row.has_recall_at_1(), row.recall_at_1(), 6),
                 ratio(row.has_average_precision(), row.average_precision(), 6)});
  return table;
}

bool same_question(const reports::Robustness& a, const reports::Robustness& b) {
  if (a.features().empty() || b.features().empty()) return false;
  const bool same_perturbations =
      std::ranges::equal(a.features(0).rows(), b.features(0).rows(), {},
                         &reports::RobustnessRow::alteration, &reports::RobustnessRow::alteration);
  return same_perturbations && a.features(0).rows(0).asked() == b.features(0).rows(0).asked() &&
         google::protobuf::util::MessageDifferencer::Equals(question_of(a), question_of(b));
}

}  // namespace revisit::cli
