#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/blocked/depthwise.cpp"
#include <hwy/foreach_target.h>

#include "kernels/blocked/epilogue-inl.h"
#include "kernels/blocked/kernels.h"
#include "kernels/blocked/partition.h"
#include "kernels/window.h"
#include "revisit/engine/parallel_for.h"

HWY_BEFORE_NAMESPACE();
namespace revisit::engine::HWY_NAMESPACE {

/// Range [first, end) of a window's taps inside the image, along one axis.
struct Taps {
  int64_t first, end;
};

inline Taps taps_inside(int64_t start, int64_t size, int64_t kernel, int64_t dilation) {
  const WindowRange range(start, (kernel - 1) * dilation + 1, size);
  if (dilation == 1) return {range.begin - start, range.end - start};  // divisions are slow
  return {(range.begin - start + dilation - 1) / dilation,
          (range.end - start + dilation - 1) / dilation};
}

struct OwnChannel {
  template <class T>
  HWY_INLINE Block operator()(const T* from) const {
    return load_block(from);
  }
};

struct OwnChannels {
  static constexpr int64_t count = 1;
  OwnChannel nth(int64_t) const { return {}; }
};

class ChannelOfGroup {
 public:
  /// Vector `i` of a block gathers `lanes` of the input vector at `vectors[i]`.
  ChannelOfGroup(const int64_t* vectors, const int32_t* lanes)
      : vectors_(vectors), lanes_(hn::SetTableIndices(Tag(), lanes)) {}

  template <class T>
  HWY_INLINE Block operator()(const T* from) const {
    Block r;
    REVISIT_UNROLL
    for (int i = 0; i < kVectors; ++i)
      r.v[i] = hn::TableLookupLanes(load_vector(from + vectors_[i]), lanes_);
    return r;
  }

 private:
  const int64_t* vectors_;
  decltype(hn::SetTableIndices(Tag(), static_cast<const int32_t*>(nullptr))) lanes_;
};

/// Inputs of groups of `count` channels; `count` divides kLanes.
class ChannelsOfGroup {
 public:
  int64_t count;

  explicit ChannelsOfGroup(int64_t size) : count(size) {
    for (int64_t n = 0; n < size; ++n) {
      for (int64_t i = 0; i < kVectorLanes; ++i)
        lanes_[n][i] = static_cast<int32_t>((i / size * size + n) % kVectorLanes);
      for (int64_t i = 0; i < kVectors; ++i) {
        const int64_t first = i * kVectorLanes;
        vectors_[n][i] =
            (first / size * size + (size > kVectorLanes ? n : 0)) / kVectorLanes * kVectorLanes;
      }
    }
  }

  ChannelOfGroup nth(int64_t n) const { return {vectors_[n], lanes_[n]}; }

 private:
  int32_t lanes_[kLanes / 2][kVectorLanes];
  int64_t vectors_[kLanes / 2][kVectors];
};

/// Supports one filter per channel, or groups that divide a block.
template <class T, class Channels>
class Depthwise {
 public:
  Depthwise(const ConvolutionProblem& p, const BlockedConvolutionArguments& a,
            const Channels& channels)
      : p_(p), a_(a), channels_(channels), whole_(whole_windows(p)) {}

  /// A work item is a band of rows of one block. Items are ordered by bands, as in neighboring
  /// products, so that a thread reads data it wrote.
  void run() const {
    constexpr int64_t kGrain = 512, kLeast = 64;  // pixels
    const int64_t planes = p_.n * channel_blocks(p_.c_out);
    const int64_t for_each_thread = std::min<int64_t>(p_.out_pixels() / kLeast, p_.threads);
    const Split bands = {p_.out_h, std::clamp(std::max(p_.out_pixels() / kGrain, for_each_thread),
                                              int64_t{1}, p_.out_h)};
    parallel_for(planes * bands.parts, p_.threads, [&](int64_t item, int) {
      const int64_t band = item / planes, plane = item % planes;
      const BlockEpilogue epilogue(a_.epilogue, a_.bias, plane % channel_blocks(p_.c_out),
                                   p_.c_out);
      for (int64_t y = bands.begin(band); y < bands.end(band); ++y) run_row(plane, y, epilogue);
    });
  }

 private:
  static constexpr int kPixels = kVectors == 1 ? 8 : 4;

  /// Output columns [first, end) whose windows are horizontally inside the image.
  static Taps whole_windows(const ConvolutionProblem& p) {
    const int64_t room = p.w + p.pad_w - (p.kernel_w - 1) * p.dilation_w - 1;
    const int64_t end = room < 0 ? 0 : std::min(room / p.stride_w + 1, p.out_w);
    return {std::min((p.pad_w + p.stride_w - 1) / p.stride_w, end), end};
  }

  struct Row {
    const T* in;
    const float* weights;
    int64_t y0;
    Taps taps;
    int64_t offset;
    const BlockEpilogue& epilogue;
  };

