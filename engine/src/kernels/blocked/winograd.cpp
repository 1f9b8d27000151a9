#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/blocked/winograd.cpp"
#include <hwy/foreach_target.h>

#include "kernels/blocked/block-inl.h"
#include "kernels/blocked/epilogue-inl.h"
#include "kernels/blocked/kernels.h"
#include "kernels/blocked/multiply-inl.h"
#include "kernels/blocked/partition.h"
#include "kernels/blocked/winograd_transform.h"
#include "revisit/engine/parallel_for.h"

#ifndef REVISIT_WINOGRAD_VARIANTS
#define REVISIT_WINOGRAD_VARIANTS
namespace revisit::engine {
constexpr WinogradVariant kVariants[] = {
    {"winograd F(4x4,3x3)", 4, 4, 3}, {"winograd F(6x6,3x3)", 6, 6, 3},
    {"winograd F(7x4,3x3)", 7, 4, 3}, {"winograd F(7x6,3x3)", 7, 6, 3},
    {"winograd F(5x4,5x5)", 5, 4, 5}, {"winograd F(6x4,5x5)", 6, 4, 5},
};
}  // namespace revisit::engine
#endif

HWY_BEFORE_NAMESPACE();
namespace revisit::engine::HWY_NAMESPACE {

HWY_INLINE Block add_multiple(double factor, const Block& x, const Block& sum) {
  if (factor == 1) return sum + x;
  if (factor == -1) return sum - x;
  return mul_add(hn::Set(Tag(), static_cast<float>(factor)), x, sum);
}

HWY_INLINE Block multiple(double factor, const Block& x) {
  return factor == 1 ? x : hn::Set(Tag(), static_cast<float>(factor)) * x;
}

template <class T, int kRow, int kFirst>
HWY_INLINE Block every_second(const Block (&d)[T::kPoints]) {
  constexpr auto& kFactors = T::kInput[kRow];
  Block sum = multiple(kFactors[kFirst], d[kFirst]);
  REVISIT_UNROLL
  for (int k = kFirst + 2; k < T::kPoints; k += 2)
    if (kFactors[k] != 0) sum = add_multiple(kFactors[k], d[k], sum);
  return sum;
}

template <class T, int kRow, class Sink>
HWY_INLINE void transform_pairs(const Block (&d)[T::kPoints], const Sink& sink) {
  if constexpr (kRow < T::kFinite) {
    const Block even = every_second<T, kRow, 2>(d), odd = every_second<T, kRow, 1>(d);
    sink(kRow, even + odd);
    sink(kRow + 1, even - odd);
    transform_pairs<T, kRow + 2>(d, sink);
  }
}

template <class T, class Sink>
HWY_INLINE void transform_input_line(const Block (&d)[T::kPoints], const Sink& sink) {
  sink(0, every_second<T, 0, 0>(d));
  transform_pairs<T, 1>(d, sink);
  if constexpr (T::kHasInfinity) sink(T::kPoints - 1, every_second<T, T::kPoints - 1, 1>(d));
}

template <class T, class Sink>
HWY_INLINE void transform_output_line(const Block (&m)[T::kPoints], const Sink& sink) {
  Block sums[T::kPairs], differences[T::kPairs];
  REVISIT_UNROLL
  for (int i = 0; i < T::kPairs; ++i) {
    sums[i] = m[1 + 2 * i] + m[2 + 2 * i];
    differences[i] = m[1 + 2 * i] - m[2 + 2 * i];
  }
  REVISIT_UNROLL
  for (int j = 0; j < T::kOutputs; ++j) {
    const Block(&pairs)[T::kPairs] = j % 2 == 0 ? sums : differences;
    Block sum = multiple(T::kOutput[j][1], pairs[0]);
    REVISIT_UNROLL
    for (int i = 1; i < T::kPairs; ++i) sum = add_multiple(T::kOutput[j][1 + 2 * i], pairs[i], sum);
    if (j == 0) sum = sum + m[0];
    if (T::kHasInfinity && j == T::kOutputs - 1) sum = sum + m[T::kPoints - 1];
    sink(j, sum);
  }
}

/// Transforms and multiplies in float32 for all types of values.
template <size_t kVariant>
class Winograd {
 public:
  Winograd(const ConvolutionProblem& p, const BlockedConvolutionArguments& a)
      : p_(p), a_(a), shape_(kVariants[kVariant], p) {}

