#pragma once

#include <string>
#include <vector>

#include "single_layer.h"

namespace revisit::test {

/// Returns all outputs. Expects bitwise equal results with one and three threads, and in place if
/// the layer allows it.
std::vector<engine::Tensor> run_checked(const std::string& type, const std::string& param,
                                        const std::vector<engine::Tensor>& inputs,
                                        const std::vector<std::vector<float>>& weights = {},
                                        size_t n_outputs = 1);

std::vector<float> run(const std::string& type, const std::string& param,
                       const engine::Shape& shape, const std::vector<float>& input,
                       const std::vector<std::vector<float>>& weights = {},
                       engine::Shape* output_shape = nullptr);

}  // namespace revisit::test
