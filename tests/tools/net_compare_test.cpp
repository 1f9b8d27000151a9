#include "cli/json.h"
#include "commands/net_commands.h"
#include "testing.h"

namespace revisit::cli {
namespace {

using reports::NetReport;

constexpr int kLayers = 2000, kPasses = 20;

/// Layers take `factor` ms, with skewed noise: most passes near the minimum, a few far above.
NetReport profile_of(double factor, unsigned seed, int passes = kPasses) {
  std::mt19937 random(seed);
  std::gamma_distribution<double> late(1.5, 0.02);
  NetReport report;
  for (int i = 0; i < kLayers; ++i) {
    std::vector<double> samples;
    for (int pass = 0; pass < passes; ++pass) samples.push_back(factor * (1 + late(random)));
    const profiling::Timing t = profiling::summarize(samples);
    reports::NetLayer& layer = *report.add_layers();
    layer.set_name("layer");
    reports::Timing& ms = *layer.mutable_ms();
    ms.set_min(t.min), ms.set_median(t.median), ms.set_p95(t.p95);
    ms.set_low(t.low), ms.set_high(t.high);
  }
  *report.mutable_total_ms() = report.layers(0).ms();
  *report.mutable_layer_sum_ms() = report.layers(1).ms();
  report.mutable_limits()->add_bandwidths();
  report.set_passes(passes);
  return report;
}

double share_of(const char* verdict, const NetReport& before, const NetReport& now) {
  const reports::NetComparison comparison = compare_profiles("old.json", before, now);
  int count = 0;
  for (const reports::NetChange& change : comparison.layers()) count += change.verdict() == verdict;
  return static_cast<double>(count) / kLayers;
}

TEST(NetCompare, NoiseAloneIsNoDifference) {
  EXPECT_GE(share_of("within noise", profile_of(1, 1), profile_of(1, 2)), 0.99);
}

TEST(NetCompare, FindsChangesBeyondNoise) {
  const NetReport before = profile_of(1, 1);
  EXPECT_GE(share_of("slower", before, profile_of(1.1, 2)), 0.95);
  EXPECT_GE(share_of("faster", before, profile_of(0.9, 3)), 0.95);
  EXPECT_EQ(share_of("faster", before, profile_of(1.1, 2)), 0);
}

TEST(NetCompare, BoundsHoldTheTrueChange) {
  const reports::NetComparison comparison =
      compare_profiles("old.json", profile_of(1, 1), profile_of(1.05, 2));
  int within = 0;
  for (const reports::NetChange& change : comparison.layers())
    within += change.low() <= 0.05 && 0.05 <= change.high();
  EXPECT_GE(within, 0.985 * kLayers);
}

TEST(NetCompare, LayersThatDoNotRunHaveNoVerdict) {
  NetReport before = profile_of(1, 1), now = profile_of(1, 2);
  before.mutable_layers(0)->mutable_ms()->Clear();
  now.mutable_layers(0)->mutable_ms()->Clear();
  before.mutable_layers(1)->mutable_ms()->Clear();  // fused before, separate now
  const reports::NetComparison comparison = compare_profiles("old.json", before, now);
  EXPECT_EQ(comparison.layers(0).verdict(), "");
  EXPECT_EQ(comparison.layers(1).verdict(), "slower");
  EXPECT_FALSE(comparison.layers(1).has_change());
}

/// A net of one layer, with a pass of 2 ms as median.
NetReport measured(double fastest_pass, double layer_ms, double peak_share, double memory_share) {
  NetReport report;
  report.mutable_total_ms()->set_min(fastest_pass);
  report.mutable_total_ms()->set_median(2);
  reports::NetLayer& layer = *report.add_layers();
  layer.set_name("conv1");
  layer.mutable_ms()->set_median(layer_ms);
  layer.set_peak_share(peak_share);
  layer.set_memory_share(memory_share);
  layer.set_best_ms(layer_ms * std::max(peak_share, memory_share));
  report.mutable_limits()->add_bandwidths();
  report.set_best_ms(layer.best_ms());
  clear_limits_if_busy(&report);
  return report;
}

TEST(NetProfile, HasNoLimitsIfItsFiguresProveABusyMachine) {
  struct Case {
    double fastest_pass, layer_ms, peak_share, memory_share;
    const char* busy;
  };
  for (const Case& c :
       {Case{1.9, 1.5, 0.9, 0.3, ""}, Case{1.4, 1.5, 1.05, 0.3, ""},
        Case{1.9, 0.002, 3, 0.3, ""},  // too short to prove anything
        Case{1.2, 1.5, 0.9, 0.3, "the median pass took 2.000 ms, the fastest 1.200 ms"},
        Case{1.9, 1.5, 1.2, 0.3, "layer 'conv1' took 1.500 ms, less than the 1.800 ms that"},
        Case{1.9, 1.5, 0.2, 1.4, "layer 'conv1' took 1.500 ms, less than the 2.100 ms that"}}) {
    const NetReport report = measured(c.fastest_pass, c.layer_ms, c.peak_share, c.memory_share);
    EXPECT_HAS(report.busy(), c.busy);
    EXPECT_EQ(report.has_busy(), *c.busy != '\0');
    for (const bool has :
         {report.has_limits(), report.has_best_ms(), report.layers(0).has_peak_share(),
          report.layers(0).has_memory_share(), report.layers(0).has_best_ms()})
      EXPECT_EQ(has, !report.has_busy()) << c.busy;
    testing::internal::CaptureStdout();
    print_net_report(report, "table");
    const std::string table = testing::internal::GetCapturedStdout();
    EXPECT_EQ(table.find("limits of 0 threads:") == std::string::npos, report.has_busy()) << table;
  }
}

TEST(NetCompare, RejectsProfilesOfOtherNets) {
  const TempDir dir;
  const auto write = [&](const NetReport& report) {
    write_file(dir / "old.json", to_json(report));
    return dir / "old.json";
  };
  EXPECT_EQ(read_profile(write(profile_of(1, 1))).layers_size(), kLayers);
  NetReport busy = profile_of(1, 1);
  busy.mutable_total_ms()->set_min(busy.total_ms().median() / 2);
  clear_limits_if_busy(&busy);
  EXPECT_EQ(read_profile(write(busy)).busy(), busy.busy());
  expect_error<InputError>([&] { read_profile(write({})); }, {"old.json", "--format json"});
  expect_error<InputError>([&] { read_profile(write(profile_of(1, 1, 7))); },
                           {"7 passes", "at least 8"});
  const NetReport one = profile_of(1, 1);
  need_same_net("old.json", one, one);
  NetReport other = one;
  other.mutable_layers(2)->set_type("ReLU");
  expect_error<InputError>([&] { need_same_net("old.json", one, other); },
                           {"old.json", "layer 3 is 'layer' (", "there", "ReLU", "here"});
  other = one;
  other.mutable_layers()->RemoveLast();
  expect_error<InputError>([&] { need_same_net("old.json", one, other); },
                           {"layer 2000 is 'layer'", "none here"});
  other = one;
  other.add_inputs()->set_name("data");
  expect_error<InputError>([&] { need_same_net("old.json", one, other); },
                           {"input 1 is none there, 'data'"});
}

}  // namespace
}  // namespace revisit::cli