  void run() const { run_in_chunks(shape_.chunks, 1, p_.threads, *this); }

  int64_t items(int64_t chunk) const { return panels_of_chunk(chunk).parts * shape_.in_blocks; }

  Pieces pieces_of(int64_t chunk, int sharing) const {
    return {shape_.slices(), panels_of_chunk(chunk).parts, sharing};
  }

  /// Writes [panel][block][point][tile][kLanes].
  void prepare(int64_t, int64_t chunk, int64_t item, int64_t columns) const {
    const Split panels = panels_of_chunk(chunk);
    const int64_t panel = item / shape_.in_blocks, block = item % shape_.in_blocks;
    const int64_t width = panels.width(panel);
    const int64_t first = shape_.chunks.columns.begin(chunk) + panels.begin(panel);
    float* const to = inputs_at(columns) +
                      (panels.begin(panel) * shape_.in_blocks + block * width) * kPoints * kLanes;
    with_type(p_.values, [&](auto type) HWY_ATTR {
      using T = decltype(type);
      for (int64_t t = 0; t < width; ++t) {
        const Tile tile = locate(first + t);
        const T* const image = static_cast<const T*>(a_.input) +
                               (tile.image * shape_.in_blocks + block) * p_.h * p_.w * kLanes;
        transform_input(image, tile.y - p_.pad_h, tile.x - p_.pad_w, to + t * kLanes,
                        width * kLanes);
      }
    });
  }

  /// Multiplies all points, then transforms the products back while they are in cache:
  /// [panel][block][point][tile][kLanes].
  void multiply(int64_t, int64_t chunk, const Piece& piece, int64_t columns, int thread) const {
    const float* const inputs = inputs_at(columns);
    const int64_t sets = shape_.chunks.per_thread ? p_.threads : 1;
    float* const products = inputs_at(sets) + thread * shape_.products_floats();
    const int64_t group = piece.slice / shape_.slices_per_group();
    const int64_t begin = piece.slice % shape_.slices_per_group() * shape_.slice_blocks;
    const int64_t blocks = std::min(shape_.slice_blocks, shape_.out_blocks_per_group() - begin);
    const int64_t first_block = group * shape_.out_blocks_per_group() + begin;

    const Split cut = panels_of_chunk(chunk);
    const int64_t n_panels = piece.end_panel - piece.first_panel;
    ChunkPanel panels[WinogradShape::kMaxChunkPanels];
    for (int64_t i = 0; i < n_panels; ++i) {
      const int64_t first = cut.begin(piece.first_panel + i);
      const int64_t width = cut.width(piece.first_panel + i);
      const int64_t block_floats = kPoints * width * kLanes;
      const int64_t before = first * kPoints * kLanes;
      panels[i] = {
          shape_.chunks.columns.begin(chunk) + first, width, block_floats,
          inputs + before * shape_.in_blocks + group * shape_.in_blocks_per_group() * block_floats,
          products + before * blocks};
    }

    const Products order(first_block, blocks);
    for (int64_t step = 0; step < order.steps(); ++step)
      for (int64_t i = 0; i < n_panels; ++i)
        multiply_step(panels[i], order, step, n_panels - 1 - i);

    with_type(p_.values, [&](auto type) HWY_ATTR {
      for (int64_t b = 0; b < blocks; ++b)
        for (int64_t i = 0; i < n_panels; ++i)
          transform_outputs<decltype(type)>(panels[i], b, first_block + b);
    });
  }

 private:
  static constexpr WinogradVariant kTile = kVariants[kVariant];
  using Rows = WinogradTransform<kTile.rows, kTile.taps>;
  using Columns = WinogradTransform<kTile.columns, kTile.taps>;
  static constexpr int kRows = Rows::kPoints, kColumns = Columns::kPoints;
  static constexpr int kPoints = kRows * kColumns;

  float* inputs_at(int64_t index) const { return a_.scratch + index * shape_.inputs_floats(); }

