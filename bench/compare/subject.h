#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include "model.h"

namespace revisit::bench {

double now_ms();

/// An engine with one loaded net, for one input size and one number of threads.
class Subject {
 public:
  virtual ~Subject() = default;
  virtual std::string name() const = 0;
  /// Runs one pass over the input given at construction.
  virtual void forward() = 0;
  /// Layout: `[n][c][h][w]`.
  virtual std::span<const float> output() const = 0;
  /// Runs the pass with a clock around every layer, or step that fuses several [ms].
  virtual std::vector<double> timed_forward() = 0;
};

struct Setting {
  int threads = 1;
  /// All channels of the input are equal, and the engine may use this.
  bool gray = false;
};

using MakeSubject = std::unique_ptr<Subject> (*)(const Model&, const Setting&,
                                                 std::span<const float> input);

std::unique_ptr<Subject> make_ours(const Model&, const Setting&, std::span<const float>);
/// Layers as in the original Caffe: im2col of the full image, then OpenBLAS.
std::unique_ptr<Subject> make_original(const Model&, const Setting&, std::span<const float>);
/// Selects the fastest implementation of each convolution.
std::unique_ptr<Subject> make_onednn(const Model&, const Setting&, std::span<const float>);
std::unique_ptr<Subject> make_opencv(const Model&, const Setting&, std::span<const float>);

}  // namespace revisit::bench
