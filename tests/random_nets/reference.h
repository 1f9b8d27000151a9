#pragma once

#include <functional>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "layer.h"
#include "random.h"
#include "revisit/engine/net.h"

namespace revisit::random_nets {

using Values = std::map<std::string, engine::Tensor>;

/// Prefix of layer outputs among the Values of a run.
inline const std::string kLayer = "layer ";

/// Fills the inputs, runs, and returns outputs. If the plan keeps them, includes outputs of all
/// layers by kLayer and port name.
Values forward(engine::Run& run, const Values& inputs,
               const std::function<void(size_t, bool)>& observe = {});

/// Maximum difference within each channel (axis 1; with fewer axes: over everything).
std::vector<double> differences(const engine::Tensor& a, const engine::Tensor& b);

struct Noise {
  /// Per rounding layer, relative to the largest value of each channel of its output.
  std::map<std::string, double> of_layers;
  /// Rounding of the terms of a sum, as a fraction of that and relative to the layer's inputs.
  double of_terms = 0.01;
  /// Per layer: size of its output for inputs of size 1 without cancellation (length of an output's
  /// weights). Partial sums of that size are rounded, even if the final sum is small.
  std::map<std::string, double> of_weights = {};
  /// Per layer that subtracts a mean, relative to its inputs: residual of a channel of equal
  /// numbers. The reference kernels, which sum in double, yield 0, and layers may add a shift.
  std::map<std::string, double> of_means = {};
};

/// Results of the reference kernels, and their tolerance for rounding.
class Reference {
 public:
  Reference(const engine::Net& net, const Values& inputs, Noise noise);

  const Values& values() const { return values_; }
  /// Returns false for NaN, infinity, and values that another order of summation could turn into
  /// them (docs/reference/ACCURACY.md), which cannot be compared.
  bool is_far_from_overflow() const;
  /// Returns "" if `found` is correct, else the position of the fault. `insensitive` counts outputs
  /// whose tolerance is too large for a meaningful test.
  std::string compare(const std::string& name, const engine::Tensor& found, int64_t& insensitive);

  std::vector<double> explained(const std::string& name);

 private:
  using Deviations = std::map<std::string, std::vector<double>>;
  const Deviations& measured(int runs);

  engine::Run run_;
  const Values& inputs_;
  Noise noise_;
  Values values_;
  std::map<int, Deviations> measured_;  // by number of runs with noise
};

}  // namespace revisit::random_nets