  /// `plane` counts the blocks of all images.
  void run_row(int64_t plane, int64_t y, const BlockEpilogue& epilogue) const {
    const int64_t block = plane % channel_blocks(p_.c_out), y0 = y * p_.stride_h - p_.pad_h;
    const Row row = {static_cast<const T*>(a_.input) + plane * p_.h * p_.w * kLanes,
                     a_.packed + block * p_.kernel_h * row_weights(),
                     y0,
                     taps_inside(y0, p_.h, p_.kernel_h, p_.dilation_h),
                     (plane * p_.out_h + y) * p_.out_w * kLanes,
                     epilogue};
    for (int64_t x = 0; x < whole_.first; ++x) run_at_border(row, x);
    for (int64_t x = run_usual(row); x < whole_.end; x += kPixels)
      run_pixels(row, x, std::min<int64_t>(kPixels, whole_.end - x),
                 std::make_index_sequence<kPixels>());
    for (int64_t x = whole_.end; x < p_.out_w; ++x) run_at_border(row, x);
  }

  /// Returns the first whole window that remains.
  int64_t run_usual(const Row& row) const {
    if (p_.kernel_w != kCommonTaps || p_.dilation_w != 1 || p_.stride_w > 2 ||
        whole_.end - whole_.first < kPixels)
      return whole_.first;
    p_.stride_w == 1 ? run_usual<1>(row) : run_usual<2>(row);
    return whole_.end;
  }

  /// Nothing but pointers changes from pixels to pixels, so that their sums begin while those
  /// before are finished. The last pixels overlap those before.
  template <int kStride>
  void run_usual(const Row& row) const {
    const int64_t rows = row.taps.end - row.taps.first, step = p_.dilation_h * p_.w * kLanes;
    const T* const in = input_row(row, row.taps.first, -p_.pad_w);
    const float* const weights = row.weights + row.taps.first * row_weights();
    const T* const addend = static_cast<const T*>(a_.addend);
    T* const output = static_cast<T*>(a_.output);
    const int64_t end = whole_.end, last = end - kPixels;
    for (int64_t next = whole_.first; next < end; next += kPixels) {
      const int64_t x = std::min(next, last), at = row.offset + x * kLanes;
      Block sums[kPixels];
      REVISIT_UNROLL
      for (Block& sum : sums) sum = zero_block();
      const T* from = in + x * kStride * kLanes;
      const float* w = weights;
      for (int64_t ky = 0; ky < rows; ++ky, from += step)
        for (int64_t i = 0; i < channels_.count; ++i, w += kCommonTaps * kLanes)
          add_taps<kStride>(from, channels_.nth(i), w, sums);
      row.epilogue.finish(sums, addend ? addend + at : nullptr, output + at);
    }
  }

  void run_at_border(const Row& row, int64_t x) const {
    const int64_t x0 = x * p_.stride_w - p_.pad_w;
    Block sum[1] = {zero_block()};
    accumulate<1>(row, x0, taps_inside(x0, p_.w, p_.kernel_w, p_.dilation_w), sum);
    finish<1>(row, x, sum);
  }

  template <size_t... kIndex>
  void run_pixels(const Row& row, int64_t x, int64_t count, std::index_sequence<kIndex...>) const {
    using Function = void (Depthwise::*)(const Row&, int64_t) const;
    static constexpr Function kFunctions[] = {&Depthwise::run_whole<kIndex + 1>...};
    (this->*kFunctions[count - 1])(row, x);
  }

  template <int kCount>
  void run_whole(const Row& row, int64_t x) const {
    const int64_t x0 = x * p_.stride_w - p_.pad_w;
    Block sums[kCount];
    REVISIT_UNROLL
    for (int i = 0; i < kCount; ++i) sums[i] = zero_block();
    accumulate<kCount>(row, x0, {0, p_.kernel_w}, sums);
    finish<kCount>(row, x, sums);
  }

  template <int kCount>
  HWY_INLINE void finish(const Row& row, int64_t x, Block (&sums)[kCount]) const {
    const auto* const addend = static_cast<const T*>(a_.addend);
    auto* const output = static_cast<T*>(a_.output);
    const int64_t at = row.offset + x * kLanes;
    row.epilogue.finish(sums, addend ? addend + at : nullptr, output + at);
  }

  /// Size of a row of taps: [channel of the group][tap][kLanes].
  int64_t row_weights() const { return channels_.count * p_.kernel_w * kLanes; }

  const T* input_row(const Row& row, int64_t ky, int64_t x0) const {
    return row.in + ((row.y0 + ky * p_.dilation_h) * p_.w + x0) * kLanes;
  }

  template <class Work>
  HWY_INLINE void for_each_input(const Row& row, const Work& work) const {
    for (int64_t ky = row.taps.first; ky < row.taps.end; ++ky)
      for (int64_t i = 0; i < channels_.count; ++i)
        work(ky, channels_.nth(i), row.weights + ky * row_weights() + i * p_.kernel_w * kLanes);
  }