  struct Tile {
    int64_t image, y, x;  // first output pixel
  };
  Tile locate(int64_t tile) const {
    const int64_t row = tile / shape_.tiles_x;
    return {row / shape_.tiles_y, row % shape_.tiles_y * kTile.rows,
            tile % shape_.tiles_x * kTile.columns};
  }

  Split panels_of_chunk(int64_t chunk) const {
    return panels_of(shape_.chunks.columns.width(chunk));
  }

  /// Writes point (i, j) to `to + (i * kColumns + j) * step`.
  template <class T>
  void transform_input(const T* image, int64_t y0, int64_t x0, float* to, int64_t step) const {
    alignas(64) static constexpr T kZeros[kColumns * kLanes] = {};
    const int64_t x_begin = std::clamp<int64_t>(-x0, 0, kColumns);
    const int64_t x_end = std::clamp<int64_t>(p_.w - x0, x_begin, kColumns);
    const T* rows[kRows];
    for (int i = 0; i < kRows; ++i) {
      const int64_t y = y0 + i;
      rows[i] = y >= 0 && y < p_.h ? image + (y * p_.w + x0 + x_begin) * kLanes : kZeros;
    }
    alignas(64) float half[kRows][kColumns][kLanes];
    for (int64_t j = 0; j < kColumns; ++j) {
      if (j < x_begin || j >= x_end) {
        for (int i = 0; i < kRows; ++i) store_block(zero_block(), half[i][j]);
        continue;
      }
      Block line[kRows];
      REVISIT_UNROLL
      for (int i = 0; i < kRows; ++i) line[i] = load_block(rows[i] + (j - x_begin) * kLanes);
      transform_input_line<Rows>(
          line, [&](int i, const Block& b) HWY_ATTR { store_block(b, half[i][j]); });
    }
    transform_input_rows(half, to, step);
  }

  /// The part that is equal for all types.
  static HWY_NOINLINE void transform_input_rows(const float (&half)[kRows][kColumns][kLanes],
                                                float* to, int64_t step) {
    for (int i = 0; i < kRows; ++i) {
      Block line[kColumns];
      REVISIT_UNROLL
      for (int j = 0; j < kColumns; ++j) line[j] = load_block(half[i][j]);
      transform_input_line<Columns>(line, [&](int j, const Block& b) HWY_ATTR {
        store_block(b, to + (i * kColumns + j) * step);
      });
    }
  }

  struct ChunkPanel {
    int64_t first_tile, width;
    int64_t block_floats;  // for all points
    const float* inputs;   // from the first block of the group
    float* products;
  };

  /// Order of a slice's products: all output blocks of a point, kTileBlocks at a time.
  struct Products {
    int64_t first_block, blocks, steps_per_point;

    Products(int64_t first, int64_t n)
        : first_block(first), blocks(n), steps_per_point((n + kTileBlocks - 1) / kTileBlocks) {}
    int64_t steps() const { return kPoints * steps_per_point; }
    int64_t point(int64_t step) const { return step / steps_per_point; }
    int64_t begin(int64_t step) const { return step % steps_per_point * kTileBlocks; }
    int64_t count(int64_t step) const {
      return std::min<int64_t>(kTileBlocks, blocks - begin(step));
    }
  };

  int64_t weights_floats() const { return shape_.in_blocks_per_group() * kLanes * kLanes; }
  const float* weights(int64_t block, int64_t point) const {
    return a_.packed + (block * kPoints + point) * weights_floats();
  }

  /// Multiplies one panel of a step, with `left` panels remaining. The last panels each prefetch a
  /// block of the next step's weights, because those of deep layers are in L3 or memory.
  void multiply_step(const ChunkPanel& panel, const Products& products, int64_t step,
                     int64_t left) const {
    const int64_t point = products.point(step), begin = products.begin(step), next = step + 1;
    const float* const here = weights(products.first_block + begin, point);
    const bool prefetches = next < products.steps() && left < products.count(next);
    const float* const prefetched =
        prefetches
            ? weights(products.first_block + products.begin(next) + left, products.point(next))
            : here;
    const int64_t offset = point * panel.width * kLanes, block_floats = panel.block_floats;
    HWY_NAMESPACE::multiply(
        Factors<float>{shape_.in_blocks_per_group(), panel.inputs + offset, block_floats, here,
                       kPoints * weights_floats(), prefetched,
                       panel.inputs + products.point(next) * panel.width * kLanes},
        products.count(step), panel.width,
        StoreProducts{panel.products + begin * block_floats + offset, block_floats});
  }

