#include "kernels/nchw.h"
#include "revisit/engine/parallel_for.h"

namespace revisit::engine {
namespace {

struct VolumeWindow {
  WindowRange d, h, w;
};

/// Calls `work(index of the output, volume, window)` for each window of each volume.
template <class Work>
void for_each_window(const VolumePooling& p, const float* input, const Work& work) {
  const WindowAxis &d = p.axes[0], &h = p.axes[1], &w = p.axes[2];
  const auto range = [](const WindowAxis& axis, int64_t i) {
    return WindowRange(i * axis.stride - axis.pad, axis.kernel, axis.image);
  };
  parallel_for(p.planes * d.windows, p.threads, [&](int64_t item, int) {
    const float* volume = input + item / d.windows * d.image * h.image * w.image;
    const WindowRange depths = range(d, item % d.windows);
    for (int64_t y = 0; y < h.windows; ++y)
      for (int64_t x = 0; x < w.windows; ++x)
        work((item * h.windows + y) * w.windows + x, volume,
             VolumeWindow{depths, range(h, y), range(w, x)});
  });
}

}  // namespace

void max_pool_volumes(const VolumePooling& p, const float* input, float* output, float* mask) {
  const int64_t rows = p.axes[1].image, columns = p.axes[2].image;
  for_each_window(p, input, [=](int64_t out, const float* volume, const VolumeWindow& window) {
    float best = empty_maximum(Precision::kFloat32);
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

void average_pool_volumes(const VolumePooling& p, const float* input, float* output) {
  const int64_t rows = p.axes[1].image, columns = p.axes[2].image;
  const auto size = [&](const WindowAxis& axis, const WindowRange& range) {
    if (!p.counts_padding) return range.pixels();
    return std::min(range.start + axis.kernel, axis.image + axis.pad) - range.start;
  };
  for_each_window(p, input, [&](int64_t out, const float* volume, const VolumeWindow& window) {
    float sum = 0;
    for (int64_t z = window.d.begin; z < window.d.end; ++z)
      for (int64_t y = window.h.begin; y < window.h.end; ++y)
        for (int64_t x = window.w.begin; x < window.w.end; ++x)
          sum += volume[(z * rows + y) * columns + x];
    output[out] = sum / static_cast<float>(size(p.axes[0], window.d) * size(p.axes[1], window.h) *
                                           size(p.axes[2], window.w));
  });
}

void max_pool(const PoolingProblem& p, const float* input, float* output, float* mask) {
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
