#pragma once

#include <cfloat>
#include <cstdint>
#include <vector>

#include "kernels/window.h"
#include "layout.h"
#include "revisit/engine/tensor.h"

namespace revisit::engine {

/// output[m][n] = input[m][k] * weights + bias[n]. Weights are [n][k], or [k][n] if `transposed`;
/// `bias` may be null.
struct InnerProductProblem {
  int64_t m = 1, n = 1, k = 1;
  bool transposed = false;
  int threads = 1;

  /// Returns whether kInnerProductGemv supports it, and is faster than a matrix product.
  bool has_few_inputs() const {
    constexpr int64_t kMaxInputs = 8;  // a matrix product is faster from about 12 inputs
    return !transposed && m <= kMaxInputs;
  }
};

struct InnerProductKernel {
  const char* name;
  void (*run)(const InnerProductProblem&, const float* input, const float* weights,
              const float* bias, float* output);
  bool uses_blas = false;
};

const InnerProductKernel& choose_inner_product(const InnerProductProblem& problem);
void inner_product(const InnerProductProblem& problem, const float* input, const float* weights,
                   const float* bias, float* output);

extern const InnerProductKernel kInnerProductGemv;  // reads the weights once
/// Like kInnerProductGemv, with bfloat16 weights; sums are in float32.
void inner_product_bf16(const InnerProductProblem& problem, const float* input,
                        const BFloat16* weights, const float* bias, float* output);

extern const InnerProductKernel kInnerProductGemm;
extern const InnerProductKernel kInnerProductReference;  // direct, in double precision

/// C[m][n] = A * B, row-major with leading dimensions, on the calling thread only, so that results
/// do not depend on the number of threads around it. A is [m][k], or [k][m] with `transpose_a`; B
/// is [k][n], or [n][k] with `transpose_b`. A calling kernel must set Work::uses_blas: the run then
/// reserves OpenBLAS's buffers, because a pass must not fail.
struct GemmProblem {
  int64_t m, n, k;
  const float* a;
  int64_t lda;
  const float* b;
  int64_t ldb;
  bool transpose_b;
  float* c;
  int64_t ldc;
  bool transpose_a = false;
};
void gemm(const GemmProblem& problem);

/// Checks that address space is left for OpenBLAS's work buffers, 128 MiB per thread that
/// multiplies at the same time. The caller must hold it while multiplying.
class BlasWorkspace {
 public:
  /// Throws std::bad_alloc if `threads` buffers do not fit next to those of all other holders.
  explicit BlasWorkspace(int threads);
  ~BlasWorkspace();
  BlasWorkspace(const BlasWorkspace&) = delete;
  BlasWorkspace& operator=(const BlasWorkspace&) = delete;

 private:
  int threads_;
};

/// A shape as [outer][size][inner] around one axis, or several adjacent ones.
struct AxisRuns {
  int64_t outer = 1, size = 1, inner = 1;
  int64_t elements() const { return outer * size * inner; }
};

inline AxisRuns runs_along(const Shape& shape, size_t axis) {
  return {shape.product(0, axis), shape[axis], shape.product(axis + 1, shape.rank())};
}

/// exp(x - max) / sum along the axis; a line with NaN or +infinity becomes NaN. `out` may be `in`.
/// Bitwise equal for any number of threads.
void softmax(const float* in, const AxisRuns& lines, float* out, int threads = 1);
/// Direct computation in double precision.
void softmax_reference(const float* in, const AxisRuns& lines, float* out);

/// output[i][j][k]... = input[offset + i * strides[0] + j * strides[1] + ...].
struct StridedCopyProblem {
  std::vector<int64_t> shape;    // output shape, at least one axis
  std::vector<int64_t> strides;  // input strides, one per axis of the output
  int64_t offset = 0;
  int threads = 1;
};

void strided_copy(const StridedCopyProblem& problem, const float* input, float* output);

/// Local response normalization of `[n][c][h * w]` over `size` (odd) neighboring channels:
/// y = x * (k + alpha / size * sum of squares) ^ -beta (docs/reference/LAYERS.md point 4).
struct LrnProblem {
  int64_t n = 1, c = 1, h = 1, w = 1;
  int64_t size = 5;
  float alpha = 1, beta = 0.75F, k = 1;
  int threads = 1;
  Precision values = Precision::kFloat32;  // NCHWc arrays
};

void lrn_across_channels(const LrnProblem& problem, const float* input, float* output);
void lrn_across_channels_reference(const LrnProblem& problem, const float* input, float* output);

/// LRN over a `size` x `size` window of each plane, with zero padding that counts in the mean: y =
/// x * (1 + alpha * mean of squares) ^ -beta. `k` is not used, as in Caffe.
void lrn_within_channel(const LrnProblem& problem, const float* input, float* output);

/// Maximum of an empty window: the lowest value of the type, as bfloat16 rounds -FLT_MAX to -inf.
constexpr float empty_maximum(Precision values) {
  return values == Precision::kFloat32 ? -FLT_MAX : -0x1.FEp127F;
}

/// Pooling of `planes` independent images `[h][w]` to `[out_h][out_w]`, or of volumes
/// `[depth][h][w]`.
struct PoolingProblem {
  int64_t planes = 1, h = 1, w = 1, out_h = 1, out_w = 1;
  int64_t kernel_h = 1, kernel_w = 1, stride_h = 1, stride_w = 1, pad_h = 0, pad_w = 0;
  int64_t end_surplus_h = 0, end_surplus_w = 0;  // trailing pad - pad
  WindowAxis depth = {};                         // one pixel: of images
  bool counts_padding = true;                    // as zeros of an average
  int threads = 1;
  Precision values = Precision::kFloat32;  // NCHWc arrays; determines empty_maximum()

