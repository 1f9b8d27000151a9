#pragma once

#include <map>
#include <set>
#include <string>
#include <vector>

#include "random.h"
#include "revisit/engine/net.h"

namespace revisit::random_nets {

using Values = std::map<std::string, engine::Tensor>;

/// What the names of layers' outputs begin with among the Values of a run.
inline const std::string kLayer = "layer ";

/// Fills the inputs of a run, runs it, and returns its outputs and, of a plan that keeps them,
/// those of all layers, by kLayer and port name.
Values forward(engine::Run& run, const Values& inputs, engine::StepObserver* observer = nullptr);

/// Largest difference within each channel (axis 1; of fewer axes: everything).
std::vector<double> differences(const engine::Tensor& a, const engine::Tensor& b);

/// How far kernels may round.
struct Noise {
  /// By layer that rounds, relative to the largest value of each channel of its output.
  std::map<std::string, double> of_layers;
  /// What the terms of a sum round, in parts of that and relative to the layer's inputs.
  double of_terms = 0.01;
  /// By layer: how large its output is for inputs of size 1 when chance does not cancel it out (the
  /// length of an output's weights). Partial sums of that size are rounded, whatever is left of
  /// them.
  std::map<std::string, double> of_weights = {};
  /// By layer that subtracts a mean, relative to its inputs: what is left of a channel of equal
  /// numbers. The reference kernels, which sum in double, leave 0, and layers may add a shift.
  std::map<std::string, double> of_means = {};
};

/// What the reference kernels give, and how far off rounding may be.
class Reference {
 public:
  Reference(const engine::Net& net, const Values& inputs, Noise noise);

  const Values& values() const { return values_; }
  /// No NaN, no infinity and nothing that another order of a sum may take there
  /// (docs/ACCURACY.md): such numbers cannot be compared.
  bool is_far_from_overflow() const;
  /// Empty when `found` is right; else where it is not. `insensitive` counts what it could hardly
  /// have been wrong about.
  std::string compare(const std::string& name, const engine::Tensor& found, int64_t& insensitive);

  /// By how much rounding may change a value, channel by channel.
  std::vector<double> explained(const std::string& name);

 private:
  using Deviations = std::map<std::string, std::vector<double>>;
  const Deviations& measured(int runs);

  engine::Run run_;
  const Values& inputs_;
  Noise noise_;
  Values values_;
  std::map<int, Deviations> measured_;  // by how many runs with noise
};

}  // namespace revisit::random_nets
