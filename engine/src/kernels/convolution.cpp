#include "kernels/convolution.h"

#include <algorithm>
#include <new>

#include "kernels/nchw.h"
#include "kernels/window.h"
#include "revisit/engine/parallel_for.h"

namespace revisit::engine {
namespace {

/// Calls `visit(done, run, line, x, axis)` for runs of windows on one line of the last axis: `run`
/// windows, starting `done` after `first`. They read pixels x, x + stride, ... of the image line
/// from pixel `line` on (-1: outside the image), also beyond both ends.
template <class Visit>
void for_each_line(const WindowAxes& axes, int64_t k, int64_t first, int64_t count,
                   const Visit& visit) {
  static constexpr WindowAxis kSinglePixel;
  const size_t outer = axes.empty() ? 0 : axes.size() - 1;
  const WindowAxis& last = axes.empty() ? kSinglePixel : axes.back();
  int64_t line = first / last.windows, i = first % last.windows;
  for (int64_t done = 0; done < count; ++line, i = 0) {
    const int64_t run = std::min(last.windows - i, count - done);
    const int64_t image_line = pixel_under(axes, outer, line, k / last.kernel);
    visit(done, run, image_line < 0 ? -1 : image_line * last.image,
          i * last.stride - last.pad + k % last.kernel * last.dilation, last);
    done += run;
  }
}

}  // namespace

void gather_pixels(const WindowAxes& axes, const float* image, int64_t k, int64_t first,
                   int64_t count, float* row) {
  for_each_line(axes, k, first, count,
                [&](int64_t done, int64_t run, int64_t line, int64_t x, const WindowAxis& axis) {
                  float* out = row + done;
                  if (line < 0) {
                    std::fill_n(out, run, 0.0F);
                    return;
                  }
                  for (int64_t i = 0; i < run; ++i, x += axis.stride)
                    out[i] = x >= 0 && x < axis.image ? image[line + x] : 0.0F;
                });
}

void scatter_add_pixels(const WindowAxes& axes, const float* row, int64_t k, int64_t first,
                        int64_t count, float* image) {
  for_each_line(axes, k, first, count,
                [&](int64_t done, int64_t run, int64_t line, int64_t x, const WindowAxis& axis) {
                  if (line < 0) return;
                  const float* in = row + done;
                  for (int64_t i = 0; i < run; ++i, x += axis.stride)
                    if (x >= 0 && x < axis.image) image[line + x] += in[i];
                });
}

namespace {

/// Windows per matrix product: their columns fit the L2 cache.
int64_t tile_windows(const ConvolutionNdProblem& p) {
  constexpr int64_t kColumnFloats = 256 * 1024, kLeast = 64, kStep = 16;
  const int64_t wanted = std::max(kColumnFloats / p.depth() / kStep * kStep, kLeast);
  return std::min(wanted, p.windows());
}

/// Matrix of the input values under `count` windows, `[depth][stride]`.
struct Columns {
  const float* data;
  int64_t stride;
};

/// Splits the work into (image, group, tile) items, independent of the number of threads, so that
/// results are bitwise equal. `columns_of(image, first, count, thread)` returns the columns of the
/// windows from `first`; `image` has the channels of one group.
template <class ColumnsOf>
void multiply_tiles(const ConvolutionNdProblem& p, const float* input, const float* weights,
                    const float* bias, float* output, const ColumnsOf& columns_of) {
  const int64_t windows = p.windows(), pixels = p.image_pixels();
  const int64_t tile = tile_windows(p), tiles = (windows + tile - 1) / tile;
  const int64_t channels = p.c_windows_per_group();
  parallel_for(p.n * p.group * tiles, p.threads, [&](int64_t item, int thread) {
    const int64_t first = item % tiles * tile, count = std::min(tile, windows - first);
    const int64_t group = item / tiles % p.group, n = item / tiles / p.group;
    const float* image = input + (n * p.c_image + group * p.c_image_per_group()) * pixels;
    const Columns columns = columns_of(image, first, count, thread);
    float* out = output + (n * p.c_windows + group * channels) * windows + first;
    gemm({channels, count, p.depth(), weights + group * channels * p.depth(), p.depth(),
          columns.data, columns.stride, false, out, windows});
    for (int64_t co = 0; bias && co < channels; ++co)
      for (int64_t i = 0; i < count; ++i) out[co * windows + i] += bias[group * channels + co];
  });
}

int64_t im2col_scratch_floats(const ConvolutionNdProblem& p) {
  return p.threads * p.depth() * tile_windows(p);
}

void run_im2col(const ConvolutionNdProblem& p, const float* input, const float* weights,
                const float* bias, float* output, float* scratch) {
  const int64_t pixels = p.image_pixels(), taps = p.kernel_elements();
  const int64_t thread_floats = p.depth() * tile_windows(p);
  multiply_tiles(p, input, weights, bias, output,
                 [&](const float* image, int64_t first, int64_t count, int thread) -> Columns {
                   float* const columns = scratch + thread * thread_floats;
                   for (int64_t ci = 0; ci < p.c_image_per_group(); ++ci)
                     for (int64_t k = 0; k < taps; ++k)
                       gather_pixels(p.axes, image + ci * pixels, k, first, count,
                                     columns + (ci * taps + k) * count);
                   return {columns, count};
                 });
}

/// With a 1x1 kernel and stride 1, the columns are the image itself.
bool is_pointwise(const ConvolutionNdProblem& p) {
  return std::all_of(p.axes.begin(), p.axes.end(),
                     [](const WindowAxis& axis) { return is_each_pixel(axis); });
}

void run_pointwise(const ConvolutionNdProblem& p, const float* input, const float* weights,
                   const float* bias, float* output, float*) {
  multiply_tiles(p, input, weights, bias, output,
                 [&](const float* image, int64_t first, int64_t, int) -> Columns {
                   return {image + first, p.image_pixels()};
                 });
}

int64_t reference_scratch_floats(const ConvolutionNdProblem& p) {
  return p.kernel_elements();
}

void run_reference(const ConvolutionNdProblem& p, const float* input, const float* weights,
                   const float* bias, float* output, float* scratch) {
  static_assert(sizeof(int32_t) == sizeof(float));
  const int64_t windows = p.windows(), pixels = p.image_pixels(), taps = p.kernel_elements();
  auto* const under = new (scratch) int32_t[static_cast<size_t>(taps)];  // pixel, -1 for none
  for (int64_t i = 0; i < windows; ++i) {
    for (int64_t k = 0; k < taps; ++k)
      under[k] = static_cast<int32_t>(pixel_under(p.axes, p.axes.size(), i, k));
    for (int64_t n = 0; n < p.n; ++n)
      for (int64_t co = 0; co < p.c_windows; ++co) {
        const int64_t first_channel = co / p.c_windows_per_group() * p.c_image_per_group();
        double sum = 0;
        for (int64_t ci = 0; ci < p.c_image_per_group(); ++ci) {
          const float* image = input + (n * p.c_image + first_channel + ci) * pixels;
          const float* w = weights + (co * p.c_image_per_group() + ci) * taps;
          for (int64_t k = 0; k < taps; ++k)
            if (under[k] >= 0) sum += static_cast<double>(image[under[k]]) * w[k];
        }
        output[(n * p.c_windows + co) * windows + i] =
            static_cast<float>(sum + (bias ? bias[co] : 0.0F));
      }
  }
}

/// Output channels per work item: enough rows for an efficient product, independent of the number
/// of threads. Each item owns its output channels, so that no other item adds to them.
int64_t block_channels(const ConvolutionNdProblem& p) {
  constexpr int64_t kRows = 128;
  return std::clamp<int64_t>(kRows / p.kernel_elements(), 1, p.c_image_per_group());
}

/// Windows per fold: their columns fit the L2 cache.
int64_t strip_windows(const ConvolutionNdProblem& p) {
  constexpr int64_t kColumnFloats = 256 * 1024, kLeast = 16;
  const int64_t rows = block_channels(p) * p.kernel_elements();
  return std::min(std::max(kColumnFloats / rows, kLeast), p.windows());
}

int64_t deconvolution_scratch_floats(const ConvolutionNdProblem& p) {
  return p.threads * block_channels(p) * p.kernel_elements() * strip_windows(p);
}

void run_deconvolution(const ConvolutionNdProblem& p, const float* input, const float* weights,
                       const float* bias, float* output, float* scratch) {
  const int64_t windows = p.windows(), pixels = p.image_pixels(), taps = p.kernel_elements();
  const int64_t strip = strip_windows(p), block = block_channels(p);
  const int64_t blocks = (p.c_image_per_group() + block - 1) / block;
  parallel_for(p.n * p.group * blocks, p.threads, [&](int64_t item, int thread) {
    const int64_t first_channel = item % blocks * block;
    const int64_t channels = std::min(block, p.c_image_per_group() - first_channel);
    const int64_t group = item / blocks % p.group, n = item / blocks / p.group;
    const int64_t channel = group * p.c_image_per_group() + first_channel;
    const float* in = input + (n * p.c_windows + group * p.c_windows_per_group()) * windows;
    const float* w = weights + group * p.c_windows_per_group() * p.depth() + first_channel * taps;
    float* const out = output + (n * p.c_image + channel) * pixels;
    float* const columns = scratch + thread * block * taps * strip;

    std::fill_n(out, channels * pixels, 0.0F);
    for (int64_t first = 0; first < windows; first += strip) {
      const int64_t count = std::min(strip, windows - first);
      gemm({channels * taps, count, p.c_windows_per_group(), w, p.depth(), in + first, windows,
            false, columns, count, true});
      for (int64_t c = 0; c < channels; ++c)
        for (int64_t k = 0; k < taps; ++k)
          scatter_add_pixels(p.axes, columns + (c * taps + k) * count, k, first, count,
                             out + c * pixels);
    }
    for (int64_t c = 0; bias && c < channels; ++c)
      for (int64_t i = 0; i < pixels; ++i) out[c * pixels + i] += bias[channel + c];
  });
}

/// Index of the window whose kernel element `k` is at `pixel`, in C order; -1 for none.
int64_t window_over(const WindowAxes& axes, int64_t pixel, int64_t k) {
  int64_t window = 0, step = 1;
  for (size_t a = axes.size(); a-- > 0;) {
    const WindowAxis& axis = axes[a];
    const int64_t start = pixel % axis.image + axis.pad - k % axis.kernel * axis.dilation;
    if (start < 0 || start % axis.stride != 0 || start / axis.stride >= axis.windows) return -1;
    window += start / axis.stride * step;
    step *= axis.windows;
    pixel /= axis.image;
    k /= axis.kernel;
  }
  return window;
}

void run_deconvolution_reference(const ConvolutionNdProblem& p, const float* input,
                                 const float* weights, const float* bias, float* output, float*) {
  const int64_t windows = p.windows(), pixels = p.image_pixels(), taps = p.kernel_elements();
  for (int64_t n = 0; n < p.n; ++n)
    for (int64_t c = 0; c < p.c_image; ++c)
      for (int64_t pixel = 0; pixel < pixels; ++pixel) {
        const int64_t group = c / p.c_image_per_group(), in_group = c % p.c_image_per_group();
        double sum = 0;
        for (int64_t k = 0; k < taps; ++k) {
          const int64_t window = window_over(p.axes, pixel, k);
          if (window < 0) continue;
          for (int64_t i = 0; i < p.c_windows_per_group(); ++i) {
            const int64_t cw = group * p.c_windows_per_group() + i;
            const double value = input[(n * p.c_windows + cw) * windows + window];
            sum += value * weights[(cw * p.c_image_per_group() + in_group) * taps + k];
          }
        }
        output[(n * p.c_image + c) * pixels + pixel] =
            static_cast<float>(sum + (bias ? bias[c] : 0.0F));
      }
}

}  // namespace

const ConvolutionNdKernel kConvolutionReference = {"reference", always, reference_scratch_floats,
                                                   run_reference};

std::span<const ConvolutionNdKernel> convolution_kernels() {
  static const ConvolutionNdKernel kList[] = {
      {"pointwise-gemm", is_pointwise, no_scratch, run_pointwise, true},
      {"im2col-gemm", always, im2col_scratch_floats, run_im2col, true},
      kConvolutionReference};
  return kList;
}

const ConvolutionNdKernel kDeconvolutionGemm = {"gemm-col2im", always, deconvolution_scratch_floats,
                                                run_deconvolution, true};
const ConvolutionNdKernel kDeconvolutionReference = {"reference", always, no_scratch,
                                                     run_deconvolution_reference};

}  // namespace revisit::engine