  /// Pixels are `stride_w` apart from input column `x0`. All taps must be inside the image.
  template <int kCount>
  HWY_INLINE void accumulate(const Row& row, int64_t x0, Taps columns,
                             Block (&sums)[kCount]) const {
    for_each_input(row, [&](int64_t ky, const auto& load, const float* weights) HWY_ATTR {
      for (int64_t kx = columns.first; kx < columns.end; ++kx) {
        const Block w = load_block(weights + kx * kLanes);
        const T* from = input_row(row, ky, x0 + kx * p_.dilation_w);
        REVISIT_UNROLL
        for (int i = 0; i < kCount; ++i)
          sums[i] = mul_add(load(from + i * p_.stride_w * kLanes), w, sums[i]);
      }
    });
  }

  static constexpr int kCommonTaps = 3;

  /// Sums in the order of accumulate(), but loads each input once for all taps.
  template <int kStride, class Load>
  HWY_INLINE static void add_taps(const T* from, const Load& load, const float* weights,
                                  Block (&sums)[kPixels]) {
    Block w[kCommonTaps];
    REVISIT_UNROLL
    for (int kx = 0; kx < kCommonTaps; ++kx) w[kx] = load_block(weights + kx * kLanes);
    REVISIT_UNROLL
    for (int j = 0; j < (kPixels - 1) * kStride + kCommonTaps; ++j) {
      const Block x = load(from + j * kLanes);
      REVISIT_UNROLL
      for (int kx = j % kStride; kx < kCommonTaps; kx += kStride) {
        const int i = (j - kx) / kStride;
        if (kx <= j && i < kPixels) sums[i] = mul_add(x, w[kx], sums[i]);
      }
    }
  }

  const ConvolutionProblem& p_;
  const BlockedConvolutionArguments& a_;
  const Channels channels_;
  const Taps whole_;
};

template <class Channels>
void run_all(const ConvolutionProblem& p, const BlockedConvolutionArguments& a,
             const Channels& channels) {
  with_type(p.values,
            [&](auto type) { Depthwise<decltype(type), Channels>(p, a, channels).run(); });
}

void run_depthwise(const ConvolutionProblem& p, const BlockedConvolutionArguments& a) {
  run_all(p, a, OwnChannels());
}

void run_narrow_groups(const ConvolutionProblem& p, const BlockedConvolutionArguments& a) {
  run_all(p, a, ChannelsOfGroup{p.c_in_per_group()});
}

}  // namespace revisit::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace revisit::engine {
namespace {

HWY_EXPORT(run_depthwise);
HWY_EXPORT(run_narrow_groups);

int64_t depthwise_floats(const ConvolutionProblem& p) {
  return padded_channels(p.c_out) * p.depth();
}

/// Writes [block][ky][channel of the group][kx][kLanes].
void pack_depthwise(const ConvolutionProblem& p, const float* weights, float* packed) {
  const int64_t inputs = p.c_in_per_group();
  for (int64_t block = 0; block < channel_blocks(p.c_out); ++block)
    for (int64_t ky = 0; ky < p.kernel_h; ++ky)
      for (int64_t i = 0; i < inputs; ++i)
        for (int64_t kx = 0; kx < p.kernel_w; ++kx)
          for (int64_t c = block * kLanes; c < (block + 1) * kLanes; ++c) {
            const int64_t from = ((c * inputs + i) * p.kernel_h + ky) * p.kernel_w + kx;
            *packed++ = c < p.c_out ? weights[from] : 0.0F;
          }
}

constexpr BlockedConvolutionKernel kernel(const char* name,
                                          bool (*supports)(const ConvolutionProblem&),
                                          double (*predicted_ms)(const ConvolutionProblem&),
                                          void (*run)(const ConvolutionProblem&,
                                                      const BlockedConvolutionArguments&)) {
  return {name,
          Layout::kNChw16c,
          supports,
          predicted_ms,
          depthwise_floats,
          pack_depthwise,
          [](const ConvolutionProblem&) { return int64_t{0}; },
          run};
}

}  // namespace

const BlockedConvolutionKernel kBlockedDepthwise = kernel(
    "depthwise",
    [](const ConvolutionProblem& p) { return p.group == p.c_in && p.group == p.c_out; },
    depthwise_ms,
    [](const ConvolutionProblem& p, const BlockedConvolutionArguments& a) {
      REVISIT_DISPATCH(run_depthwise, instructions_for(p.values))(p, a);
    });

const BlockedConvolutionKernel kBlockedNarrowGroups = kernel(
    "narrow groups",
    [](const ConvolutionProblem& p) {
      const int64_t width = p.c_in_per_group();
      return p.c_in == p.c_out && width > 1 && width < kLanes && kLanes % width == 0;
    },
    [](const ConvolutionProblem& p) {  // like a depthwise convolution with that many times the taps
      ConvolutionProblem all = p;
      all.kernel_w *= p.c_in_per_group();
      return depthwise_ms(all);
    },
    [](const ConvolutionProblem& p, const BlockedConvolutionArguments& a) {
      REVISIT_DISPATCH(run_narrow_groups, instructions_for(p.values))(p, a);
    });

}  // namespace revisit::engine
#endif
