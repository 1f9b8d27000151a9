#include <algorithm>

#include "layers/layers.h"

namespace revisit::engine {
namespace {

/// Sequence indicators [steps][sequences]: 0 at the first step, 1 after it. Without batch_size, an
/// axis of the input has the sequences.
class ContinuationIndicator : public Layer {
 public:
  explicit ContinuationIndicator(const caffe::ContinuationIndicatorParameter& param)
      : param_(param) {}

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    const bool by_axis = param_.batch_size() == 0 && inputs.size() == 1;
    if (param_.time_step() == 0 || (param_.batch_size() == 0 && !by_axis))
      throw InputError("time_step and batch_size must be given and at least 1");
    expect_count(inputs.size(), by_axis ? 1 : 0, "inputs");
    expect_count(n_outputs, 1, "outputs");
    const auto axis = [&] { return inputs[0].canonical_axis(param_.axis(), "axis"); };
    return {Shape{param_.time_step(), by_axis ? inputs[0][axis()] : param_.batch_size()}};
  }

  Kernel bind(const Binding& binding) const override {
    return {"fill", [shape = binding.outputs[0]](const Call& call) {
              std::fill_n(call.outputs[0], shape[1], 0.0F);
              std::fill_n(call.outputs[0] + shape[1], (shape[0] - 1) * shape[1], 1.0F);
            }};
  }

 private:
  caffe::ContinuationIndicatorParameter param_;
};

struct Decoding {
  int64_t steps, sequences, classes, blank;
  bool merges;
};

/// Writes the labels `[steps][sequences]`, -1 after the last, and the negated sums of the best
/// probabilities (may be null). A sequence ends before the first later step whose indicator is 0.
void decode_greedily(const Decoding& d, const float* probabilities, const float* indicators,
                     float* labels, float* scores) {
  std::fill_n(labels, d.steps * d.sequences, -1.0F);
  for (int64_t n = 0; n < d.sequences; ++n) {
    float score = 0;
    for (int64_t t = 0, before = -1, n_labels = 0; t < d.steps; ++t) {
      if (t > 0 && indicators && indicators[t * d.sequences + n] == 0) break;
      const float* p = probabilities + (t * d.sequences + n) * d.classes;
      const int64_t best = std::max_element(p, p + d.classes) - p;
      score -= p[best];
      if (best != d.blank && !(d.merges && best == before))
        labels[n_labels++ * d.sequences + n] = static_cast<float>(best);
      before = best;
    }
    if (scores) scores[n] = score;
  }
}

/// The most probable labels of sequences, without blanks and repetitions (Graves et al. 2006).
class CtcGreedyDecoder : public Layer {
 public:
  explicit CtcGreedyDecoder(const caffe::CTCDecoderParameter& param) : param_(param) {}

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    expect_1_or_2(inputs.size(), "inputs (probabilities, sequence indicators)");
    expect_1_or_2(n_outputs, "outputs (labels, scores)");
    const Shape& p = inputs[0];
    if (p.rank() < 3 || p.product(3, p.rank()) != 1)
      throw InputError("expected probabilities of shape steps x sequences x classes, found ", p);
    if (inputs.size() > 1 && inputs[1].elements() != p[0] * p[1])
      throw InputError("expected sequence indicators of shape ", p[0], " x ", p[1], ", found ",
                       inputs[1]);
    if (param_.blank_index() >= p[2])
      throw InputError("blank_index ", param_.blank_index(), " is not one of ", p[2], " classes");
    std::vector<Shape> outputs{Shape{p[0], p[1], 1, 1}};
    if (n_outputs > 1) outputs.push_back(Shape{p[1], 1, 1, 1});
    return outputs;
  }

  Kernel bind(const Binding& binding) const override {
    const Shape& p = binding.inputs[0];
    const Decoding decoding{p[0], p[1], p[2],
                            param_.blank_index() < 0 ? p[2] - 1 : param_.blank_index(),
                            param_.ctc_merge_repeated()};
    return {"decode", [decoding](const Call& call) {
              decode_greedily(decoding, call.inputs[0],
                              call.inputs.size() > 1 ? call.inputs[1] : nullptr, call.outputs[0],
                              call.outputs.size() > 1 ? call.outputs[1] : nullptr);
            }};
  }

 private:
  caffe::CTCDecoderParameter param_;
};

}  // namespace

constinit const LayerEntries kSequencesLayers = {
    {"ContinuationIndicator",
     make<ContinuationIndicator, &Parameters::continuation_indicator_param>, "CRNN",
     "0 for the first time step, then 1"},
    {"CTCGreedyDecoder", make<CtcGreedyDecoder, &Parameters::ctc_decoder_param>, "Caffe OCR",
     "the most probable labels of sequences"},
};

}  // namespace revisit::engine
