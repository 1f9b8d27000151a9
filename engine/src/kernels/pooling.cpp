#include "kernels/nchw.h"
#include "revisit/engine/parallel_for.h"

namespace revisit::engine {
namespace {

struct VolumeWindow {
  WindowRange d, h, w;
};

/// Calls `work(index of the output, volume, window)` for each window of each volume.
template <class Work>
void for_each_window(const PoolingProblem& p, const float* input, const Work& work) {
  const int64_t slices = p.depth.windows;
  parallel_for(p.planes * slices, p.threads, [&](int64_t item, int) {
    const float* volume = input + item / slices * p.depth.image * p.h * p.w;
    const WindowRange depths = p.depths(item % slices);
    for (int64_t y = 0; y < p.out_h; ++y)
      for (int64_t x = 0; x < p.out_w; ++x)
        work((item * p.out_h + y) * p.out_w + x, volume,
             VolumeWindow{depths, p.rows(y), p.columns(x)});
  });
}

void max_pool_volumes(const PoolingProblem& p, const float* input, float* output, float* mask) {
  const int64_t rows = p.h, columns = p.w;
  for_each_window(p, input, [=](int64_t out, const float* volume, const VolumeWindow& window) {
    float best = empty_maximum(p.values);
    int64_t where = -1;
    for (int64_t z = window.d.begin; z < window.d.end; ++z)
      for (int64_t y = window.h.begin; y < window.h.end; ++y)
        for (int64_t x = window.w.begin; x < window.w.end; ++x) {
          const int64_t at = (z * rows + y) * columns + x;
          if (volume[at] > best) best = volume[at], where = at;
        }
    output[out] = best;
    if (mask) mask[out] = static_cast<float>(where);
  });
}

void average_pool_volumes(const PoolingProblem& p, const float* input, float* output) {
  const int64_t rows = p.h, columns = p.w, padded_end = p.depth.image + p.depth.pad;
  for_each_window(p, input, [&](int64_t out, const float* volume, const VolumeWindow& window) {
    float sum = 0;
    for (int64_t z = window.d.begin; z < window.d.end; ++z)
      for (int64_t y = window.h.begin; y < window.h.end; ++y)
        for (int64_t x = window.w.begin; x < window.w.end; ++x)
          sum += volume[(z * rows + y) * columns + x];
    output[out] = sum / static_cast<float>(p.averaged(window.d, p.depth.kernel, padded_end) *
                                           p.height(window.h) * p.width(window.w));
  });
}

/// Images have kernels of their own, because those of volumes are up to a fifth slower for them.
bool is_volume(const PoolingProblem& p) {
  return p.depth.padded() > 1;
}

}  // namespace

void max_pool(const PoolingProblem& p, const float* input, float* output, float* mask) {
  if (is_volume(p)) return max_pool_volumes(p, input, output, mask);
  parallel_for(p.planes * p.out_h, p.threads, [&](int64_t item, int) {
    const int64_t plane = item / p.out_h, y = item % p.out_h;
    const float* image = input + plane * p.h * p.w;
    const WindowRange rows = p.rows(y);
    for (int64_t x = 0; x < p.out_w; ++x) {
      const WindowRange columns = p.columns(x);
      float best = empty_maximum(p.values);
      int64_t where = -1;
      for (int64_t iy = rows.begin; iy < rows.end; ++iy)
        for (int64_t ix = columns.begin; ix < columns.end; ++ix)
          if (image[iy * p.w + ix] > best) {
            best = image[iy * p.w + ix];
            where = iy * p.w + ix;
          }
      output[item * p.out_w + x] = best;
      if (mask) mask[item * p.out_w + x] = static_cast<float>(where);
    }
  });
}

void average_pool(const PoolingProblem& p, const float* input, float* output) {
  if (is_volume(p)) return average_pool_volumes(p, input, output);
  parallel_for(p.planes * p.out_h, p.threads, [&](int64_t item, int) {
    const int64_t plane = item / p.out_h, y = item % p.out_h;
    const float* image = input + plane * p.h * p.w;
    const WindowRange rows = p.rows(y);
    const int64_t height = p.height(rows);
    for (int64_t x = 0; x < p.out_w; ++x) {
      const WindowRange columns = p.columns(x);
      float sum = 0;
      for (int64_t iy = rows.begin; iy < rows.end; ++iy)
        for (int64_t ix = columns.begin; ix < columns.end; ++ix) sum += image[iy * p.w + ix];
      output[item * p.out_w + x] = sum / static_cast<float>(height * p.width(columns));
    }
  });
}

}  // namespace revisit::engine
