#include <algorithm>

#include "kernels/convolution.h"
#include "kernels/gemm.h"
#include "kernels/parallel.h"

namespace revisit::engine {
namespace {

/// Output pixels unfolded at a time: few enough that the columns stay in the L2 cache.
int64_t strip_pixels(const ConvolutionProblem& p) {
  constexpr int64_t kColumnFloats = 256 * 1024, kLeast = 64, kStep = 16;
  const int64_t wanted = std::max(kColumnFloats / p.depth() / kStep * kStep, kLeast);
  return std::min(wanted, p.out_pixels());
}

/// One row of the unfolded matrix: the input under weight (channel, ky, kx) for `count` output
/// pixels from `first` on.
void unfold_row(const ConvolutionProblem& p, const float* channel, int64_t ky, int64_t kx,
                int64_t first, int64_t count, float* row) {
  int64_t y = first / p.out_w, x = first % p.out_w;
  for (int64_t done = 0; done < count; ++y, x = 0) {
    const int64_t run = std::min(p.out_w - x, count - done);
    const int64_t iy = y * p.stride_h - p.pad_h + ky * p.dilation_h;
    float* out = row + done;
    done += run;
    if (iy < 0 || iy >= p.h) {
      std::fill_n(out, run, 0.0F);
      continue;
    }
    const float* in = channel + iy * p.w;
    int64_t ix = x * p.stride_w - p.pad_w + kx * p.dilation_w;
    for (int64_t i = 0; i < run; ++i, ix += p.stride_w)
      out[i] = ix >= 0 && ix < p.w ? in[ix] : 0.0F;
  }
}

void add_bias(const ConvolutionProblem& p, const float* bias, int64_t count, float* output) {
  for (int64_t co = 0; bias && co < p.c_out_per_group(); ++co) {
    float* row = output + co * p.out_pixels();
    for (int64_t i = 0; i < count; ++i) row[i] += bias[co];
  }
}

/// The product for one strip of one group of one image, `columns` being `[depth][ldb]`.
void multiply_strip(const ConvolutionProblem& p, const float* weights, const float* bias,
                    const float* columns, int64_t ldb, int64_t count, float* output) {
  gemm({p.c_out_per_group(), count, p.depth(), weights, p.depth(), columns, ldb, false, output,
        p.out_pixels()});
  add_bias(p, bias, count, output);
}

/// Splits the work into (image, group, strip) items of a size that does not depend on the number of
/// threads: the result is the same bit for bit. `columns(item, ...)` gives the strip's B matrix.
template <class ColumnsOf>
void run_strips(const ConvolutionProblem& p, int64_t strip, const float* weights, const float* bias,
                float* output, const ColumnsOf& columns_of) {
  const int64_t strips = (p.out_pixels() + strip - 1) / strip;
  parallel_for(p.n * p.group * strips, p.threads, [&](int64_t item, int thread) {
    const int64_t first = item % strips * strip, count = std::min(strip, p.out_pixels() - first);
    const int64_t group = item / strips % p.group, n = item / strips / p.group;
    const auto [columns, ldb] = columns_of(n, group, first, count, thread);
    multiply_strip(p, weights + group * p.c_out_per_group() * p.depth(),
                   bias ? bias + group * p.c_out_per_group() : nullptr, columns, ldb, count,
                   output + (n * p.c_out + group * p.c_out_per_group()) * p.out_pixels() + first);
  });
}

struct Columns {
  const float* data;
  int64_t ldb;
};

int64_t im2col_scratch(const ConvolutionProblem& p) {
  return p.threads * p.depth() * strip_pixels(p);
}

void run_im2col(const ConvolutionProblem& p, const float* input, const float* weights,
                const float* bias, float* output, float* scratch) {
  const int64_t strip = strip_pixels(p);
  run_strips(p, strip, weights, bias, output,
             [&](int64_t n, int64_t group, int64_t first, int64_t count, int thread) -> Columns {
               float* const columns = scratch + thread * p.depth() * strip;
               const float* image = input + (n * p.c_in + group * p.c_in_per_group()) * p.h * p.w;
               float* row = columns;
               for (int64_t ci = 0; ci < p.c_in_per_group(); ++ci)
                 for (int64_t ky = 0; ky < p.kernel_h; ++ky)
                   for (int64_t kx = 0; kx < p.kernel_w; ++kx, row += count)
                     unfold_row(p, image + ci * p.h * p.w, ky, kx, first, count, row);
               return {columns, count};
             });
}

bool is_pointwise(const ConvolutionProblem& p) {
  return p.kernel_h == 1 && p.kernel_w == 1 && p.stride_h == 1 && p.stride_w == 1 && p.pad_h == 0 &&
         p.pad_w == 0;
}

void run_pointwise(const ConvolutionProblem& p, const float* input, const float* weights,
                   const float* bias, float* output, float*) {
  run_strips(
      p, strip_pixels(p), weights, bias, output,
      [&](int64_t n, int64_t group, int64_t first, int64_t, int) -> Columns {
        return {input + (n * p.c_in + group * p.c_in_per_group()) * p.h * p.w + first, p.h * p.w};
      });
}

}  // namespace

const ConvolutionKernel kConvolutionPointwiseGemm = {
    "pointwise-gemm", is_pointwise, [](const ConvolutionProblem&) { return int64_t{0}; },
    run_pointwise};

const ConvolutionKernel kConvolutionIm2colGemm = {
    "im2col-gemm", [](const ConvolutionProblem&) { return true; }, im2col_scratch, run_im2col};

}  // namespace revisit::engine
