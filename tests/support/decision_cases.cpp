#include "decision_cases.h"

#include <fstream>
#include <sstream>
#include <stdexcept>

#include "testing.h"

namespace revisit::test {
namespace {

/// Columns: the case, then numbers. Skips the header.
std::vector<std::pair<std::string, std::vector<double>>> rows_of(const std::string& name) {
  std::ifstream file(fixture("precision_recall/" + name));
  std::string line;
  if (!std::getline(file, line)) throw std::runtime_error("cannot read the fixture " + name);
  std::vector<std::pair<std::string, std::vector<double>>> rows;
  while (std::getline(file, line)) {
    std::istringstream fields(line);
    std::string field;
    std::getline(fields, field, ',');
    rows.push_back({field, {}});
    while (std::getline(fields, field, ',')) rows.back().second.push_back(std::stod(field));
  }
  return rows;
}

}  // namespace

std::map<std::string, DecisionCase> decision_cases() {
  std::map<std::string, DecisionCase> cases;
  for (const auto& [name, v] : rows_of("scores.csv"))
    cases[name].decisions.emplace_back(v.at(0), v.at(1) != 0);
  for (const auto& [name, v] : rows_of("curves.csv"))
    cases[name].curve.push_back({v.at(0), v.at(1), v.at(2)});
  for (const auto& [name, v] : rows_of("summaries.csv")) {
    DecisionCase& one = cases[name];
    one.average_precision = v.at(0);
    one.f1_max = v.at(1);
    one.max_recall_at_precision_1 = v.at(2);
    one.extended_precision = v.at(3);
  }
  return cases;
}

}  // namespace revisit::test
