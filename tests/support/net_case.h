#pragma once

#include <map>
#include <string>
#include <vector>

#include "layer.h"
#include "revisit/engine/net.h"

namespace revisit::test {

enum class Weights { kRandom, kNone };

/// Text `layers` follow an input "data". `end`: "END" or "END+GRAFT" of LoadOptions.
engine::Net small_net(const engine::Shape& data, const std::string& layers,
                      const std::string& end = "", Weights weights = Weights::kRandom);

/// The output has the name of the layer, for in_place() the name of its input.
std::string conv(const std::string& name, const std::string& bottom,
                 const std::string& param = "num_output: 32 kernel_size: 3 pad: 1");
std::string layer(const std::string& name, const std::string& type,
                  const std::vector<std::string>& bottoms, const std::string& param = "");
std::string in_place(const std::string& name, const std::string& type, const std::string& blob,
                     const std::string& param = "");

/// Range: [-1, 1).
void fill_randomly(engine::Run& run, unsigned seed = 1);

/// Returns outputs by name, for inputs of fill_randomly().
std::map<std::string, engine::Tensor> forward(const engine::Net& net,
                                              const engine::PlanOptions& options,
                                              unsigned seed = 1);

/// Tolerance relative to the largest value of a blob; more for plans with a Winograd kernel
/// (tests/golden/README.md).
double tolerance_of(const engine::Plan& plan, double otherwise = 1e-5);

/// Expects results of the reference kernels without fusions, bitwise equal on three threads.
/// Returns the plan.
engine::Plan expect_as_reference(const engine::Net& net, engine::PlanOptions options = {});

std::string kernel_of(const engine::Plan& plan, const std::string& layer);

}  // namespace revisit::test
