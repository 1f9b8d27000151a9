#include "kernels/blocked/pooling.h"

#include "kernels/blocked/blocked_pieces.h"
#include "kernels/blocked/dispatch.h"
#include "revisit/engine/parallel_for.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/blocked/pooling.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h.
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
                                           .height = p.height(rows.start),
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

}  // namespace revisit::engine
#endif
