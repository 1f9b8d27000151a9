#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/blocked/direct.cpp"
#include <hwy/foreach_target.h>  // includes this file again for every target

#include "kernels/blocked/convolution.h"
#include "kernels/blocked/convolution_list.h"
#include "kernels/blocked/cost_model.h"
#include "kernels/blocked/direct_shape.h"
#include "kernels/blocked/epilogue-inl.h"
#include "kernels/blocked/multiply-inl.h"
#include "kernels/parallel.h"

HWY_BEFORE_NAMESPACE();
namespace revisit::engine::HWY_NAMESPACE {

/// A convolution as a matrix product. The columns of a panel of pixels are copied together block by
/// block, which costs little beside the product; a pointwise convolution finds them in the input.
class Direct {
 public:
  Direct(const ConvolutionProblem& p, const BlockedConvolutionArguments& a)
      : p_(p), a_(a), shape_(p) {}

  void run_pointwise() const {
    const int64_t chunks = shape_.chunks.columns.parts, slices = shape_.slices();
    const int64_t parts = shape_.chunks.per_thread ? 1 : slices;
    parallel_for(shape_.images * chunks * parts, p_.threads, [&](int64_t item, int) {
      const int64_t chunk = item / parts % chunks, image = item / parts / chunks;
      const Split cut = {slices, parts};
      const float* pixels =
          a_.input +
          (image * shape_.in_blocks * p_.h * p_.w + shape_.chunks.columns.begin(chunk)) * kLanes;
      for (int64_t slice = cut.begin(item % parts); slice < cut.end(item % parts); ++slice)
        multiply_slice(image, chunk, slice, [&](int64_t first, int64_t) {
          return Columns{pixels + first * kLanes, p_.h * p_.w * kLanes};
        });
    });
  }

  void run() const {
    const int64_t chunks = shape_.chunks.columns.parts;
    if (shape_.chunks.per_thread) {
      parallel_for(shape_.images * chunks, p_.threads, [&](int64_t item, int thread) {
        const int64_t chunk = item % chunks, image = item / chunks;
        float* const columns = a_.scratch + thread * shape_.columns_floats();
        for (int64_t i = 0; i < unfold_items(chunk); ++i) unfold(image, chunk, i, columns);
        for (int64_t i = 0; i < shape_.slices(); ++i) multiply_unfolded(image, chunk, i, columns);
      });
      return;
    }
    float* const columns = a_.scratch;
    for (int64_t image = 0; image < shape_.images; ++image)
      for (int64_t chunk = 0; chunk < chunks; ++chunk) {
        parallel_for(unfold_items(chunk), p_.threads,
                     [&](int64_t i, int) { unfold(image, chunk, i, columns); });
        parallel_for(shape_.slices(), p_.threads,
                     [&](int64_t i, int) { multiply_unfolded(image, chunk, i, columns); });
      }
  }

 private:
  /// Of a panel: [depth][pixel][kLanes], `step` floats from one block of the depth to the next.
  struct Columns {
    const float* data;
    int64_t step;
  };

  Split panels_of_chunk(int64_t chunk) const {
    return panels_of(shape_.chunks.columns.width(chunk));
  }

  /// An item is one panel of pixels and one block of input channels.
  int64_t unfold_items(int64_t chunk) const {
    return panels_of_chunk(chunk).parts * shape_.in_blocks;
  }

  /// Writes [panel][block][tap][pixel][kLanes].
  void unfold(int64_t image, int64_t chunk, int64_t item, float* columns) const {
    const Split panels = panels_of_chunk(chunk);
    const int64_t panel = item / shape_.in_blocks, block = item % shape_.in_blocks;
    const float* in = a_.input + (image * shape_.in_blocks + block) * p_.h * p_.w * kLanes;
    const int64_t width = panels.width(panel);
    const int64_t first = shape_.chunks.columns.begin(chunk) + panels.begin(panel);
    float* to =
        columns + (panels.begin(panel) * shape_.in_blocks + block * width) * shape_.taps * kLanes;
    for (int64_t ky = 0; ky < p_.kernel_h; ++ky)
      for (int64_t kx = 0; kx < p_.kernel_w; ++kx, to += width * kLanes)
        unfold_tap(in, ky, kx, first, width, to);
  }

