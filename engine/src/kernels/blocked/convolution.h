#pragma once

#include <cstdint>
#include <span>

#include "kernels/convolution.h"
#include "kernels/epilogue.h"
#include "layout.h"

namespace revisit::engine {

/// All arrays are 64-byte aligned and do not overlap. Blocked ones are of the problem's `values`.
struct BlockedConvolutionArguments {
  const void* input;    // in BlockedConvolutionKernel::input's layout
  const float* packed;  // what `pack` wrote
  const float* bias;    // [padded_channels(c_out)], zeros where there is none
  const void* addend;   // added before the activation, layout and shape of the output; or null
  Epilogue epilogue;
  void* output;    // blocked
  float* scratch;  // scratch_floats() of them, any content
  /// What each tap outside the image adds, packed like the weights, of gray input; or null.
  const float* outside_taps = nullptr;
};

/// What a kernel multiplies: float32 always, numbers of the problem's `values`, or tiles of them.
enum class Products { kFloat32, kValues, kTiles };

/// A convolution with blocked output: fast, with bias, addend and activation in one pass. The
/// result is the same bit for bit for any number of threads. Plain input is float32.
struct BlockedConvolutionKernel {
  const char* name;
  Layout input;
  bool (*supports)(const ConvolutionProblem&);
  /// Of a small cost model: meaningful against other kernels' only.
  double (*predicted_ms)(const ConvolutionProblem&);
  /// Packing depends on c_in, c_out, kernel_h, kernel_w, group and values only.
  int64_t (*packed_floats)(const ConvolutionProblem&);
  void (*pack)(const ConvolutionProblem&, const float* weights, float* packed);
  int64_t (*scratch_floats)(const ConvolutionProblem&);  // of all threads together
  void (*run)(const ConvolutionProblem&, const BlockedConvolutionArguments&);
  /// Of a line of its Winograd transform, 0 for others: rounding grows quickly with it.
  int transform_points = 0;
  Products products = Products::kFloat32;
  /// How often it multiplies; null: as the definition does.
  int64_t (*multiplications)(const ConvolutionProblem&) = nullptr;
};

constexpr int kAnyPoints = 99;

std::span<const BlockedConvolutionKernel> blocked_convolution_kernels();

/// The kernel with the smallest predicted time among those that support the problem, take this
/// layout and have at most so many transform points; null when none does.
const BlockedConvolutionKernel* choose_blocked_convolution(const ConvolutionProblem& p,
                                                           Layout input,
                                                           int most_points = kAnyPoints);

}  // namespace revisit::engine
