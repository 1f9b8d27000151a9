#pragma once

#include <map>
#include <string>
#include <vector>

#include "revisit/engine/net.h"

namespace revisit::test {

enum class Weights { kRandom, kNone };

/// A net of a few layers in text: `layers` follow an input "data" of this shape.
engine::Net small_net(const engine::Shape& data, const std::string& layers,
                      const engine::Truncation& truncation = {},
                      Weights weights = Weights::kRandom);

/// Layers as text. The output has the name of the layer, or for in_place() of its input.
std::string conv(const std::string& name, const std::string& bottom,
                 const std::string& param = "num_output: 32 kernel_size: 3 pad: 1");
std::string layer(const std::string& name, const std::string& type,
                  const std::vector<std::string>& bottoms, const std::string& param = "");
std::string in_place(const std::string& name, const std::string& type, const std::string& blob,
                     const std::string& param = "");

/// Fills all inputs of a run with numbers between -1 and 1 that `seed` makes.
void fill_randomly(engine::Run& run, unsigned seed = 1);

/// Outputs of one pass, by name, on inputs that fill_randomly() makes.
std::map<std::string, engine::Tensor> forward(const engine::Net& net,
                                              const engine::PlanOptions& options,
                                              unsigned seed = 1);

/// tests/golden/README.md, of the largest value of a blob: more where the plan has a Winograd
/// kernel.
double tolerance_of(const engine::Plan& plan, double otherwise = 1e-5);

/// Expects that the plan with `options` gives what the reference kernels give without any rewrite
/// and the same bits on three threads, and returns it.
engine::Plan expect_as_reference(const engine::Net& net, engine::PlanOptions options = {});

/// The kernel that the plan shows for a layer.
std::string kernel_of(const engine::Plan& plan, const std::string& layer);

}  // namespace revisit::test
