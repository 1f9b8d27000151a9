#include <sys/resource.h>

#include <algorithm>
#include <cmath>
#include <iostream>

#include "cli/json.h"
#include "cli/shell.h"
#include "cli/terminal.h"
#include "net_commands.h"
#include "report/report.h"
#include "revisit/base/text.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

/// Confidence interval of a difference of medians (Zou and Donner: Construction of confidence
/// limits about effect measures, 2008), widened by the variation between processes.
reports::NetChange change_of(const reports::Timing& before, const reports::Timing& now) {
  reports::NetChange change;
  change.set_before_ms(before.median());
  change.set_now_ms(now.median());
  if (before.median() == 0 && now.median() == 0) return change;
  const double difference = now.median() - before.median();
  // Between processes a median differs by other memory addresses, too (docs/MODELS.md).
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

/// Fills with deterministic pixel values, because zeros or denormals would change the times.
void fill_input(const engine::View<float>& input) {
  int64_t i = 0;
  for (float& value : input.values())
    value = 100 * std::sin(0.37F * static_cast<float>(i++ % 9973));
}

std::vector<float> some_offsets(const engine::Net& net) {
  std::vector<float> offsets;
  if (net.inputs().size() == 1 && net.inputs()[0].shape.rank() == 4)
    for (int64_t c = 0; c < net.inputs()[0].shape[1]; ++c)
      offsets.push_back(-10.0F * static_cast<float>(c));
  return offsets;
}

double peak_resident_bytes() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) * 1024;
}

std::vector<std::string> formats() {
  std::vector<std::string> words = {"table", "json", "csv"};
#ifdef REVISIT_HAVE_PIPELINE
  words.emplace_back("html");
#endif
  return words;
}

void print(const reports::NetReport& report, const std::string& format,
           [[maybe_unused]] const Arguments& arguments) {
#ifdef REVISIT_HAVE_PIPELINE
  if (format == "html") {
    std::cout << profile_page(report, shell_command("revisit net profile", arguments));
    return;
  }
#endif
  print_net_report(report, format);
}

struct TimingOptions {
  NetOptions net;
  int warmup = profiling::kWarmup, repeat = profiling::kRepeat;
  std::string format = "table";
  std::optional<std::filesystem::path> baseline;
  bool reference = false, gray = false;

  void declare(Options& options) {
    net.declare(options);
    options.group("Measurement:");
    options.option("repeat", "R", "timed passes (default 20)", &repeat).at_least(1);
    options.option("warmup", "W", "untimed passes before (default 2)", &warmup).at_least(0);
    options.flag(
        "single-channel",
        "input of one channel, replicated up to a constant per channel, as for range images",
        &gray);
    options.flag("reference", "slow reference kernels", &reference);
    options.option(
        "baseline", "FILE",
        "earlier profile (--format json) to compare with; reports changes at 99 % confidence",
        &baseline);
    options.format(formats(), &format);
  }
};

