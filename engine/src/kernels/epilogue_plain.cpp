#include "kernels/epilogue_plain.h"

#include <algorithm>
#include <cmath>

namespace revisit::engine {
namespace {

/// Caffe's own expressions, as in the layers of these names.
template <class Function>
void apply(const Function& function, int64_t begin, int64_t end, float* values) {
  for (int64_t i = begin; i < end; ++i) values[i] = function(values[i]);
}

void activate(const Epilogue& e, int64_t channel, int64_t begin, int64_t end, float* values) {
  const auto leaky = [&](float slope) {
    apply([slope](float x) { return std::max(x, 0.0F) + slope * std::min(x, 0.0F); }, begin, end,
          values);
  };
  switch (e.activation) {
    case Epilogue::Activation::kNone:
      return;
    case Epilogue::Activation::kRelu:
      return leaky(e.slope);
    case Epilogue::Activation::kPrelu:
      return leaky(e.slopes[channel]);
    case Epilogue::Activation::kElu:
      return apply(
          [alpha = e.slope](float x) {
            return std::max(x, 0.0F) + alpha * (std::exp(std::min(x, 0.0F)) - 1);
          },
          begin, end, values);
    case Epilogue::Activation::kClip:
      return apply([&](float x) { return std::min(std::max(x, e.low), e.high); }, begin, end,
                   values);
  }
}

}  // namespace

void finish(const ChannelRuns& runs, const PlainEpilogue& e, int threads, float* values) {
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
