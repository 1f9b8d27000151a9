#include "kernels/post_ops.h"

#include "kernels/activation.h"

namespace revisit::engine {
namespace {

/// On a run of one channel.
Epilogue of_channel(Epilogue e, int64_t channel) {
  if (e.activation != Epilogue::Activation::kPrelu) return e;
  return {.activation = Epilogue::Activation::kRelu, .slope = e.slopes[channel]};
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
    activate(of_channel(e.epilogue, channel), end - begin, values + begin, values + begin);
  });
}

}  // namespace revisit::engine
