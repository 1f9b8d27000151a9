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

TEST(NetCompare, RejectsProfilesOfOtherNets) {
  const TempDir dir;
  const auto write = [&](const NetReport& report) {
    write_file(dir / "old.json", to_json(report));
    return dir / "old.json";
  };
  EXPECT_EQ(read_profile(write(profile_of(1, 1))).layers_size(), kLayers);
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
