#include "kernels/post_ops.h"

namespace revisit::engine {
namespace {

template <class Function>
void apply_to_each(const Function& function, int64_t begin, int64_t end, float* values) {
  for (int64_t i = begin; i < end; ++i) values[i] = function(values[i]);
}

void activate(const Epilogue& e, int64_t channel, int64_t begin, int64_t end, float* values) {
  const auto leaky = [&](float slope) {
    apply_to_each([slope](float x) { return leaky_relu(x, slope); }, begin, end, values);
  };
  switch (e.activation) {
    case Epilogue::Activation::kNone:
      return;
    case Epilogue::Activation::kRelu:
      return leaky(e.slope);
    case Epilogue::Activation::kPrelu:
      return leaky(e.slopes[channel]);
    case Epilogue::Activation::kElu:
      return apply_to_each([alpha = e.slope](float x) { return elu(x, alpha); }, begin, end,
                           values);
    case Epilogue::Activation::kClip:
      return apply_to_each([&](float x) { return clipped(x, e.low, e.high); }, begin, end, values);
  }
}

}  // namespace

void apply(const PostOps& e, const ChannelRuns& runs, int threads, float* values) {
  if (!e.scale && !e.addend && e.epilogue.activation == Epilogue::Activation::kNone) return;
  for_each_run(runs, threads, [&](int64_t channel, int64_t begin, int64_t end) {
    if (e.scale)
      for (int64_t i = begin; i < end; ++i)
        values[i] = values[i] * e.scale[channel] + e.shift[channel];
    if (e.addend)
      for (int64_t i = begin; i < end; ++i) values[i] += e.addend[i];
    activate(e.epilogue, channel, begin, end, values);
  });
}

}  // namespace revisit::engine