  template <class T>
  void transform_outputs(const ChunkPanel& panel, int64_t b, int64_t block) const {
    const BlockEpilogue epilogue(a_.epilogue, a_.bias, block, p_.c_out);
    for (int64_t t = 0; t < panel.width; ++t)
      transform_output<T>(locate(panel.first_tile + t),
                          panel.products + b * panel.block_floats + t * kLanes,
                          panel.width * kLanes, block, epilogue);
  }

  static HWY_NOINLINE void transform_output_rows(const float* from, int64_t step,
                                                 float (&half)[kRows][kTile.columns][kLanes]) {
    for (int i = 0; i < kRows; ++i) {
      Block line[kColumns];
      REVISIT_UNROLL
      for (int j = 0; j < kColumns; ++j) line[j] = load_block(from + (i * kColumns + j) * step);
      transform_output_line<Columns>(
          line, [&](int j, const Block& b) HWY_ATTR { store_block(b, half[i][j]); });
    }
  }

  template <class T>
  void transform_output(const Tile& tile, const float* from, int64_t step, int64_t block,
                        const BlockEpilogue& epilogue) const {
    alignas(64) float half[kRows][kTile.columns][kLanes];
    transform_output_rows(from, step, half);
    const int64_t rows = std::min<int64_t>(kTile.rows, p_.out_h - tile.y);
    const int64_t columns = std::min<int64_t>(kTile.columns, p_.out_w - tile.x);
    const int64_t first =
        ((tile.image * shape_.out_blocks + block) * p_.out_h + tile.y) * p_.out_w + tile.x;
    const int64_t row = p_.out_w * kLanes;
    const T* addend = a_.addend ? static_cast<const T*>(a_.addend) + first * kLanes : nullptr;
    T* output = static_cast<T*>(a_.output) + first * kLanes;
    for (int64_t j = 0; j < columns; ++j, output += kLanes, addend += addend ? kLanes : 0) {
      Block line[kRows];
      REVISIT_UNROLL
      for (int i = 0; i < kRows; ++i) line[i] = load_block(half[i][j]);
      Block sums[kTile.rows];
      transform_output_line<Rows>(line, [&](int i, const Block& b) HWY_ATTR { sums[i] = b; });
      if (rows == kTile.rows) {
        epilogue.finish(sums, addend, output, row);
        continue;
      }
      Block some[kTile.rows];  // registers cannot be indexed
      REVISIT_UNROLL
      for (int i = 0; i < kTile.rows; ++i) some[i] = sums[i];
      for (int i = 0; i < rows; ++i) {  // crosses the image's lower border
        Block sum[] = {some[i]};
        epilogue.finish(sum, addend ? addend + i * row : nullptr, output + i * row);
      }
    }
  }

