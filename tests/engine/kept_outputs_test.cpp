#include "net_case.h"
#include "testing.h"

namespace revisit::engine {
namespace {

Net two_convolutions() {
  return small_net(
      {1, 16, 13, 17},
      conv("c1", "data") + in_place("r1", "ReLU", "c1") + conv("c2", "c1") +
          in_place("r2", "ReLU", "c2") + test::layer("drop", "Dropout", {"c2"}) +
          test::layer("p", "Pooling", {"drop"}, "pooling_param { kernel_size: 3 stride: 2 }"));
}

std::vector<float> kept_layer(const Net& net, const PlanOptions& options, const char* layer) {
  engine::Run run(net.plan({}, options));
  test::fill_randomly(run);
  run.forward();
  const auto values = run.layer_output(layer).values();
  return {values.begin(), values.end()};
}

TEST(KeptOutputs, AreThoseOfAPlanThatKeepsAll) {
  const Net net = two_convolutions();
  for (const char* layer : {"data", "c1", "r1", "c2", "r2", "drop", "p"})
    EXPECT_LE(relative_error(kept_layer(net, {.keep = {layer}}, layer),
                             kept_layer(net, {.keep_all = true}, layer)),
              1e-5)
        << layer;
}

TEST(KeptOutputs, LayersThatDoNotOverwriteThemAreFused) {
  const Net net = two_convolutions();
  const Plan before = net.plan({}, {.keep = {"c1", "r2"}}), after = net.plan({}, {.keep = {"r1"}});
  EXPECT_NE(kernel_of(before, "r1"), "in c1");
  EXPECT_EQ(kernel_of(before, "r2"), "in c2");
  EXPECT_EQ(kernel_of(after, "r1"), "in c1");
  test::expect_as_reference(net, {.keep = {"c1", "r2"}});
}

TEST(KeptOutputs, OfOtherLayersAreNotReadable) {
  const Net net = two_convolutions();
  const engine::Run run(net.plan({}, {.keep = {"c1"}}));
  expect_error<UsageError>([&] { static_cast<void>(run.layer_output("c2")); }, {"c2"});
  expect_error<UsageError>([&] { net.plan({}, {.keep = {"C1"}}); },
                           {"keep", "has no layer 'C1'", "did you mean 'c1'"});
}

}  // namespace
}  // namespace revisit::engine
