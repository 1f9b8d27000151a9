// Points are in pairs +p, -p, whose common terms are computed once. Included once per target.
#if defined(REVISIT_WINOGRAD_LINES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef REVISIT_WINOGRAD_LINES_INL_H_
#undef REVISIT_WINOGRAD_LINES_INL_H_
#else
#define REVISIT_WINOGRAD_LINES_INL_H_
#endif

#include "kernels/blocked/block-inl.h"
#include "kernels/blocked/winograd_transform.h"

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

}  // namespace revisit::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
