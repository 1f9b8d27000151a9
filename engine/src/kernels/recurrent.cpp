#include <algorithm>
#include <cmath>

#include "kernels/epilogue.h"
#include "kernels/nchw.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/recurrent.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h.
#include "kernels/blocked/epilogue-inl.h"

HWY_BEFORE_NAMESPACE();
namespace revisit::engine::HWY_NAMESPACE {

/// Updates one vector of units; the sums of successive gates are `step` apart.
HWY_INLINE void update(float cont, const float* gates, int64_t step, float* c, float* h) {
  const Tag d;
  const Vector in = sigmoid(d, hn::LoadU(d, gates));
  const Vector out = sigmoid(d, hn::LoadU(d, gates + 2 * step));
  const Vector taken = hn::Mul(in, tanh(d, hn::LoadU(d, gates + 3 * step)));
  const Vector kept =
      cont == 0 ? hn::Zero(d) : hn::Mul(hn::Set(d, cont), sigmoid(d, hn::LoadU(d, gates + step)));
  const Vector state = hn::MulAdd(kept, hn::LoadU(d, c), taken);
  hn::StoreU(state, d, c);
  hn::StoreU(hn::Mul(out, tanh(d, state)), d, h);
}

/// Takes the sums of gates i, f, o, g. Ignores the old cell if `cont` is 0, whatever the gate is.
void lstm_cell(int64_t width, float cont, const float* gates, float* c, float* h) {
  const int64_t whole = width / kVectorLanes * kVectorLanes, rest = width - whole;
  for (int64_t i = 0; i < whole; i += kVectorLanes) update(cont, gates + i, width, c + i, h + i);
  if (rest == 0) return;
  float last_gates[4 * kVectorLanes] = {}, last_c[kVectorLanes] = {}, last_h[kVectorLanes];
  for (int64_t gate = 0; gate < 4; ++gate)
    std::copy_n(gates + gate * width + whole, rest, last_gates + gate * kVectorLanes);
  std::copy_n(c + whole, rest, last_c);
  update(cont, last_gates, kVectorLanes, last_c, last_h);
  std::copy_n(last_c, rest, c + whole);
  std::copy_n(last_h, rest, h + whole);
}

}  // namespace revisit::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace revisit::engine {

HWY_EXPORT(lstm_cell);

namespace {

void apply_tanh(int64_t count, const float* in, float* out) {
  activate({.activation = Epilogue::Activation::kTanh}, count, in, out);
}

/// Sums of each step before its nonlinearity, `width` numbers per stream.
class StepInput {
 public:
  static int64_t scratch_floats(const RecurrentProblem& p, int64_t width) {
    return p.streams * (p.output + width * (p.steps + 1 + (p.static_input > 0 ? 1 : 0)));
  }

  StepInput(const RecurrentProblem& p, int64_t width, const RecurrentOperands& o, const float* w_x,
            const float* bias, const float* w_static, const float* w_h)
      : p_(p),
        width_(width),
        cont_(o.cont),
        w_h_(w_h),
        from_x_(o.scratch),
        sum_(from_x_ + p.steps * p.streams * width),
        continued_(sum_ + p.streams * width),
        from_static_(p.static_input > 0 ? continued_ + p.streams * p.output : nullptr) {
    multiply(p.steps * p.streams, p.input, o.x, w_x, bias, from_x_);
    if (from_static_)
      multiply(p.streams, p.static_input, o.x_static, w_static, nullptr, from_static_);
  }

  const float* at(int64_t t, const float* h) {
    for (int64_t n = 0; n < p_.streams; ++n)
      for (int64_t d = 0; d < p_.output; ++d)
        continued_[n * p_.output + d] = h[n * p_.output + d] * cont_[t * p_.streams + n];
    multiply(p_.streams, p_.output, continued_, w_h_, nullptr, sum_);
    const float* from_x = from_x_ + t * p_.streams * width_;
    for (int64_t i = 0; i < p_.streams * width_; ++i) {
      sum_[i] += from_x[i];
      if (from_static_) sum_[i] += from_static_[i];
    }
    return sum_;
  }

 private:
  void multiply(int64_t rows, int64_t depth, const float* in, const float* weights,
                const float* bias, float* out) const {
    inner_product({rows, width_, depth, false, p_.threads}, in, weights, bias, out);
  }

  const RecurrentProblem& p_;
  int64_t width_;
  const float *cont_, *w_h_;
  float *from_x_, *sum_, *continued_, *from_static_;
};

}  // namespace

