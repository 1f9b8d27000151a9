#include "checked_layer.h"

namespace revisit::test {
namespace {

using engine::OutputMemory;
using engine::Shape;
using engine::Tensor;

void expect_same_bits(const std::vector<Tensor>& found, const std::vector<Tensor>& wanted,
                      const std::string& what) {
  ASSERT_EQ(found.size(), wanted.size());
  for (size_t i = 0; i < wanted.size(); ++i)
    EXPECT_EQ(std::memcmp(found[i].values.data(), wanted[i].values.data(),
                          wanted[i].values.size() * sizeof(float)),
              0)
        << what << ", output " << i;
}

}  // namespace

std::vector<Tensor> run_checked(const std::string& type, const std::string& param,
                                const std::vector<Tensor>& inputs,
                                const std::vector<std::vector<float>>& weights, size_t n_outputs) {
  const auto layer = layer_of(type, param);
  if (layer->output_memory() == OutputMemory::kViewOfInput) {
    std::vector<Shape> shapes;
    for (const Tensor& input : inputs) shapes.push_back(input.shape);
    std::vector<Tensor> outputs;
    for (const Shape& shape : layer->infer(shapes, n_outputs))
      outputs.push_back({shape, inputs[0].values});
    return outputs;
  }
  SingleLayer single{type, param, inputs, weights, n_outputs};
  const std::vector<Tensor> outputs = run_layer(single);
  single.threads = 3;
  expect_same_bits(run_layer(single), outputs, type + ", 3 threads");
  single.in_place = layer->output_memory() == OutputMemory::kMayReuseInput;
  if (single.in_place) expect_same_bits(run_layer(single), outputs, type + ", in place");
  return outputs;
}

std::vector<float> run(const std::string& type, const std::string& param, const Shape& shape,
                       const std::vector<float>& input,
                       const std::vector<std::vector<float>>& weights, Shape* output_shape) {
  const Tensor output = run_checked(type, param, {{shape, input}}, weights)[0];
  if (output_shape) *output_shape = output.shape;
  return output.values;
}

}  // namespace revisit::test
