#include <algorithm>
#include <cmath>

#include "cli/json.h"
#include "net_commands.h"
#include "revisit/base/error.h"
#include "revisit/base/text.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;
using reports::NetChange;
using reports::NetReport;
using reports::Timing;

/// Confidence interval of a difference of medians (Zou and Donner: Construction of confidence
/// limits about effect measures, 2008), widened by the variation between processes.
NetChange change_of(const Timing& before, const Timing& now) {
  NetChange change;
  change.set_before_ms(before.median());
  change.set_now_ms(now.median());
  if (before.median() == 0 && now.median() == 0) return change;
  const double difference = now.median() - before.median();
  // Between processes a median differs by other memory addresses, too (docs/PROFILING.md).
  const double between = 0.05 * before.median() + 0.01;
  const double low =
      difference - std::hypot(now.median() - now.low(), before.high() - before.median(), between);
  const double high =
      difference + std::hypot(now.high() - now.median(), before.median() - before.low(), between);
  change.set_verdict(high < 0 ? "faster" : low > 0 ? "slower" : "within noise");
  if (before.median() == 0) return change;
  change.set_change(difference / before.median());
  change.set_low(low / before.median());
  change.set_high(high / before.median());
  return change;
}

std::string layer_text(const reports::NetLayer& layer) {
  return str("'", layer.name(), "' (", layer.type(), ", ", joined(layer.output_shape(), "x"), ")");
}

std::string port_text(const reports::NamedShape& port) {
  return str("'", port.name(), "' of ", joined(port.shape(), "x"));
}

template <class List, class Text>
void need_same(const fs::path& file, const char* what, const List& before, const List& now,
               const Text& text) {
  const auto at = [&](const List& list, int i) { return i < list.size() ? text(list[i]) : "none"; };
  for (int i = 0; i < std::max(before.size(), now.size()); ++i)
    if (at(before, i) != at(now, i))
      throw InputError(file.string(), ": a profile of another net or input: ", what, " ", i + 1,
                       " is ", at(before, i), " there, ", at(now, i), " here");
}

}  // namespace

NetReport read_profile(const fs::path& file) {
  NetReport report;
  read_report(file, &report);
  if (!report.has_total_ms() || !report.has_limits() || !report.total_ms().has_low() ||
      report.limits().bandwidths().empty())
    throw InputError(file.string() +
                     ": not what this version of `revisit net profile --format json` writes");
  if (report.passes() < profiling::kMinSamplesForInterval)
    throw InputError(file.string(), ": a profile of ", report.passes(),
                     " passes: expected at least ", profiling::kMinSamplesForInterval,
                     " (--repeat)");
  return report;
}

void need_same_net(const fs::path& file, const NetReport& before, const NetReport& now) {
  need_same(file, "input", before.inputs(), now.inputs(), port_text);
  need_same(file, "layer", before.layers(), now.layers(), layer_text);
}

reports::NetComparison compare_profiles(const fs::path& file, const NetReport& before,
                                        const NetReport& now) {
  reports::NetComparison comparison;
  comparison.set_file(file.string());
  comparison.set_threads(before.threads());
  comparison.set_simd(before.simd());
  comparison.set_precision(before.precision());
  *comparison.mutable_limits() = before.limits();
  for (int i = 0; i < now.layers_size(); ++i) {
    NetChange& change = *comparison.add_layers();
    change = change_of(before.layers(i).ms(), now.layers(i).ms());
    change.set_layer(now.layers(i).name());
  }
  *comparison.mutable_whole() = change_of(before.total_ms(), now.total_ms());
  *comparison.mutable_layer_sum() = change_of(before.layer_sum_ms(), now.layer_sum_ms());
  return comparison;
}

}  // namespace revisit::cli
