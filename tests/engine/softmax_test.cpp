#include "kernels/nchw.h"
#include "simd_targets.h"
#include "single_layer.h"
#include "testing.h"

namespace revisit::engine {
namespace {

constexpr unsigned kSoftmaxSeed = 20261123;

TEST(Softmax, ReferenceByHand) {
  // Two lines of three classes, side by side: logarithms of 1, 2, 5 and of 4, 4, 8.
  const std::vector<float> in = {
      0, std::log(4.0F), std::log(2.0F), std::log(4.0F), std::log(5.0F), std::log(8.0F)};
  std::vector<float> out = in;
  softmax_reference(out.data(), {1, 3, 2}, out.data());
  test::expect_near(out, {0.125F, 0.25F, 0.25F, 0.25F, 0.625F, 0.5F}, 1e-7F);
}

TEST(Softmax, IsItsReferenceInPlaceToo) {
  for (const AxisRuns lines :
       {AxisRuns{1, 20000, 1}, AxisRuns{3, 2, 1}, AxisRuns{1, 1, 5}, AxisRuns{2, 21, 1037},
        AxisRuns{1, 3, 16}, AxisRuns{2, 7, 19}, AxisRuns{0, 4, 4}, AxisRuns{1, 20000, 5}}) {
    SCOPED_TRACE(testing::Message() << lines.outer << " x " << lines.size << " x " << lines.inner);
    std::vector<float> in =
        test::random_floats(lines.outer * lines.size * lines.inner, kSoftmaxSeed);
    for (float& x : in) x *= lines.size > 10000 ? 1e-3F : 30;  // many powers near 1
    std::vector<float> wanted(in.size());
    softmax_reference(in.data(), lines, wanted.data());
    test::for_each_simd_target([&] {
      std::vector<float> first(in.size(), NAN);
      softmax(in.data(), lines, first.data(), 1);
      for (size_t i = 0; i < in.size(); ++i)
        ASSERT_NEAR(first[i], wanted[i], 2e-6 * wanted[i] + 1e-30) << i;
      for (const int threads : {1, 2, 3, 7}) {
        std::vector<float> in_place = in;
        softmax(in_place.data(), lines, in_place.data(), threads);
        EXPECT_EQ(in_place, first) << threads << " threads";
      }
    });
  }
}

TEST(Softmax, OfNumbersThatAreNotFinite) {
  const float inf = INFINITY;
  // Columns: a NaN, two infinities, a minus infinity, all minus infinity, large ones.
  const std::vector<float> in = {1,   2,   -inf, -inf, 3e38F,   //
                                 NAN, inf, 0,    -inf, -3e38F,  //
                                 3,   inf, 0,    -inf, 0};
  const auto check = [](const std::vector<float>& out) {
    for (const size_t line : {0, 1, 3})
      for (const size_t c : {0, 1, 2})
        EXPECT_TRUE(std::isnan(out[c * 5 + line])) << line << ", " << c;
    EXPECT_EQ(out[2], 0);
    EXPECT_FLOAT_EQ(out[7], 0.5F);
    EXPECT_EQ(out[4], 1);
    EXPECT_EQ(out[9], 0);
  };
  std::vector<float> out(in.size());
  softmax_reference(in.data(), {1, 3, 5}, out.data());
  check(out);
  test::for_each_simd_target([&] {
    softmax(in.data(), {1, 3, 5}, out.data());
    check(out);
  });
}

}  // namespace
}  // namespace revisit::engine
