#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "kernels/convolution.h"
#include "kernels/epilogue.h"
#include "kernels/nchw.h"
#include "layout.h"
#include "revisit/engine/tensor.h"

namespace revisit::engine {

/// Returns whether the CPU supports the NCHWc kernels (x86: AVX2). Otherwise all values are NCHW.
bool has_blocked_kernels();

/// Instructions that a kernel needs. With AVX-512 targets, bfloat16 products use AVX512-BF16 or AMX
/// only. A CPU without them runs the entire kernel with AVX2. Sums are bitwise equal; roots may
/// differ by one bit.
enum class Instructions { kFloat32, kBf16, kTiles };

inline Instructions instructions_for(Precision values) {
  return values == Precision::kBf16 ? Instructions::kBf16 : Instructions::kFloat32;
}

size_t target_index(Instructions instructions);

/// Limits the choice and dispatch of kernels in this process as on a CPU with `most`. For tests.
void limit_instructions(Instructions most);

struct BlockedSize {
  int64_t n = 1, c = 1, pixels = 1;
  int threads = 1;
  Precision values = Precision::kFloat32;

  int64_t planes() const { return n * channel_blocks(c); }
};

/// Converts float32 `[n][c][pixels]` to NCHWc of type `size.values`, with zeros in lanes beyond c.
void reorder_to_nchwc(const BlockedSize& size, const float* plain, void* blocked);

void reorder_to_nchw(const BlockedSize& size, const void* blocked, float* plain);

/// Channel c of the output is channel `sources[c]` of the input. Arrays must not overlap.
void blocked_shuffle(const BlockedSize& size, std::span<const int64_t> sources, const void* input,
                     void* output);

// NCHWc values have the type `size.values`. Arrays are aligned to their blocks. The output may be
// one of the inputs.
void blocked_activation(const BlockedSize& size, const Epilogue& epilogue, const void* input,
                        void* output);

/// input * scale[c] + shift[c], then the epilogue; both are `[padded_channels(c)]`.
void blocked_scale(const BlockedSize& size, const float* scale, const float* shift,
                   const Epilogue& epilogue, const void* input, void* output);

/// Combination of at least two inputs like Caffe's Eltwise, then the epilogue.
struct BlockedEltwise {
  enum class Operation { kSum, kProduct, kMaximum };
  Operation operation = Operation::kSum;
  /// For a sum, one per input. Inputs with coefficient 0 are ignored, so NaN does not propagate.
  std::span<const float> coefficients = {};
  Epilogue epilogue = {};
};
void blocked_eltwise(const BlockedSize& size, const BlockedEltwise& eltwise,
                     std::span<const float* const> inputs, void* output);

/// One factor per image and channel, as in squeeze-and-excitation.
struct BlockedGate {
  const float* factors = nullptr;  // `[n][c]`, NCHW without padding
  const void* addend = nullptr;    // NCHWc, in the input's shape; or null
  /// Ignores the input if the factor is 0, as in BLAS, so NaN does not propagate.
  bool zero_hides = false;
  Epilogue epilogue = {};
};

/// factors[n][c] * input + addend, then the epilogue. The output may also be the addend.
void blocked_gate(const BlockedSize& size, const BlockedGate& gate, const void* input,
                  void* output);

/// Like max_pool() and average_pool(), bitwise equal (rounded to `p.values`), for NCHWc and without
/// a mask: `p.planes` is n * channels.
void blocked_max_pool(const PoolingProblem& p, int64_t channels, const void* input, void* output);
void blocked_average_pool(const PoolingProblem& p, int64_t channels, const void* input,
                          void* output);

/// Like lrn_across_channels(), for NCHWc. `scratch` has blocked_lrn_scratch_floats() floats.
void blocked_lrn(const LrnProblem& p, const void* input, void* output, float* scratch);
int64_t blocked_lrn_scratch_floats(const LrnProblem& p);

/// blocked_lrn() fused with blocked_max_pool(), bitwise equal, except that bfloat16 values in
/// between are not rounded. `pooling` must have the planes, size and threads of `lrn`.
void blocked_lrn_max_pool(const LrnProblem& lrn, const PoolingProblem& pooling, const void* input,
                          void* output, float* scratch);
int64_t blocked_lrn_max_pool_scratch_floats(const LrnProblem& lrn, const PoolingProblem& pooling);

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

/// First layers of a net, fused: a convolution of few channels with its epilogue, an optional
/// blocked_lrn(), then blocked_max_pool(). Values in between, the largest of these nets, stay in
/// cache and in float32. Results are bitwise equal to separate kernels, except for bfloat16 with
/// LRN, where the convolution's output is not rounded.
struct ConvolutionMaxPool {
  ConvolutionProblem convolution;   // supported by kBlockedPlainInput or, with `in_tiles`, by
                                    // kBlockedPlainInputTiles; defines the threads
  const LrnProblem* lrn = nullptr;  // follows the convolution; or null
  PoolingProblem pooling;
  bool in_tiles = false;
};

/// `arguments` are those of the convolution, without addend; the output is that of the pooling.
void blocked_convolution_max_pool(const ConvolutionMaxPool& p,
                                  const BlockedConvolutionArguments& arguments);
int64_t blocked_convolution_max_pool_scratch_floats(const ConvolutionMaxPool& p);

}  // namespace revisit::engine

/// Like HWY_DYNAMIC_DISPATCH, for NCHWc kernels.
#define REVISIT_DISPATCH(FUNCTION, INSTRUCTIONS) \
  (*HWY_DISPATCH_TABLE(FUNCTION)[target_index(INSTRUCTIONS)])
