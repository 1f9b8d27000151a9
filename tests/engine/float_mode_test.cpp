#include "kernels/float_mode.h"

#include <cfenv>

#include "revisit/engine/net.h"
#include "testing.h"

namespace revisit::engine {
namespace {

/// Activations about 1e-40, then NCHWc layers, NCHW layers and a matrix product.
constexpr const char* kFaded = R"(
  layer { name: "in" type: "Input" top: "data" input_param { shape { dim: 2 dim: 20 dim: 40 dim: 40 } } }
  layer { name: "a" type: "Power" bottom: "data" top: "a" power_param { scale: 1e-30 } }
  layer { name: "b" type: "Power" bottom: "a" top: "b" power_param { scale: 1e-10 } }
  layer { name: "c" type: "Convolution" bottom: "b" top: "c" convolution_param { num_output: 20 kernel_size: 3 bias_term: false } }
  layer { name: "d" type: "ReLU" bottom: "c" top: "d" }
  layer { name: "e" type: "InnerProduct" bottom: "d" top: "e" inner_product_param { num_output: 30 bias_term: false } })";

class Denormals : public testing::Test {
 protected:
  Denormals() {
    write_file(dir_ / "net.prototxt", kFaded);
    net_.emplace(Net::load_with_random_weights(dir_ / "net.prototxt", 1));
  }

  std::vector<float> output(const PlanOptions& options) const {
    engine::Run run(net_->plan({}, options));
    const std::span<float> input = run.input("data").values();
    for (size_t i = 0; i < input.size(); ++i)
      input[i] = static_cast<float>(i * 7919 % 13) / 13 * 2 - 1;
    run.forward();
    const auto values = run.output("e").values();
    return {values.begin(), values.end()};
  }

  const TempDir dir_;
  std::optional<Net> net_;
};

bool is_denormal(float x) {
  return std::fpclassify(x) == FP_SUBNORMAL;
}

bool same_bits(const std::vector<float>& a, const std::vector<float>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(float)) == 0;
}

TEST_F(Denormals, AreZeroUnlessKeptForAnyNumberOfThreads) {
  const std::vector<float> flushed = output({}), kept = output({.flush_denormals = false});
  EXPECT_EQ(std::count(flushed.begin(), flushed.end(), 0.0F), std::ssize(flushed));
  EXPECT_GT(std::count_if(kept.begin(), kept.end(), is_denormal), std::ssize(kept) / 2);
  for (const int threads : {2, 3, 7, 16}) {
    EXPECT_TRUE(same_bits(output({.threads = threads}), flushed)) << threads;
    EXPECT_TRUE(same_bits(output({.threads = threads, .flush_denormals = false}), kept)) << threads;
  }
}

TEST_F(Denormals, TheCallersModeIsThatOfEveryThread) {
  {
    const FloatModeScope scope(FloatMode::current().flushing_denormals());
    const std::vector<float> one = output({.flush_denormals = false});
    EXPECT_EQ(std::count(one.begin(), one.end(), 0.0F), std::ssize(one));
    EXPECT_TRUE(same_bits(output({.threads = 7, .flush_denormals = false}), one));
  }
  std::fesetround(FE_UPWARD);
  const std::vector<float> one = output({.flush_denormals = false});
  const std::vector<float> seven = output({.threads = 7, .flush_denormals = false});
  std::fesetround(FE_TONEAREST);
  EXPECT_TRUE(same_bits(seven, one));
}

bool keeps_denormals() {
  volatile float tiny = 1e-30F;
  return tiny * 1e-10F != 0;
}

TEST_F(Denormals, TheModeOfTheCallerIsAsBeforeAfterAPass) {
  ASSERT_TRUE(keeps_denormals());
  output({.threads = 7});
  EXPECT_TRUE(keeps_denormals());
}

}  // namespace
}  // namespace revisit::engine