int run_profile(TimingOptions& o, const Options& options) {
  std::optional<reports::NetReport> before;
  if (o.baseline) {
    if (o.repeat < profiling::kMinSamplesForInterval)
      throw UsageError("--baseline: expected --repeat of at least ",
                       profiling::kMinSamplesForInterval, ", found ", o.repeat);
    before = read_profile(*o.baseline);
  }

  for (const std::string& warning : slow_settings()) warn(warning);
  const engine::Net loaded = load_net(o.net, NoWeights::kRandom);
  if (!o.net.weights)
    note("no weights were given; random ones (He-scaled, seed " + str(o.net.seed) +
         ") take as long as trained ones");
  engine::PlanOptions plan_options = o.net.plan_options();
  plan_options.reference_kernels = o.reference;
  if (o.gray) plan_options.channel_offsets = some_offsets(loaded);
  const engine::Plan plan = loaded.plan({}, plan_options);
  const std::string weights = weights_source(o.net, NoWeights::kRandom);
  if (before) need_same_net(*o.baseline, *before, net_report({o.net, weights, loaded, plan}));
  engine::Run run(plan);
  for (const engine::Port& port : plan.inputs()) fill_input(run.input(port.name));
  const profiling::Profile profile = profiling::profile(run, o.warmup, o.repeat, interrupted);
  // Before the limits are measured, because that allocates memory, too.
  const double peak_resident = peak_resident_bytes();
  const profiling::SpeedLimits limits = profiling::measure_speed_limits(o.net.threads);
  reports::NetReport report =
      net_report({o.net, weights, loaded, plan, false, &profile, &limits, peak_resident});
  clear_limits_if_busy(&report);
  if (before && report.passes() >= profiling::kMinSamplesForInterval)
    *report.mutable_baseline() = compare_profiles(*o.baseline, *before, report);
  print(report, o.format, options.arguments());
  if (report.has_busy()) warn("the machine is busy: " + report.busy() + "; profile again");
  return interrupted() ? kInterrupted : kOk;
}

}  // namespace

reports::NetReport read_profile(const fs::path& file) {
  reports::NetReport report;
  read_report(file, &report);
  if (!report.has_total_ms() || !report.total_ms().has_low() ||
      (report.limits().bandwidths().empty() && !report.has_busy()))
    throw InputError(file.string() +
                     ": not what this version of `revisit net profile --format json` writes");
  if (report.passes() < profiling::kMinSamplesForInterval)
    throw InputError(file.string(), ": a profile of ", report.passes(),
                     " passes: expected at least ", profiling::kMinSamplesForInterval,
                     " (--repeat)");
  return report;
}

void need_same_net(const fs::path& file, const reports::NetReport& before,
                   const reports::NetReport& now) {
  need_same(file, "input", before.inputs(), now.inputs(), port_text);
  need_same(file, "layer", before.layers(), now.layers(), layer_text);
}

reports::NetComparison compare_profiles(const fs::path& file, const reports::NetReport& before,
                                        const reports::NetReport& now) {
  reports::NetComparison comparison;
  comparison.set_file(file.string());
  comparison.set_threads(before.threads());
  comparison.set_simd(before.simd());
  comparison.set_precision(before.precision());
  *comparison.mutable_limits() = before.limits();
  for (int i = 0; i < now.layers_size(); ++i) {
    reports::NetChange& change = *comparison.add_layers();
    change = change_of(before.layers(i).ms(), now.layers(i).ms());
    change.set_layer(now.layers(i).name());
  }
  *comparison.mutable_whole() = change_of(before.total_ms(), now.total_ms());
  *comparison.mutable_layer_sum() = change_of(before.layer_sum_ms(), now.layer_sum_ms());
  return comparison;
}

Command net_profile_command() {
  return {"profile", "time of every layer and of the net",
          "Times every layer of a Caffe net and the net end to end, with instrumented and "
          "uninstrumented passes in turn after a warm-up. Without WEIGHTS the weights are random, "
          "which takes the same time. Then it measures the limits of the machine on as many "
          "threads. `peak %`: fraction of a layer's time that its multiplications take at peak "
          "throughput. `memory %`: fraction that moving its inputs, weights and outputs once "
          "takes. `gain ms`: headroom to the roofline.",
          "  revisit net profile alexnet.prototxt --input-shape 1x3x107x4000 --end conv3+pool5\n"
          "  revisit net profile train_val.prototxt --input-shape 1,3,224,224\n"
          "  revisit net profile net.prototxt net.caffemodel --threads 2 --repeat 50 --format json "
          "> old.json\n"
          "  revisit net profile net.prototxt net.caffemodel --threads 2 --repeat 50 --baseline "
          "old.json\n"
          "  revisit net profile deploy.prototxt --format html > profile.html\n",
          with_options<TimingOptions>(run_profile)};
}

}  // namespace revisit::cli
