#include "run_layer.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>

#include "registry.h"
#include "revisit/proto/net_file.h"

namespace revisit::test {
namespace {

using engine::Kernel;
using engine::OutputMemory;
using engine::Shape;
using engine::Tensor;

std::vector<Tensor> with_shapes(const std::vector<Shape>& shapes,
                                const std::vector<std::vector<float>>& values) {
  EXPECT_EQ(shapes.size(), values.size());
  std::vector<Tensor> tensors;
  for (size_t i = 0; i < shapes.size(); ++i) {
    EXPECT_EQ(static_cast<size_t>(shapes[i].elements()), values.at(i).size());
    tensors.push_back({shapes[i], values[i]});
  }
  return tensors;
}

/// Runs the kernel on copies of the inputs; the first output is in the memory of the first input
/// when `in_place`.
std::vector<Tensor> execute(const Kernel& kernel, std::vector<Tensor> inputs,
                            const std::vector<Shape>& output_shapes, bool in_place) {
  std::vector<Tensor> outputs;
  for (const Shape& shape : output_shapes)
    outputs.push_back({shape, std::vector<float>(static_cast<size_t>(shape.elements()), kNan)});
  std::vector<float> scratch(static_cast<size_t>(kernel.scratch_floats), kNan);
  std::vector<const float*> in;
  std::vector<float*> out;
  for (Tensor& tensor : inputs) in.push_back(tensor.values.data());
  for (Tensor& tensor : outputs) out.push_back(tensor.values.data());
  if (in_place) out[0] = inputs[0].values.data();
  kernel.run({in, out, scratch.data()});
  if (in_place) outputs[0].values = inputs[0].values;
  return outputs;
}

void expect_same_bits(const std::vector<Tensor>& found, const std::vector<Tensor>& wanted,
                      const std::string& what) {
  for (size_t i = 0; i < wanted.size(); ++i)
    EXPECT_EQ(std::memcmp(found[i].values.data(), wanted[i].values.data(),
                          wanted[i].values.size() * sizeof(float)),
              0)
        << what << ", output " << i;
}

}  // namespace

std::unique_ptr<engine::Layer> layer_from(const std::string& type, const std::string& param) {
  const auto file =
      proto::parse_net("layer { name: 'l' type: '" + type + "' " + param + " }", "test");
  return engine::make_layer(file.net.layer(0));
}

std::vector<Tensor> run_layer(const std::string& type, const std::string& param,
                              const std::vector<Tensor>& inputs,
                              const std::vector<std::vector<float>>& weights, size_t n_outputs) {
  const auto layer = layer_from(type, param);
  std::vector<Shape> input_shapes;
  for (const Tensor& input : inputs) input_shapes.push_back(input.shape);
  const std::vector<Shape> output_shapes = layer->infer(input_shapes, n_outputs);
  const std::vector<Tensor> tensors = with_shapes(layer->weight_shapes(input_shapes), weights);

  std::vector<Tensor> outputs;
  if (layer->output_memory() == OutputMemory::kViewOfInput) {
    for (const Shape& shape : output_shapes) outputs.push_back({shape, inputs[0].values});
    return outputs;
  }
  const Kernel kernel = layer->bind({input_shapes, output_shapes, tensors, 1, false});
  outputs = execute(kernel, inputs, output_shapes, false);
  const Kernel threaded = layer->bind({input_shapes, output_shapes, tensors, 3, false});
  expect_same_bits(execute(threaded, inputs, output_shapes, false), outputs, type + ", 3 threads");
  if (layer->output_memory() == OutputMemory::kMayReuseInput)
    expect_same_bits(execute(kernel, inputs, output_shapes, true), outputs, type + " in place");
  return outputs;
}

std::vector<float> run(const std::string& type, const std::string& param, const Shape& shape,
                       const std::vector<float>& input,
                       const std::vector<std::vector<float>>& weights, Shape* output_shape) {
  const Tensor output = run_layer(type, param, {{shape, input}}, weights)[0];
  if (output_shape) *output_shape = output.shape;
  return output.values;
}

void expect_values(const std::vector<float>& found, const std::vector<float>& wanted,
                   float tolerance) {
  ASSERT_EQ(found.size(), wanted.size());
  for (size_t i = 0; i < found.size(); ++i) {
    if (std::isnan(wanted[i]))
      EXPECT_TRUE(std::isnan(found[i])) << i;
    else if (std::isinf(wanted[i]) || tolerance == 0)
      EXPECT_EQ(found[i], wanted[i]) << i;
    else
      EXPECT_NEAR(found[i], wanted[i], tolerance) << i;
  }
}

}  // namespace revisit::test
