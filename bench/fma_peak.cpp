// Maximum multiply-adds of this CPU on 1 to N threads, as JSON:
//   revisit_fma_peak 2
#include <algorithm>
#include <cstdio>
#include <string>

#include "revisit/engine/machine.h"
#include "revisit/profiling/profile.h"

int main(int argc, char** argv) {
  constexpr int kRepeat = 5;
  const int most = argc > 1 ? std::stoi(argv[1]) : 1;
  std::printf("{\"instructions\": \"%s\", \"gflops\": {", revisit::engine::simd_target().c_str());
  for (int threads = 1; threads <= most; ++threads) {
    double best = 0;
    for (int i = 0; i < kRepeat; ++i)
      best = std::max(best, revisit::profiling::measure_speed_limits(threads).float32_gflops);
    std::printf("%s\"%d\": %.1f", threads > 1 ? ", " : "", threads, best);
  }
  std::printf("}}\n");
}