  /// The pixels under one tap for `width` output pixels from `first` on; zero outside the image.
  void unfold_tap(const float* in, int64_t ky, int64_t kx, int64_t first, int64_t width,
                  float* to) const {
    int64_t y = first / p_.out_w, x = first % p_.out_w;
    for (int64_t done = 0; done < width; ++y, x = 0) {
      const int64_t run = std::min(p_.out_w - x, width - done);
      const int64_t iy = y * p_.stride_h - p_.pad_h + ky * p_.dilation_h;
      const int64_t ix = x * p_.stride_w - p_.pad_w + kx * p_.dilation_w;
      const bool inside = iy >= 0 && iy < p_.h;
      const int64_t begin =
          inside ? std::clamp<int64_t>((-ix + p_.stride_w - 1) / p_.stride_w, 0, run) : run;
      const int64_t end =
          inside ? std::clamp((p_.w - ix + p_.stride_w - 1) / p_.stride_w, begin, run) : run;
      for (int64_t i = 0; i < begin; ++i) store_block(zero_block(), to + i * kLanes);
      const float* from = in + (iy * p_.w + ix) * kLanes;
      for (int64_t i = begin; i < end; ++i)
        store_block(load_block(from + i * p_.stride_w * kLanes), to + i * kLanes);
      for (int64_t i = end; i < run; ++i) store_block(zero_block(), to + i * kLanes);
      to += run * kLanes;
      done += run;
    }
  }

  void multiply_unfolded(int64_t image, int64_t chunk, int64_t slice, const float* columns) const {
    multiply_slice(image, chunk, slice, [&](int64_t first, int64_t width) {
      return Columns{columns + first * shape_.depth() * kLanes, width * kLanes};
    });
  }

  /// `columns_of(first, width)` gives a panel of the chunk.
  template <class ColumnsOf>
  void multiply_slice(int64_t image, int64_t chunk, int64_t slice,
                      const ColumnsOf& columns_of) const {
    const int64_t begin = slice * DirectShape::kSliceBlocks;
    const int64_t blocks = std::min(DirectShape::kSliceBlocks, shape_.out_blocks - begin);
    const int64_t block = image % p_.group * shape_.out_blocks + begin;  // of all groups
    const int64_t image_step = p_.out_pixels() * kLanes;
    const BlockEpilogue epilogues[] = {
        BlockEpilogue(a_.epilogue, a_.bias, block, p_.c_out),
        BlockEpilogue(a_.epilogue, a_.bias, block + blocks - 1, p_.c_out)};
    const Split panels = panels_of_chunk(chunk);
    for (int64_t panel = 0; panel < panels.parts; ++panel) {
      const int64_t first = panels.begin(panel), width = panels.width(panel);
      const Columns columns = columns_of(first, width);
      const Factors factors = {shape_.depth(),
                               columns.data,
                               columns.step,
                               a_.packed + block * shape_.weights_floats(),
                               shape_.weights_floats(),
                               prefetched(block, slice, panels.parts - 1 - panel)};
      const int64_t offset = (image * shape_.out_blocks + begin) * image_step +
                             (shape_.chunks.columns.begin(chunk) + first) * kLanes;
      float* const output = a_.output + offset;
      const float* const addend = a_.addend ? a_.addend + offset : nullptr;
      multiply(factors, blocks, width,
               [=, &epilogues](int64_t b, int64_t column, const Block& sum) HWY_ATTR {
                 const int64_t at = b * image_step + column * kLanes;
                 epilogues[b].finish(sum, addend ? addend + at : nullptr, output + at);
               });
    }
  }

