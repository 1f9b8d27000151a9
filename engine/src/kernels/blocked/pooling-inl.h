#if defined(REVISIT_BLOCKED_POOLING_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef REVISIT_BLOCKED_POOLING_INL_H
#undef REVISIT_BLOCKED_POOLING_INL_H
#else
#define REVISIT_BLOCKED_POOLING_INL_H
#endif

#include <algorithm>

#include "kernels/blocked/block-inl.h"
#include "kernels/blocked/partition.h"
#include "kernels/nchw.h"

HWY_BEFORE_NAMESPACE();
namespace revisit::engine::HWY_NAMESPACE {
namespace {

/// Clips the range to the image; if it is empty, `begin` equals `end` within the image.
HWY_INLINE WindowRange in_image(WindowRange range, int64_t size) {
  range.begin = std::min(range.begin, size);
  range.end = std::max(range.end, range.begin);
  return range;
}
HWY_INLINE WindowRange rows_of(const PoolingProblem& p, int64_t y) {
  return in_image(p.rows(y), p.h);
}
HWY_INLINE WindowRange columns_of(const PoolingProblem& p, int64_t x) {
  return in_image(p.columns(x), p.w);
}

struct Largest {
  template <class Out>
  static HWY_INLINE Vector first() {
    return hn::Set(
        Tag(), empty_maximum(std::is_same_v<Out, float> ? Precision::kFloat32 : Precision::kBf16));
  }
  /// Ignores NaN: x > best ? x : best.
  static HWY_INLINE Vector add(Vector best, Vector x) {
    if constexpr (kMaxIsFirstIfGreater) return hn::Max(x, best);
    return hn::IfThenElse(hn::Gt(x, best), x, best);
  }
  static HWY_INLINE Vector last(Vector best, float) { return best; }
};

struct Mean {
  template <class>
  static HWY_INLINE Vector first() {
    return hn::Zero(Tag());
  }
  static HWY_INLINE Vector add(Vector sum, Vector x) { return hn::Add(sum, x); }
  static HWY_INLINE Vector last(Vector sum, float area) {
    return hn::Div(sum, hn::Set(Tag(), area));
  }
};

/// Rows of a plane, or some of them, that one row of windows reads, and the destination.
template <class In, class Out>
struct RowOfWindows {
  const In* in;  // first row, from column `first_column`
  int64_t first_column;
  int64_t row_step;
  int64_t rows;
  int64_t height;      // windows' height, clipped to image and padding, for means
  int64_t begin, end;  // range of windows, out of `out_w`
  Out* out;            // window `begin`
  bool continued;      // `out` has results of earlier rows
};

template <class Operation, int kCount, class In, class Out>
HWY_INLINE void pool_windows(const RowOfWindows<In, Out>& row, const In* in, int64_t step,
                             int64_t columns, float area, Out* out) {
  for (int64_t part = 0; part < kLanes; part += kVectorLanes) {
    Vector result[kCount];
    REVISIT_UNROLL
    for (int i = 0; i < kCount; ++i)
      result[i] =
          row.continued ? load_vector(out + i * kLanes + part) : Operation::template first<Out>();
    for (int64_t y = 0; y < row.rows; ++y)
      for (int64_t x = 0; x < columns; ++x) {
        const In* pixel = in + y * row.row_step + x * kLanes + part;
        REVISIT_UNROLL
        for (int i = 0; i < kCount; ++i)
          result[i] = Operation::add(result[i], load_vector(pixel + i * step));
      }
    REVISIT_UNROLL
    for (int i = 0; i < kCount; ++i)
      store_vector(Operation::last(result[i], area), out + i * kLanes + part);
  }
}

template <class Operation, class In, class Out>
HWY_INLINE void pool_row(const PoolingProblem& p, const RowOfWindows<In, Out>& row) {
  constexpr int kCount = 8;
  // Windows in [whole_begin, whole_end) are horizontally inside the image.
  const int64_t whole_begin = (p.pad_w + p.stride_w - 1) / p.stride_w;
  const int64_t room = p.w + p.pad_w - p.kernel_w;
  const int64_t whole_end = room < 0 ? 0 : room / p.stride_w + 1;
  for (int64_t x = row.begin; x < row.end;) {
    const WindowRange columns = columns_of(p, x);
    const int64_t width = p.width(columns);
    const auto run = [&](auto count) HWY_ATTR {
      pool_windows<Operation, decltype(count)::value>(
          row, row.in + (columns.begin - row.first_column) * kLanes, p.stride_w * kLanes,
          columns.end - columns.begin, static_cast<float>(row.height * width),
          row.out + (x - row.begin) * kLanes);
      x += count;
    };
    if (x >= whole_begin && x + kCount <= std::min(whole_end, row.end))
      run(std::integral_constant<int, kCount>());
    else
      run(std::integral_constant<int, 1>());
  }
}

struct PixelRange {
  int64_t y, begin, end;
};

template <class T>
struct PoolingPiece {
  const PoolingProblem& pooling;
  int64_t channels;
  int64_t begin, end;          // windows of a row
  int64_t first_row, end_row;  // pixel rows
  T* output;
  T* continued;  // [row of windows][block][window][kLanes]: windows that begin above first_row
  float* row;    // scratch: one row of pixels, all channels

  /// First row of windows that ends below pixel row `y`.
  int64_t first_below(int64_t y) const {
    int64_t first = 0;
    while (first < pooling.out_h && rows_of(pooling, first).end <= y) ++first;
    return first;
  }

