#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <random>

#include "layer.h"
#include "layers/layers.h"
#include "revisit/proto/net_file.h"
#include "testing.h"

namespace revisit::test {

constexpr float kInf = std::numeric_limits<float>::infinity();
constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

inline std::unique_ptr<engine::Layer> layer_of(const std::string& type, const std::string& param) {
  const auto file =
      proto::parse_net("layer { name: 'l' type: '" + type + "' " + param + " }", "test");
  return engine::make_layer(file.net.layer(0));
}

/// Making the layer or inferring its output shapes must throw `Wanted`, with all `parts` in the
/// message.
template <class Wanted = InputError>
void expect_rejected(const std::string& type, const std::string& param,
                     const std::vector<engine::Shape>& inputs,
                     std::initializer_list<std::string> parts, size_t n_outputs = 1) {
  expect_error<Wanted>([&] { layer_of(type, param)->infer(inputs, n_outputs); }, parts);
}

struct SingleLayer {
  std::string type, param;  // as in a prototxt: "lrn_param { local_size: 3 }"
  std::vector<engine::Tensor> inputs;
  std::vector<std::vector<float>> weights = {};
  size_t n_outputs = 1;
  int threads = 1;
  bool reference = false;
  int passes = 1;         // forward passes; the outputs are those of the last
  bool in_place = false;  // the first output overwrites the first input
};

/// Poisons outputs with NaN, scratch with 0xA5 bytes.
inline std::vector<engine::Tensor> run_layer(const SingleLayer& l) {
  using namespace engine;
  const auto layer = layer_of(l.type, l.param);
  std::vector<Shape> inputs;
  std::vector<const float*> in;
  for (const Tensor& input : l.inputs) {
    EXPECT_EQ(static_cast<size_t>(input.shape.elements()), input.values.size());
    inputs.push_back(input.shape);
    in.push_back(input.values.data());
  }
  const std::vector<Shape> shapes = layer->infer(inputs, l.n_outputs);
  const std::vector<Shape> weight_shapes = layer->weight_shapes(inputs);
  EXPECT_EQ(weight_shapes.size(), l.weights.size());
  std::vector<Tensor> weights;
  for (size_t i = 0; i < weight_shapes.size(); ++i) {
    EXPECT_EQ(static_cast<size_t>(weight_shapes[i].elements()), l.weights[i].size()) << i;
    weights.push_back({weight_shapes[i], l.weights[i]});
  }
  const Kernel kernel = layer->bind({inputs, shapes, weights, l.threads, l.reference});
  std::vector<Tensor> outputs;
  std::vector<float*> out;
  for (const Shape& shape : shapes)
    outputs.push_back({shape, std::vector<float>(static_cast<size_t>(shape.elements()), kNan)});
  for (Tensor& output : outputs) out.push_back(output.values.data());
  if (l.in_place) {
    outputs[0].values = l.inputs[0].values;
    in[0] = out[0] = outputs[0].values.data();
  }
  std::vector<float> scratch(static_cast<size_t>(kernel.scratch.count) / sizeof(float));
  if (!scratch.empty()) std::memset(scratch.data(), 0xA5, scratch.size() * sizeof(float));
  std::vector<float> state(static_cast<size_t>(kernel.state.count) / sizeof(float), 0.0F);
  const auto held = kernel.hold ? kernel.hold() : nullptr;
  int64_t rows = -1;
  for (int pass = 0; pass < l.passes; ++pass)
    kernel.run({in, out, scratch.data(), state.data(), &rows, held.get()});
  if (const auto axis = layer->dynamic_axis())
    for (Tensor& output : outputs) {
      output.shape = output.shape.with_rows(*axis, rows);
      output.values.resize(static_cast<size_t>(output.shape.elements()));
    }
  return outputs;
}

inline double sigmoid(double x) {
  return 1 / (1 + std::exp(-x));
}

/// NaN and infinity must be equal, others within `tolerance`.
inline void expect_near(const std::vector<float>& found, const std::vector<float>& wanted,
                        float tolerance = 0) {
  ASSERT_EQ(found.size(), wanted.size());
  for (size_t i = 0; i < found.size(); ++i) {
    if (std::isnan(wanted[i]))
      EXPECT_TRUE(std::isnan(found[i])) << i << ": " << found[i];
    else if (std::isinf(wanted[i]) || tolerance == 0)
      EXPECT_EQ(found[i], wanted[i]) << i;
    else
      EXPECT_NEAR(found[i], wanted[i], tolerance) << i;
  }
}

inline std::vector<float> random_floats(int64_t count, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> uniform(-1, 1);
  std::vector<float> values(static_cast<size_t>(count));
  for (float& value : values) value = uniform(random);
  return values;
}

}  // namespace revisit::test
