#if defined(REVISIT_TRANSPOSE_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef REVISIT_TRANSPOSE_INL_H_
#undef REVISIT_TRANSPOSE_INL_H_
#else
#define REVISIT_TRANSPOSE_INL_H_
#endif

#include <hwy/highway.h>

#include <cstdint>

HWY_BEFORE_NAMESPACE();
namespace revisit::engine::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

constexpr int64_t kSquareSide = 4;

/// to[column][row] = from[row][column] for a square; steps are row strides.
HWY_INLINE void transpose_square(const float* from, int64_t from_step, float* to, int64_t to_step) {
#if HWY_TARGET == HWY_SCALAR
  for (int64_t j = 0; j < kSquareSide; ++j)
    for (int64_t i = 0; i < kSquareSide; ++i) to[j * to_step + i] = from[i * from_step + j];
#else
  const hn::FixedTag<float, kSquareSide> d;
  const hn::RepartitionToWide<decltype(d)> pairs;
  const auto row0 = hn::LoadU(d, from), row1 = hn::LoadU(d, from + from_step);
  const auto row2 = hn::LoadU(d, from + 2 * from_step), row3 = hn::LoadU(d, from + 3 * from_step);
  const auto low01 = hn::BitCast(pairs, hn::InterleaveLower(d, row0, row1));
  const auto low23 = hn::BitCast(pairs, hn::InterleaveLower(d, row2, row3));
  const auto high01 = hn::BitCast(pairs, hn::InterleaveUpper(d, row0, row1));
  const auto high23 = hn::BitCast(pairs, hn::InterleaveUpper(d, row2, row3));
  hn::StoreU(hn::BitCast(d, hn::InterleaveLower(pairs, low01, low23)), d, to);
  hn::StoreU(hn::BitCast(d, hn::InterleaveUpper(pairs, low01, low23)), d, to + to_step);
  hn::StoreU(hn::BitCast(d, hn::InterleaveLower(pairs, high01, high23)), d, to + 2 * to_step);
  hn::StoreU(hn::BitCast(d, hn::InterleaveUpper(pairs, high01, high23)), d, to + 3 * to_step);
#endif
}

inline void transpose(int64_t rows, int64_t columns, const float* from, int64_t from_step,
                      float* to, int64_t to_step) {
  const int64_t whole_rows = rows / kSquareSide * kSquareSide,
                whole_columns = columns / kSquareSide * kSquareSide;
  for (int64_t j = 0; j < whole_columns; j += kSquareSide)
    for (int64_t i = 0; i < whole_rows; i += kSquareSide)
      transpose_square(from + i * from_step + j, from_step, to + j * to_step + i, to_step);
  for (int64_t j = 0; j < columns; ++j)
    for (int64_t i = j < whole_columns ? whole_rows : 0; i < rows; ++i)
      to[j * to_step + i] = from[i * from_step + j];
}

}  // namespace revisit::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
#endif
