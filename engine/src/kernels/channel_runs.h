#pragma once

#include "revisit/engine/parallel_for.h"

namespace revisit::engine {

struct ChannelRuns {
  int64_t outer = 1, channels = 1, inner = 1;
  int64_t elements() const { return outer * channels * inner; }
};

/// Calls `work(channel, begin, end)` for parts of runs that together cover all elements.
template <class Work>
void for_each_run(const ChannelRuns& runs, int threads, const Work& work) {
  parallel_ranges(runs.elements(), kParallelGrain, threads, [&](int64_t begin, int64_t end) {
    int64_t channel = begin / runs.inner % runs.channels;
    int64_t run_end = (begin / runs.inner + 1) * runs.inner;
    while (begin < end) {
      const int64_t stop = std::min(run_end, end);
      work(channel, begin, stop);
      begin = stop;
      run_end += runs.inner;
      if (++channel == runs.channels) channel = 0;
    }
  });
}

}  // namespace revisit::engine
