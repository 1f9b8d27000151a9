#include <algorithm>
#include <cmath>

#include "kernels/recurrent.h"

namespace revisit::engine {
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
