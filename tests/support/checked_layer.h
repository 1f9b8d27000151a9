#pragma once

#include <string>
#include <vector>

#include "single_layer.h"

/// One layer on its own, run in every way a plan may run it.
namespace revisit::test {

/// Runs a layer and returns all outputs. Expects on the way that three threads give the same bits
/// as one, and that a layer which may overwrite its input gives the same bits when it does.
std::vector<engine::Tensor> run_checked(const std::string& type, const std::string& param,
                                        const std::vector<engine::Tensor>& inputs,
                                        const std::vector<std::vector<float>>& weights = {},
                                        size_t n_outputs = 1);

/// The same for one input and one output.
std::vector<float> run(const std::string& type, const std::string& param,
                       const engine::Shape& shape, const std::vector<float>& input,
                       const std::vector<std::vector<float>>& weights = {},
                       engine::Shape* output_shape = nullptr);

}  // namespace revisit::test
