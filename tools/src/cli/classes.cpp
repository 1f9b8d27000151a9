#include "cli/classes.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <iostream>
#include <limits>
#include <numeric>
#include <sstream>

#include "cli/table.h"
#include "revisit/base/files.h"
#include "revisit/base/text.h"

namespace revisit::cli {
namespace {

constexpr size_t kMaxShown = 5;

int64_t values_per_picture(const engine::Shape& output) {
  return output.rank() < 2 ? output.elements() : output.product(1, output.rank());
}

}  // namespace

std::vector<std::string> read_labels(const std::filesystem::path& file) {
  std::vector<std::string> labels;
  std::istringstream lines(read_content(file));
  for (std::string line; std::getline(lines, line);) {
    if (line.ends_with('\r')) line.pop_back();
    labels.push_back(line);
  }
  while (!labels.empty() && labels.back().empty()) labels.pop_back();
  if (labels.empty()) throw InputError(file.string(), ": expected a label per line, found none");
  return labels;
}

std::vector<std::string> classifying(const engine::Plan& plan, const std::filesystem::path& file,
                                     size_t labels) {
  std::vector<std::string> names;
  for (const engine::Port& port : plan.outputs())
    if (values_per_picture(port.shape) == static_cast<int64_t>(labels)) names.push_back(port.name);
  if (names.empty())
    throw UsageError("--labels: ", file.string(), " has ", labels, " lines, but of each picture ",
                     joined(plan.outputs(), ", ", [](const engine::Port& port) {
                       return str("the output '", port.name, "' has ",
                                  values_per_picture(port.shape), " numbers");
                     }));
  return names;
}

void print_best_classes(const std::string& name, std::span<const float> output,
                        const std::vector<std::string>& labels) {
  Table table({"output", "picture", "value", "class", "label"});
  const size_t pictures = output.size() / labels.size();
  for (size_t picture = 0; picture < pictures; ++picture) {
    const float* const values = output.data() + picture * labels.size();
    std::vector<size_t> order(labels.size());
    std::iota(order.begin(), order.end(), size_t{0});
    const auto value = [values](size_t i) {
      return std::isnan(values[i]) ? -std::numeric_limits<float>::infinity() : values[i];
    };
    std::ranges::stable_sort(order, std::ranges::greater{}, value);
    for (size_t i = 0; i < std::min(kMaxShown, order.size()); ++i)
      table.row(
          {name, str(picture + 1), number(values[order[i]], 4), str(order[i]), labels[order[i]]});
  }
  table.print(std::cout);
}

}  // namespace revisit::cli
