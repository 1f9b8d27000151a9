#include "blocked.h"
#include "kernels/blocked/kernels.h"
#include "kernels/epilogue.h"
#include "simd_targets.h"
#include "single_layer.h"
#include "testing.h"

namespace revisit::engine {
namespace {

struct DefinedActivation {
  Epilogue epilogue;
  std::function<double(double)> definition;
};

const DefinedActivation kActivations[] = {
    {{Epilogue::Activation::kRelu, 0.25F}, [](double x) { return x < 0 ? 0.25 * x : x; }},
    {{Epilogue::Activation::kClip, 0, -1, 6}, [](double x) { return x < -1  ? -1
                                                                    : x > 6 ? 6
                                                                            : x; }},
    {{Epilogue::Activation::kElu, 1.5F}, [](double x) { return x < 0 ? 1.5 * std::expm1(x) : x; }},
    {{Epilogue::Activation::kSigmoid}, test::sigmoid},
    {{Epilogue::Activation::kSwish, -1.5F},  // its product is computed in float
     [](double x) { return x * test::sigmoid(static_cast<float>(-1.5 * x)); }},
    {{Epilogue::Activation::kTanh}, [](double x) { return std::tanh(x); }},
    {{Epilogue::Activation::kBnll},
     [](double x) { return std::max(x, 0.0) + std::log1p(std::exp(-std::abs(x))); }},
    {{Epilogue::Activation::kMish},
     [](double x) { return x * std::tanh(std::log1p(std::exp(x))); }}};

std::vector<float> numbers() {
  std::vector<float> x = {0, -0.0F, NAN, INFINITY, -INFINITY, FLT_MAX, -FLT_MAX, FLT_MIN, 1e-20F};
  for (double magnitude = 1e-6; magnitude < 200; magnitude *= 1.01)
    for (const double sign : {1, -1}) x.push_back(static_cast<float>(sign * magnitude));
  return x;
}

TEST(Activations, AreTheirDefinitions) {
  const std::vector<float> x = numbers();
  for (const auto& [epilogue, definition] : kActivations) {
    SCOPED_TRACE(testing::Message() << "activation " << static_cast<int>(epilogue.activation));
    // exp(x) - 1 loses digits for small x, as in Caffe.
    const double small = epilogue.activation == Epilogue::Activation::kElu ? 2e-7 : FLT_MIN;
    test::for_each_simd_target([&] {
      std::vector<float> y(x.size(), NAN);
      activate(epilogue, std::ssize(x), x.data(), y.data());
      for (size_t i = 0; i < x.size(); ++i) {
        const double wanted = definition(x[i]);
        if (std::isfinite(wanted))
          EXPECT_NEAR(y[i], wanted, 5e-7 * std::abs(wanted) + small) << x[i];
        else
          EXPECT_TRUE(std::isnan(wanted) ? std::isnan(y[i]) : y[i] == wanted) << x[i];
      }
    });
  }
}

TEST(Activations, DoNotDependOnThePlace) {
  const std::vector<float> x = numbers();
  const int64_t count = std::ssize(x);
  const auto same = [](const float* a, const float* b, int64_t n) {
    return std::memcmp(a, b, n * sizeof(float)) == 0;
  };
  for (const auto& [epilogue, definition] : kActivations)
    test::for_each_simd_target([&] {
      std::vector<float> all(x.size());
      activate(epilogue, count, x.data(), all.data());
      for (const int64_t first : {1, 2, 7, 16, 33})
        for (const int64_t n : {0, 1, 5, 15, 16, 17, 100}) {
          std::vector<float> some(x.begin() + first, x.begin() + first + n + 1);
          activate(epilogue, n, some.data(), some.data());
          EXPECT_TRUE(same(some.data(), all.data() + first, n)) << first << ", " << n;
          EXPECT_TRUE(same(&some.back(), &x[first + n], 1)) << "beyond the last";
        }
      if (!has_blocked_kernels()) return;
      test::AlignedFloats blocked = test::to_blocked(1, 1, count, x);
      blocked_activation({1, 1, count, 2}, epilogue, blocked.data(), blocked.data());
      EXPECT_TRUE(same(test::to_plain(1, 1, count, blocked.values()).data(), all.data(), count));
      EXPECT_EQ(test::find_dirty_tail(1, 1, count, blocked.values()), -1);
    });
}

}  // namespace
}  // namespace revisit::engine
