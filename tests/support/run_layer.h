#pragma once

#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "layer.h"

/// One layer on its own, described by prototxt text, weights given in place.
namespace revisit::test {

constexpr float kInf = std::numeric_limits<float>::infinity();
constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

/// `param` is what stands in the layer beside its name and type.
std::unique_ptr<engine::Layer> layer_from(const std::string& type, const std::string& param);

/// Runs a layer and returns all outputs. Expects on the way that outputs and scratch are written
/// before they are read, that three threads give the same bits as one, and that a layer which may
/// overwrite its input gives the same when it does.
std::vector<engine::Tensor> run_layer(const std::string& type, const std::string& param,
                                      const std::vector<engine::Tensor>& inputs,
                                      const std::vector<std::vector<float>>& weights = {},
                                      size_t n_outputs = 1);

/// The same for one input and one output.
std::vector<float> run(const std::string& type, const std::string& param,
                       const engine::Shape& shape, const std::vector<float>& input,
                       const std::vector<std::vector<float>>& weights = {},
                       engine::Shape* output_shape = nullptr);

/// Values that agree within `tolerance` (0: exactly); NaN equals NaN.
void expect_values(const std::vector<float>& found, const std::vector<float>& wanted,
                   float tolerance = 0);

}  // namespace revisit::test