  /// The weights to prefetch while one panel of a slice that starts at `block` is multiplied,
  /// `left` panels before the last: the last panels prefetch a block each of what this thread
  /// likely takes next; deep layers' are in L3 or in memory.
  const float* prefetched(int64_t block, int64_t slice, int64_t left) const {
    const int64_t next = slice + (shape_.chunks.per_thread ? 1 : p_.threads);
    const int64_t ahead = (next - slice) * DirectShape::kSliceBlocks + left;
    const bool there = left < DirectShape::kSliceBlocks &&
                       slice * DirectShape::kSliceBlocks + ahead < shape_.out_blocks;
    return a_.packed + (block + (there ? ahead : 0)) * shape_.weights_floats();
  }

  const ConvolutionProblem& p_;
  const BlockedConvolutionArguments& a_;
  const DirectShape shape_;
};

void run_direct(const ConvolutionProblem& p, const BlockedConvolutionArguments& a) {
  Direct(p, a).run();
}

void run_pointwise(const ConvolutionProblem& p, const BlockedConvolutionArguments& a) {
  Direct(p, a).run_pointwise();
}

}  // namespace revisit::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace revisit::engine {
namespace {

HWY_EXPORT(run_direct);
HWY_EXPORT(run_pointwise);

bool is_pointwise(const ConvolutionProblem& p) {
  return groups_are_whole_blocks(p) && p.kernel_h == 1 && p.kernel_w == 1 && p.stride_h == 1 &&
         p.stride_w == 1 && p.pad_h == 0 && p.pad_w == 0;
}

int64_t packed_floats(const ConvolutionProblem& p) {
  const DirectShape shape(p);
  return p.group * shape.out_blocks * shape.weights_floats();
}

/// Writes [output block][input block][tap][input channel][kLanes].
void pack(const ConvolutionProblem& p, const float* weights, float* packed) {
  const DirectShape shape(p);
  const int64_t in_per_group = p.c_in_per_group(), out_per_group = p.c_out_per_group();
  parallel_for(p.group * shape.out_blocks, p.threads, [&](int64_t item, int) {
    const int64_t group = item / shape.out_blocks, first = item % shape.out_blocks * kLanes;
    float* to = packed + item * shape.weights_floats();
    for (int64_t block = 0; block < shape.in_blocks; ++block)
      for (int64_t tap = 0; tap < shape.taps; ++tap)
        for (int64_t channel = 0; channel < kLanes; ++channel)
          for (int64_t lane = 0; lane < kLanes; ++lane) {
            const int64_t ci = block * kLanes + channel, co = first + lane;
            *to++ =
                ci < in_per_group && co < out_per_group
                    ? weights[((group * out_per_group + co) * in_per_group + ci) * shape.taps + tap]
                    : 0.0F;
          }
  });
}

}  // namespace

const BlockedConvolutionKernel kBlockedDirect = {
    "direct",
    Layout::kNChw16c,
    groups_are_whole_blocks,
    direct_ms,
    packed_floats,
    pack,
    [](const ConvolutionProblem& p) {
      const DirectShape shape(p);
      return (shape.chunks.per_thread ? p.threads : 1) * shape.columns_floats();
    },
    [](const ConvolutionProblem& p, const BlockedConvolutionArguments& a) {
      HWY_DYNAMIC_DISPATCH(run_direct)(p, a);
    }};

const BlockedConvolutionKernel kBlockedPointwise = {
    "pointwise",
    Layout::kNChw16c,
    is_pointwise,
    pointwise_ms,
    packed_floats,
    pack,
    [](const ConvolutionProblem&) { return int64_t{0}; },
    [](const ConvolutionProblem& p, const BlockedConvolutionArguments& a) {
      HWY_DYNAMIC_DISPATCH(run_pointwise)(p, a);
    }};

}  // namespace revisit::engine
#endif
