#if defined(REVISIT_FUNCTIONS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef REVISIT_FUNCTIONS_INL_H_
#undef REVISIT_FUNCTIONS_INL_H_
#else
#define REVISIT_FUNCTIONS_INL_H_
#endif

#include <hwy/contrib/math/math-inl.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace revisit::engine::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

/// Propagates NaN, because Highway's functions do not.
template <class V>
HWY_INLINE V keep_nan(V x, V result) {
  return hn::IfThenElse(hn::Eq(x, x), result, x);
}

/// e^-|x|, which cannot overflow.
template <class D, class V>
HWY_INLINE V exp_down(D d, V x) {
  return hn::Exp(d, hn::Or(x, hn::SignBit(d)));
}

template <class D, class V>
HWY_INLINE V sigmoid(D d, V x) {
  const V one = hn::Set(d, 1.0F), e = exp_down(d, x);
  const V upper = hn::IfThenElse(hn::Lt(x, hn::Zero(d)), e, one);
  return keep_nan(x, hn::Div(upper, hn::Add(one, e)));
}

template <class D, class V>
HWY_INLINE V tanh(D d, V x) {
  return keep_nan(x, hn::Tanh(d, x));
}

template <class D, class V>
HWY_INLINE V softplus(D d, V x) {
  return keep_nan(x, hn::Add(hn::Max(x, hn::Zero(d)), hn::Log1p(d, exp_down(d, x))));
}

}  // namespace revisit::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
