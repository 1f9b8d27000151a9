#include "blocked.h"
#include "schedule.h"
#include "simd_targets.h"
#include "single_layer.h"
#include "testing.h"

namespace revisit::engine {
namespace {

constexpr unsigned kLayerSeed = 20261124;

struct LayerCase {
  std::string type, param;
  std::vector<Shape> inputs;
  size_t n_outputs = 1;
  Fusion fusion = {};
};

int64_t pixels_of(const Shape& shape) {
  return shape.product(2, shape.rank());
}

/// Numbers that are exact in bfloat16, including zeros, infinities and NaN.
std::vector<float> values_of(const Shape& shape, unsigned seed, bool specials) {
  std::vector<float> values = test::random_floats(shape.elements(), seed);
  const float kSpecials[] = {0.0F, -0.0F, NAN, INFINITY, -INFINITY, 3e38F, -30.0F, 8.0F};
  for (size_t i = seed % 3; specials && i < values.size(); i += 5)
    values[i] = kSpecials[i / 5 % std::size(kSpecials)];
  for (float& value : values) value = to_float(to_bfloat16(value));
  return values;
}

test::AlignedFloats laid_out(const Tensor& value, Layout layout, Precision precision) {
  if (layout == Layout::kNchw) {
    test::AlignedFloats plain(value.shape.elements(), test::kNanByte);
    std::copy(value.values.begin(), value.values.end(), plain.data());
    return plain;
  }
  auto blocked =
      test::to_blocked(value.shape[0], value.shape[1], pixels_of(value.shape), value.values);
  return precision == Precision::kBf16 ? test::rounded_to_bf16(blocked) : std::move(blocked);
}

/// Returns outputs in NCHW; expects zero padding lanes.
std::vector<Tensor> run_blocked(const LayerCase& c, const std::vector<Tensor>& inputs, int threads,
                                Precision precision) {
  const auto layer = test::layer_of(c.type, c.param);
  std::vector<Shape> own = c.inputs;
  if (c.fusion.adds_last_input) own.pop_back();
  const std::vector<Shape> outputs = layer->infer(own, c.n_outputs);
  const std::vector<Tensor> no_weights;
  Binding binding{c.inputs, outputs, no_weights, threads};
  binding.precision = precision;
  binding.layouts.assign(c.inputs.size(), Layout::kNChw16c);
  binding.fusion = c.fusion;
  const Kernel kernel = bind_operation(*layer, layer->form(own, {}), binding);
  EXPECT_EQ(kernel.writes, Layout::kNChw16c) << "no kernel for blocks";
  std::vector<test::AlignedFloats> in, out;
  std::vector<const float*> in_pointers;
  std::vector<float*> out_pointers;
  for (size_t i = 0; i < inputs.size(); ++i)
    in.push_back(laid_out(inputs[i], kernel.reads[i], precision));
  for (const Shape& shape : outputs)
    out.emplace_back(shape[0] * padded_channels(shape[1]) * pixels_of(shape) *
                         value_bytes(precision) / value_bytes(Precision::kFloat32),
                     test::kNanByte);
  for (const auto& values : in) in_pointers.push_back(values.data());
  for (auto& values : out) out_pointers.push_back(values.data());
  kernel.run({in_pointers, out_pointers, nullptr});
  std::vector<Tensor> results;
  for (size_t i = 0; i < outputs.size(); ++i) {
    const auto wide = precision == Precision::kBf16 ? test::widened(out[i]) : std::move(out[i]);
    const int64_t n = outputs[i][0], channels = outputs[i][1], pixels = pixels_of(outputs[i]);
    EXPECT_EQ(test::find_dirty_tail(n, channels, pixels, wide.values()), -1) << "output " << i;
    results.push_back({outputs[i], test::to_plain(n, channels, pixels, wide.values())});
  }
  return results;
}

/// Non-finite values must be equal.
void expect_close(const std::vector<float>& found, const std::vector<float>& wanted,
                  float tolerance) {
  ASSERT_EQ(found.size(), wanted.size());
  for (size_t i = 0; i < found.size(); ++i)
    if (std::isfinite(wanted[i]))
      ASSERT_NEAR(found[i], wanted[i], tolerance * std::abs(wanted[i])) << i;
    else
      ASSERT_TRUE(found[i] == wanted[i] || (std::isnan(found[i]) && std::isnan(wanted[i])))
          << i << ": " << found[i] << " instead of " << wanted[i];
}

std::vector<float> rounded_to(Precision precision, std::vector<float> values) {
  if (precision == Precision::kBf16)
    for (float& value : values) value = to_float(to_bfloat16(value));
  return values;
}

std::vector<Tensor> run_plain(const LayerCase& c, std::vector<Tensor> inputs) {
  Tensor addend;
  if (c.fusion.adds_last_input) {
    addend = std::move(inputs.back());
    inputs.pop_back();
  }
  std::vector<Tensor> outputs = test::run_layer({c.type, c.param, inputs, {}, c.n_outputs});
  std::vector<float>& values = outputs[0].values;
  for (size_t i = 0; i < addend.values.size(); ++i) values[i] += addend.values[i];
  if (c.fusion.activation.epilogue.activation == Epilogue::Activation::kRelu)
    for (float& x : values) x = std::max(x, 0.0F) + 0 * std::min(x, 0.0F);  // as Caffe's
  return outputs;
}

/// Products and sums of two numbers round equally in both layouts, so results are equal, and
/// rounded once in bfloat16.
void expect_as_plain(const LayerCase& c, float tolerance = 0) {
  SCOPED_TRACE(testing::Message() << c.type << " " << c.param << " of " << c.inputs[0]);
  for (const bool specials : {false, true}) {
    std::vector<Tensor> inputs;
    for (const Shape& shape : c.inputs)
      inputs.push_back(
          {shape, values_of(shape, kLayerSeed + static_cast<unsigned>(inputs.size()), specials)});
    const std::vector<Tensor> wanted = run_plain(c, inputs);
    test::for_each_simd_target([&] {
      for (const Precision precision : {Precision::kFloat32, Precision::kBf16}) {
        SCOPED_TRACE(precision == Precision::kBf16 ? "bf16" : "float32");
        const std::vector<Tensor> found = run_blocked(c, inputs, 1, precision);
        for (size_t i = 0; i < wanted.size(); ++i)
          expect_close(found[i].values, rounded_to(precision, wanted[i].values),
                       tolerance > 0 && precision == Precision::kBf16 ? 1.0F / 256 : tolerance);
        for (const int threads : {2, 3, 7}) {
          const std::vector<Tensor> more = run_blocked(c, inputs, threads, precision);
          for (size_t i = 0; i < wanted.size(); ++i)
            EXPECT_EQ(std::memcmp(found[i].values.data(), more[i].values.data(),
                                  found[i].values.size() * sizeof(float)),
                      0)
                << threads << " threads";
        }
      }
    });
  }
}

const Shape kShapes[] = {
    {1, 16, 5, 7}, {2, 35, 3, 11}, {3, 1, 1, 1}, {1, 20, 40, 60}, {2, 48, 9, 2}};

TEST(BlockedGate, AgreesWithScaleAndAxpy) {
  Fusion relu, sum;
  relu.activation.epilogue.activation = Epilogue::Activation::kRelu;
  sum.adds_last_input = true;
  Fusion sum_and_relu = relu;
  sum_and_relu.adds_last_input = true;
  for (const Shape& x : kShapes) {
    const Shape factors{x[0], x[1]};
    for (const Fusion& fusion : {Fusion{}, relu})
      expect_as_plain({"Scale", "scale_param { axis: 0 }", {x, factors}, 1, fusion});
    for (const Fusion& fusion : {sum, sum_and_relu})
      expect_as_plain({"Scale", "scale_param { axis: 0 }", {x, factors, x}, 1, fusion});
    for (const Fusion& fusion : {Fusion{}, relu})
      expect_as_plain({"Axpy", "", {Shape{x[0], x[1], 1, 1}, x, x}, 1, fusion});
  }
}

TEST(BlockedSlice, CopiesWholeBlocks) {
  for (const auto& [channels, points] :
       {std::pair<int64_t, const char*>{48, "slice_point: 16 slice_point: 32"},
        {64, "slice_point: 16 slice_point: 48"},
        {43, "slice_point: 16 slice_point: 32"}})
    for (const int64_t n : {1, 2})
      expect_as_plain({"Slice", str("slice_param { ", points, " }"), {{n, channels, 5, 67}}, 3});
}

TEST(BlockedShuffle, AgreesWithTheLayer) {
  for (const auto& [channels, group] :
       {std::pair<int64_t, int>{48, 3}, {20, 2}, {35, 5}, {64, 64}, {34, 17}, {7, 1}})
    for (const int64_t n : {1, 3})
      expect_as_plain({"ShuffleChannel",
                       str("shuffle_channel_param { group: ", group, " }"),
                       {{n, channels, 3, 401}}});
}

TEST(BlockedShuffle, ReversesChannels) {
  for (const int64_t channels : {1, 16, 35})
    expect_as_plain({"Reverse", "reverse_param { axis: 1 }", {{2, channels, 3, 401}}});
}

}  // namespace
}  // namespace revisit::engine
