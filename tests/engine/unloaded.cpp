// A library that the test of parallel_for loads and unloads.
#include <atomic>

#include "revisit/engine/parallel_for.h"

extern "C" int64_t sum_on_two_threads() {
  std::atomic<int64_t> sum = 0;
  revisit::parallel_for(100, 2, [&](int64_t item) { sum += item; });
  return sum;
}