int64_t lstm_scratch_floats(const RecurrentProblem& p) {
  return StepInput::scratch_floats(p, 4 * p.output);
}

void lstm(const RecurrentProblem& p, const LstmWeights& w, const RecurrentOperands& o) {
  const int64_t width = p.output;
  StepInput input(p, 4 * width, o, w.xc, w.b_c, w.x_static, w.hc);
  auto& cell = HWY_DYNAMIC_DISPATCH(lstm_cell);
  for (int64_t t = 0; t < p.steps; ++t) {
    const float* gates = input.at(t, o.state.h);
    for (int64_t n = 0; n < p.streams; ++n, gates += 4 * width)
      cell(width, o.cont[t * p.streams + n], gates, o.state.c + n * width, o.state.h + n * width);
    std::copy_n(o.state.h, p.streams * width, o.y + t * p.streams * width);
  }
}

int64_t rnn_scratch_floats(const RecurrentProblem& p) {
  return StepInput::scratch_floats(p, p.output);
}

void rnn(const RecurrentProblem& p, const RnnWeights& w, const RecurrentOperands& o) {
  const int64_t floats = p.streams * p.output;
  StepInput input(p, p.output, o, w.xh, w.b_h, w.x_static, w.hh);
  for (int64_t t = 0; t < p.steps; ++t) {
    const float* sum = input.at(t, o.state.h);
    apply_tanh(floats, sum, o.state.h);
    float* y = o.y + t * floats;
    inner_product({p.streams, p.output, p.output, false, p.threads}, o.state.h, w.ho, w.b_o, y);
    apply_tanh(floats, y, y);
  }
}

namespace {

double sigmoid_of(double x) {
  return 1 / (1 + std::exp(-x));
}

double dot(const float* a, const float* b, int64_t count) {
  double sum = 0;
  for (int64_t i = 0; i < count; ++i) sum += static_cast<double>(a[i]) * b[i];
  return sum;
}

struct StepSum {
  const RecurrentProblem& p;
  const RecurrentOperands& o;
  const float *w_x, *bias, *w_static, *w_h;

  double operator()(int64_t t, int64_t n, int64_t row) const {
    const int64_t at = t * p.streams + n, fixed = p.static_input;
    double sum = bias[row] + dot(w_x + row * p.input, o.x + at * p.input, p.input);
    if (fixed > 0) sum += dot(w_static + row * fixed, o.x_static + n * fixed, fixed);
    return sum + o.cont[at] * dot(w_h + row * p.output, o.state.h + n * p.output, p.output);
  }
};

template <class Step>
void for_each_step(const RecurrentProblem& p, const RecurrentOperands& o, const Step& step) {
  for (int64_t t = 0; t < p.steps; ++t)
    for (int64_t n = 0; n < p.streams; ++n) step(t, n, o.y + (t * p.streams + n) * p.output);
}

}  // namespace

void lstm_reference(const RecurrentProblem& p, const LstmWeights& w, const RecurrentOperands& o) {
  const StepSum sum{p, o, w.xc, w.b_c, w.x_static, w.hc};
  for_each_step(p, o, [&](int64_t t, int64_t n, float* y) {
    for (int64_t d = 0; d < p.output; ++d) {
      const auto gate = [&](int64_t i) { return sum(t, n, i * p.output + d); };
      float& c = o.state.c[n * p.output + d];
      const float cont = o.cont[t * p.streams + n];
      const double kept = cont == 0 ? 0 : cont * sigmoid_of(gate(1));
      c = static_cast<float>(kept * c + sigmoid_of(gate(0)) * std::tanh(gate(3)));
      y[d] = static_cast<float>(sigmoid_of(gate(2)) * std::tanh(static_cast<double>(c)));
    }
    std::copy_n(y, p.output, o.state.h + n * p.output);
  });
}

void rnn_reference(const RecurrentProblem& p, const RnnWeights& w, const RecurrentOperands& o) {
  const StepSum sum{p, o, w.xh, w.b_h, w.x_static, w.hh};
  for_each_step(p, o, [&](int64_t t, int64_t n, float* y) {
    float* const h = o.state.h + n * p.output;
    for (int64_t d = 0; d < p.output; ++d) y[d] = static_cast<float>(std::tanh(sum(t, n, d)));
    std::copy_n(y, p.output, h);
    for (int64_t d = 0; d < p.output; ++d)
      y[d] = static_cast<float>(std::tanh(w.b_o[d] + dot(w.ho + d * p.output, h, p.output)));
  });
}

}  // namespace revisit::engine
#endif