  const ConvolutionProblem& p_;
  const BlockedConvolutionArguments& a_;
  const WinogradShape shape_;
};

template <size_t... kVariant>
void run_variant(size_t variant, const ConvolutionProblem& p, const BlockedConvolutionArguments& a,
                 std::index_sequence<kVariant...>) {
  using Function = void (*)(const ConvolutionProblem&, const BlockedConvolutionArguments&);
  static constexpr Function kRun[] = {
      [](const ConvolutionProblem& problem, const BlockedConvolutionArguments& arguments) {
        Winograd<kVariant>(problem, arguments).run();
      }...};
  kRun[variant](p, a);
}

void run_winograd(size_t variant, const ConvolutionProblem& p,
                  const BlockedConvolutionArguments& a) {
  run_variant(variant, p, a, std::make_index_sequence<std::size(kVariants)>());
}

}  // namespace revisit::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace revisit::engine {
namespace {

HWY_EXPORT(run_winograd);

template <size_t kVariant>
bool supports(const ConvolutionProblem& p) {
  constexpr int kTaps = kVariants[kVariant].taps;
  return p.kernel_h == kTaps && p.kernel_w == kTaps && p.stride_h == 1 && p.stride_w == 1 &&
         p.dilation_h == 1 && p.dilation_w == 1 && groups_are_whole_blocks(p);
}

template <size_t kVariant>
int64_t packed_floats(const ConvolutionProblem& p) {
  return padded_channels(p.c_out) * padded_channels(p.c_in_per_group()) *
         kVariants[kVariant].points();
}

/// `kernels` are [taps][taps][lane]. Double precision, which has no run-time cost. Writes point (i,
/// j) of all lanes to `to + (i * points + j) * step`.
template <class Rows, class Columns>
void transform_weights(const double (&kernels)[Rows::kTaps][Columns::kTaps][kLanes], float* to,
                       int64_t step) {
  for (int i = 0; i < Rows::kPoints; ++i) {
    double half[Columns::kTaps][kLanes] = {};
    for (int y = 0; y < Rows::kTaps; ++y)
      for (int x = 0; x < Columns::kTaps; ++x)
        for (int64_t lane = 0; lane < kLanes; ++lane)
          half[x][lane] += Rows::kWeights[i][y] * kernels[y][x][lane];
    for (int j = 0; j < Columns::kPoints; ++j, to += step) {
      double sums[kLanes] = {};
      for (int x = 0; x < Columns::kTaps; ++x)
        for (int64_t lane = 0; lane < kLanes; ++lane)
          sums[lane] += Columns::kWeights[j][x] * half[x][lane];
      for (int64_t lane = 0; lane < kLanes; ++lane) to[lane] = static_cast<float>(sums[lane]);
    }
  }
}

/// Writes [output block][point][input channel][kLanes].
template <size_t kVariant>
void pack(const ConvolutionProblem& p, const float* weights, float* packed) {
  constexpr WinogradVariant kTile = kVariants[kVariant];
  constexpr int kTaps = kTile.taps;
  const int64_t channels = padded_channels(p.c_in_per_group());
  const int64_t point_floats = channels * kLanes;
  parallel_for(channel_blocks(p.c_out) * channels, p.threads, [&](int64_t item, int) {
    const int64_t block = item / channels, c = item % channels;
    double kernels[kTaps][kTaps][kLanes] = {};
    for (int64_t lane = 0; lane < kLanes && c < p.c_in_per_group(); ++lane) {
      const int64_t co = block * kLanes + lane;
      if (co >= p.c_out) break;
      const float* kernel = weights + (co * p.c_in_per_group() + c) * kTaps * kTaps;
      for (int y = 0; y < kTaps; ++y)
        for (int x = 0; x < kTaps; ++x)
          kernels[y][x][lane] = static_cast<double>(kernel[y * kTaps + x]);
    }
    transform_weights<WinogradTransform<kTile.rows, kTaps>,
                      WinogradTransform<kTile.columns, kTaps>>(
        kernels, packed + block * kTile.points() * point_floats + c * kLanes, point_floats);
  });
}

template <size_t kVariant>
constexpr BlockedConvolutionKernel kernel() {
  return {kVariants[kVariant].name,
          Layout::kNChw16c,
          supports<kVariant>,
          [](const ConvolutionProblem& p) { return winograd_ms(kVariants[kVariant], p); },
          packed_floats<kVariant>,
          pack<kVariant>,
          [](const ConvolutionProblem& p) {
            return WinogradShape(kVariants[kVariant], p).scratch_floats(p.threads);
          },
          [](const ConvolutionProblem& p, const BlockedConvolutionArguments& a) {
            REVISIT_DISPATCH(run_winograd, instructions_for(p.values))(kVariant, p, a);
          },
          std::max(kVariants[kVariant].rows, kVariants[kVariant].columns) +
              kVariants[kVariant].taps - 1,
          Products::kFloat32,
          [](const ConvolutionProblem& p) {
            const WinogradShape shape(kVariants[kVariant], p);
            return shape.points * shape.tiles() * p.c_in_per_group() * p.c_out;
          }};
}

template <size_t... kVariant>
std::span<const BlockedConvolutionKernel> list(std::index_sequence<kVariant...>) {
  static constexpr BlockedConvolutionKernel kList[] = {kernel<kVariant>()...};
  return kList;
}

}  // namespace

std::span<const BlockedConvolutionKernel> winograd_kernels() {
  return list(std::make_index_sequence<std::size(kVariants)>());
}

}  // namespace revisit::engine
#endif
