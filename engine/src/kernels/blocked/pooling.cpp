#include "kernels/blocked/kernels.h"
#include "kernels/blocked/partition.h"
#include "revisit/engine/parallel_for.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/blocked/pooling.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h.
#include "kernels/blocked/lrn-inl.h"
#include "kernels/blocked/pooling-inl.h"

HWY_BEFORE_NAMESPACE();
namespace revisit::engine::HWY_NAMESPACE {
namespace {

template <class Operation, class T>
void pool(const PoolingProblem& p, int64_t channels, const T* input, T* output) {
  const int64_t blocks = channel_blocks(channels);
  parallel_for(p.planes / channels * blocks * p.out_h, p.threads, [&](int64_t item, int) HWY_ATTR {
    const int64_t plane = item / p.out_h, y = item % p.out_h;
    const WindowRange rows = rows_of(p, y);
    T* out = output + item * p.out_w * kLanes;
    pool_row<Operation>(p,
                        RowOfWindows<T, T>{.in = input + (plane * p.h + rows.begin) * p.w * kLanes,
                                           .first_column = 0,
                                           .row_step = p.w * kLanes,
                                           .rows = rows.end - rows.begin,
                                           .height = p.height(rows),
                                           .begin = 0,
                                           .end = p.out_w,
                                           .out = out,
                                           .continued = false});
    clear_tail_lanes(channels, plane % blocks, p.out_w, out);
  });
}

template <class Operation>
void pool(const PoolingProblem& p, int64_t channels, const void* in, void* out) {
  with_type(p.values, [&](auto type) {
    using T = decltype(type);
    pool<Operation>(p, channels, static_cast<const T*>(in), static_cast<T*>(out));
  });
}

}  // namespace

void max_pool(const PoolingProblem& p, int64_t channels, const void* input, void* output) {
  pool<Largest>(p, channels, input, output);
}

void average_pool(const PoolingProblem& p, int64_t channels, const void* input, void* output) {
  pool<Mean>(p, channels, input, output);
}

template <class T>
void normalize_all(const LrnProblem& p, const T* input, T* output, float* scratch) {
  constexpr int64_t kPixels = 256;  // per work item, to amortize clearing the margins
  const LrnSquares s(p);
  const int64_t blocks = channel_blocks(p.c), pixels = p.h * p.w, step = pixels * kLanes;
  const int64_t pieces = (pixels + kPixels - 1) / kPixels;
  parallel_for(p.n * pieces, p.threads, [&](int64_t item, int thread) HWY_ATTR {
    float* const squares = scratch + thread * s.floats();
    clear_margins(s, squares);
    const int64_t first = item % pieces * kPixels, last = std::min(first + kPixels, pixels);
    const int64_t image = item / pieces * blocks * step;
    for (int64_t i = first; i < last; i += s.pixels) {
      const int64_t at = image + i * kLanes, count = std::min(s.pixels, last - i);
      normalize(
          p, s,
          LrnTile<T, T>{input + at, step, output + at, step, count, s.pixels * kLanes, squares});
    }
    T* const tail = output + image + (blocks - 1) * step + first * kLanes;
    clear_tail_lanes(p.c, blocks - 1, last - first, tail);
  });
}

void lrn(const LrnProblem& p, const void* in, void* out, float* scratch) {
  with_type(p.values, [&](auto type) {
    using T = decltype(type);
    normalize_all(p, static_cast<const T*>(in), static_cast<T*>(out), scratch);
  });
}

template <class T>
void normalize_and_pool(const LrnProblem& lrn, const PoolingProblem& p, const T* input, T* output,
                        float* scratch) {
  const LrnSquares layout(lrn);
  const PoolingPieces pieces(p, lrn.c, p.threads);
  float* const all_squares = scratch + pieces.scratch_floats();
  const int64_t step = lrn.h * lrn.w * kLanes;
  const auto rows_of = [&](int64_t n, int thread) HWY_ATTR {
    const T* image = input + n * pieces.blocks * step;
    float* const squares = all_squares + thread * layout.floats();
    clear_margins(layout, squares);
    return [&, image, squares](const PixelRange& range, float* row, int64_t row_step) HWY_ATTR {
      for (int64_t x = range.begin; x < range.end; x += layout.pixels)
        normalize(lrn, layout,
                  LrnTile<T, float>{.input = image + (range.y * lrn.w + x) * kLanes,
                                    .input_step = step,
                                    .output = row + (x - range.begin) * kLanes,
                                    .output_step = row_step,
                                    .pixels = std::min(layout.pixels, range.end - x),
                                    .ahead = lrn.w * kLanes,
                                    .squares = squares});
    };
  };
  pool_pieces(p, lrn.c, pieces, output, scratch, rows_of);
}

void lrn_max_pool(const LrnProblem& lrn, const PoolingProblem& p, const void* in, void* out,
                  float* scratch) {
  with_type(lrn.values, [&](auto type) {
    using T = decltype(type);
    normalize_and_pool(lrn, p, static_cast<const T*>(in), static_cast<T*>(out), scratch);
  });
}

}  // namespace revisit::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace revisit::engine {

HWY_EXPORT(max_pool);
HWY_EXPORT(average_pool);

void blocked_max_pool(const PoolingProblem& p, int64_t channels, const void* input, void* output) {
  REVISIT_DISPATCH(max_pool, instructions_for(p.values))(p, channels, input, output);
}

void blocked_average_pool(const PoolingProblem& p, int64_t channels, const void* input,
                          void* output) {
  REVISIT_DISPATCH(average_pool, instructions_for(p.values))(p, channels, input, output);
}

HWY_EXPORT(lrn);
HWY_EXPORT(lrn_max_pool);

int64_t blocked_lrn_scratch_floats(const LrnProblem& p) {
  return p.threads * LrnSquares(p).floats();
}

void blocked_lrn(const LrnProblem& p, const void* input, void* output, float* scratch) {
  REVISIT_DISPATCH(lrn, instructions_for(p.values))(p, input, output, scratch);
}

int64_t blocked_lrn_max_pool_scratch_floats(const LrnProblem& lrn, const PoolingProblem& pooling) {
  return PoolingPieces(pooling, lrn.c, pooling.threads).scratch_floats() +
         pooling.threads * LrnSquares(lrn).floats();
}

void blocked_lrn_max_pool(const LrnProblem& lrn, const PoolingProblem& pooling, const void* input,
                          void* output, float* scratch) {
  REVISIT_DISPATCH(lrn_max_pool, instructions_for(lrn.values))
  (lrn, pooling, input, output, scratch);
}

}  // namespace revisit::engine
#endif
