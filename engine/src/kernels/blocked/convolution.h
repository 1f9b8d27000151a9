#pragma once

#include <cstdint>
#include <span>

#include "kernels/convolution.h"
#include "kernels/epilogue.h"
#include "layout.h"

namespace revisit::engine {

/// Arrays are 64-byte aligned and do not overlap. NCHWc arrays have the problem's type `values`.
struct BlockedConvolutionArguments {
  const void* input;  // in the layout BlockedConvolutionKernel::input
  const float* packed;
  const float* bias;   // [padded_channels(c_out)], zeros without a bias
  const void* addend;  // added before the activation, like the output; or null
  Epilogue epilogue;
  void* output;
  float* scratch;  // scratch_floats() uninitialized floats
  /// Contribution of each tap outside the image, packed like the weights (single-channel input).
  const float* outside_taps = nullptr;
};

/// Type of the multiplied numbers: always float32, the problem's `values`, or tiles of bfloat16.
enum class Products { kFloat32, kValues, kTiles };

/// Writes NCHWc; fuses bias, addend and activation. Results are bitwise equal for any number of
/// threads. NCHW input is float32.
struct BlockedConvolutionKernel {
  const char* name;
  Layout input;
  bool (*supports)(const ConvolutionProblem&);
  /// Prediction of a simple cost model, for comparison with other kernels only.
  double (*predicted_ms)(const ConvolutionProblem&);
  /// Packing depends only on c_in, c_out, kernel_h, kernel_w, group and values.
  int64_t (*packed_floats)(const ConvolutionProblem&);
  void (*pack)(const ConvolutionProblem&, const float* weights, float* packed);
  int64_t (*scratch_floats)(const ConvolutionProblem&);  // for all threads together
  void (*run)(const ConvolutionProblem&, const BlockedConvolutionArguments&);
  /// Points per line of its Winograd transform, 0 for others; rounding errors grow quickly with it.
  int transform_points = 0;
  Products products = Products::kFloat32;
  /// Number of multiplications; null: same as the definition.
  int64_t (*multiplications)(const ConvolutionProblem&) = nullptr;
};

constexpr int kAnyPoints = 99;

std::span<const BlockedConvolutionKernel> blocked_convolution_kernels();

/// Minimizes predicted time over kernels of up to `most_points` transform points; may be null.
const BlockedConvolutionKernel* choose_blocked_convolution(const ConvolutionProblem& p,
                                                           Layout input,
                                                           int most_points = kAnyPoints);

}  // namespace revisit::engine