  WindowRange rows(int64_t y) const { return {y * stride_h - pad_h, kernel_h, h}; }
  WindowRange columns(int64_t x) const { return {x * stride_w - pad_w, kernel_w, w}; }
  WindowRange depths(int64_t z) const {
    return {z * depth.stride - depth.pad, depth.kernel, depth.image};
  }
  /// Size of the averaged part of a window, clipped to the image, padded if padding counts.
  int64_t height(const WindowRange& rows) const {
    return averaged(rows, kernel_h, h + pad_h + end_surplus_h);
  }
  int64_t width(const WindowRange& columns) const {
    return averaged(columns, kernel_w, w + pad_w + end_surplus_w);
  }
  int64_t averaged(const WindowRange& range, int64_t kernel, int64_t padded_end) const {
    return counts_padding ? std::min(range.start + kernel, padded_end) - range.start
                          : range.pixels();
  }
};

/// Maximum of each window, clipped to the image; empty_maximum() if it is empty. NaN is ignored.
/// `mask`, if not null, receives the index of the maximum in its image or volume as float, -1 for
/// none (docs/reference/LAYERS.md point 2).
void max_pool(const PoolingProblem& problem, const float* input, float* output, float* mask);

/// Mean of each window: padding counts as zeros if counts_padding, the area beyond it does not.
void average_pool(const PoolingProblem& problem, const float* input, float* output);

/// A recurrent layer over `steps` time steps of `streams` independent sequences: input
/// `[steps][streams][input]`, output `[steps][streams][output]`. The state of stream n before step
/// t is multiplied by `cont[t][n]`; 0 starts a new sequence.
struct RecurrentProblem {
  int64_t steps = 1, streams = 1, input = 1, output = 1;
  int64_t static_input = 0;  // floats per stream of a time-constant input; 0: none
  int threads = 1;
};

/// Hidden state `h` and, for LSTM, cell `c`, each `[streams][output]`. On entry the state before
/// the first step, on return that after the last.
struct RecurrentState {
  float* h;
  float* c;
};

/// Arrays of one forward pass; `x_static` is null without a static input.
struct RecurrentOperands {
  const float *x, *cont, *x_static;
  float* y;
  RecurrentState state;
  float* scratch;
};

/// gates = W_hc (cont h) + W_xc x + b_c + W_static x_static, in four blocks i, f, o, g;
/// c = cont sigmoid(f) c + sigmoid(i) tanh(g);  h = y = sigmoid(o) tanh(c)
struct LstmWeights {
  const float *xc, *b_c, *x_static, *hc;
};
void lstm(const RecurrentProblem& problem, const LstmWeights& weights,
          const RecurrentOperands& operands);
int64_t lstm_scratch_floats(const RecurrentProblem& problem);
/// Computes the equations in double precision, without scratch.
void lstm_reference(const RecurrentProblem& problem, const LstmWeights& weights,
                    const RecurrentOperands& operands);

/// h = tanh(W_hh (cont h) + W_xh x + b_h + W_static x_static);  y = tanh(W_ho h + b_o)
struct RnnWeights {
  const float *xh, *b_h, *x_static, *hh, *ho, *b_o;
};
void rnn(const RecurrentProblem& problem, const RnnWeights& weights,
         const RecurrentOperands& operands);
int64_t rnn_scratch_floats(const RecurrentProblem& problem);
void rnn_reference(const RecurrentProblem& problem, const RnnWeights& weights,
                   const RecurrentOperands& operands);

}  // namespace revisit::engine
