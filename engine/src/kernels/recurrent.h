#pragma once

#include <cstdint>

namespace revisit::engine {

/// A recurrent layer over `steps` time steps of `streams` independent sequences: input
/// `[steps][streams][input]`, output `[steps][streams][output]`. The state of stream n before step
/// t is multiplied by `cont[t][n]`; 0 starts a new sequence.
struct RecurrentProblem {
  int64_t steps = 1, streams = 1, input = 1, output = 1;
  int64_t static_input = 0;  // floats per stream of a time-constant input; 0: none
  int threads = 1;
};

/// Hidden state `h` and, for LSTM, cell `c`, each `[streams][output]`. On entry the state before
/// the first step, on return that after the last.
struct RecurrentState {
  float* h;
  float* c;
};

/// Arrays of one forward pass; `x_static` is null without a static input.
struct RecurrentOperands {
  const float *x, *cont, *x_static;
  float* y;
  RecurrentState state;
  float* scratch;
};

/// gates = W_hc (cont h) + W_xc x + b_c + W_static x_static, in four blocks i, f, o, g;
/// c = cont sigmoid(f) c + sigmoid(i) tanh(g);  h = y = sigmoid(o) tanh(c)
struct LstmWeights {
  const float *xc, *b_c, *x_static, *hc;
};
void lstm(const RecurrentProblem& problem, const LstmWeights& weights,
          const RecurrentOperands& operands);
int64_t lstm_scratch_floats(const RecurrentProblem& problem);
/// Computes the equations in double precision, without scratch.
void lstm_reference(const RecurrentProblem& problem, const LstmWeights& weights,
                    const RecurrentOperands& operands);

/// h = tanh(W_hh (cont h) + W_xh x + b_h + W_static x_static);  y = tanh(W_ho h + b_o)
struct RnnWeights {
  const float *xh, *b_h, *x_static, *hh, *ho, *b_o;
};
void rnn(const RecurrentProblem& problem, const RnnWeights& weights,
         const RecurrentOperands& operands);
int64_t rnn_scratch_floats(const RecurrentProblem& problem);
void rnn_reference(const RecurrentProblem& problem, const RnnWeights& weights,
                   const RecurrentOperands& operands);

}  // namespace revisit::engine
