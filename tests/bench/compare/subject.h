#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include "model.h"

namespace revisit::bench {

/// What one layer, or one step of an engine that makes one of several, takes.
struct StepTime {
  std::string name, how;
  double ms = 0;
};

double now_ms();

/// An engine with one net loaded for one input size and one number of threads.
class Subject {
 public:
  virtual ~Subject() = default;
  /// Name and version.
  virtual std::string name() const = 0;
  /// One pass over the input given at the start.
  virtual void forward() = 0;
  /// What it made of it, `[n][c][h][w]`.
  virtual std::span<const float> output() const = 0;
  /// The same pass with a clock around every step.
  virtual std::vector<StepTime> timed_forward() = 0;
};

struct Setting {
  int threads = 1;
  /// All channels of the input are equal and the engine may know it.
  bool gray = false;
};

using MakeSubject = std::unique_ptr<Subject> (*)(const Model&, const Setting&,
                                                 std::span<const float> input);

std::unique_ptr<Subject> make_ours(const Model&, const Setting&, std::span<const float>);
/// Layer by layer as the original Caffe: im2col of the whole image, then OpenBLAS.
std::unique_ptr<Subject> make_original(const Model&, const Setting&, std::span<const float>);
/// The fastest of its implementations for each convolution.
std::unique_ptr<Subject> make_onednn(const Model&, const Setting&, std::span<const float>);
/// Its importer of Caffe nets.
std::unique_ptr<Subject> make_opencv(const Model&, const Setting&, std::span<const float>);

}  // namespace revisit::bench