  /// Destination of a row of windows; blocks are `step` numbers apart.
  struct Place {
    T* at;
    int64_t step;
  };
  Place in_output(int64_t y) const {
    return {output + (y * pooling.out_w + begin) * kLanes, pooling.out_h * pooling.out_w * kLanes};
  }
  Place in_continued(int64_t y) const {
    const int64_t step = (end - begin) * kLanes;
    return {continued + (y - first_below(first_row)) * channel_blocks(channels) * step, step};
  }
  bool continues(int64_t y) const {
    return rows_of(pooling, y).begin < first_row && rows_of(pooling, y).end > first_row;
  }
  Place place(int64_t y) const { return continues(y) ? in_continued(y) : in_output(y); }

  /// Adds `count` rows (0 or 1) of pixels from `left` to `right` to row `y` of windows.
  HWY_INLINE void add(int64_t y, int64_t count, bool has_some, int64_t left, int64_t right) const {
    const Place to = place(y);
    for (int64_t block = 0; block < channel_blocks(channels); ++block)
      pool_row<Largest>(pooling, RowOfWindows<float, T>{.in = row + block * (right - left) * kLanes,
                                                        .first_column = left,
                                                        .row_step = 0,
                                                        .rows = count,
                                                        .height = 0,
                                                        .begin = begin,
                                                        .end = end,
                                                        .out = to.at + block * to.step,
                                                        .continued = has_some});
  }

  HWY_INLINE void clear_tail(int64_t y) const {
    const Place to = place(y);
    const int64_t last_block = channel_blocks(channels) - 1;
    clear_tail_lanes(channels, last_block, end - begin, to.at + last_block * to.step);
  }
};

/// `make_row(range, row, step)` writes the pixels of a nonempty range to `row`, with blocks `step`
/// floats apart. It is called from top to bottom for rows in at least one window.
template <class T, class MakeRow>
HWY_INLINE void pool_piece(const PoolingPiece<T>& piece, const MakeRow& make_row) {
  const PoolingProblem& p = piece.pooling;
  const int64_t left = columns_of(p, piece.begin).begin, right = columns_of(p, piece.end - 1).end;
  int64_t first = piece.first_below(piece.first_row);  // may still need the current row
  for (int64_t y = piece.first_row; y < piece.end_row; ++y) {
    while (first < p.out_h && rows_of(p, first).end <= y) ++first;
    if (first == p.out_h || rows_of(p, first).begin > y) continue;
    if (left < right)  // otherwise the piece has a single, empty window
      make_row(PixelRange{y, left, right}, piece.row, (right - left) * kLanes);
    for (int64_t out_y = first; out_y < p.out_h && rows_of(p, out_y).begin <= y; ++out_y)
      piece.add(out_y, 1, y > std::max(rows_of(p, out_y).begin, piece.first_row), left, right);
  }
  for (int64_t y = 0; y < p.out_h; ++y) {
    const WindowRange rows = rows_of(p, y);
    const bool is_empty = rows.begin == rows.end;
    if (is_empty && piece.first_row == 0) piece.add(y, 0, false, left, right);
    if (is_empty ? piece.first_row == 0 : rows.begin < piece.end_row && rows.end > piece.first_row)
      piece.clear_tail(y);
  }
}

template <class T>
HWY_INLINE void join_continued(const PoolingPiece<T>& piece) {
  for (int64_t y = piece.first_below(piece.first_row);
       y < piece.pooling.out_h && piece.continues(y); ++y) {
    const typename PoolingPiece<T>::Place from = piece.in_continued(y), to = piece.in_output(y);
    for (int64_t block = 0; block < channel_blocks(piece.channels); ++block)
      for (int64_t i = 0; i < (piece.end - piece.begin) * kLanes; i += kVectorLanes) {
        T* const best = to.at + block * to.step + i;
        store_vector(Largest::add(load_vector(best), load_vector(from.at + block * from.step + i)),
                     best);
      }
  }
}

/// Max pooling piece by piece. `rows_of(image, thread)` returns `make_row` of a piece for
/// pool_piece(). `scratch` has PoolingPieces::scratch_floats() floats.
template <class T, class RowsOf>
void pool_pieces(const PoolingProblem& p, int64_t channels, const PoolingPieces& pieces, T* output,
                 float* scratch, const RowsOf& rows_of) {
  const int64_t bands = pieces.bands.parts;
  float* const rows = scratch;
  T* const continued = reinterpret_cast<T*>(scratch + pieces.threads * pieces.row_floats());
  const auto piece_of = [&](int64_t image, int64_t strip, int64_t band, int thread) HWY_ATTR {
    return PoolingPiece<T>{.pooling = p,
                           .channels = channels,
                           .begin = strip * pieces.windows,
                           .end = std::min((strip + 1) * pieces.windows, p.out_w),
                           .first_row = pieces.bands.begin(band),
                           .end_row = pieces.bands.end(band),
                           .output = output + image * pieces.blocks * kLanes * p.out_h * p.out_w,
                           .continued = continued + ((image * pieces.strips + strip) * (bands - 1) +
                                                     std::max<int64_t>(band - 1, 0)) *
                                                        pieces.continued_numbers(),
                           .row = rows + thread * pieces.row_floats()};
  };
  parallel_for(pieces.count(), pieces.threads, [&](int64_t item, int thread) HWY_ATTR {
    const int64_t image = item / bands / pieces.strips;
    pool_piece(piece_of(image, item / bands % pieces.strips, item % bands, thread),
               rows_of(image, thread));
  });
  if (bands == 1) return;
  parallel_for(pieces.images * pieces.strips, pieces.threads, [&](int64_t item, int) HWY_ATTR {
    for (int64_t band = 1; band < bands;
         ++band)  // in order, because the first of equal values wins
      join_continued(piece_of(item / pieces.strips, item % pieces.strips, band, 0));
  });
}

}  // namespace

}  // namespace revisit::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
