// Which items of a parallel region are done, and where a thread begins.
#include "kernels/parallel.h"

#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <thread>
#include <vector>

namespace revisit::engine {
namespace {

TEST(KernelThreads, DoEachItemOnceHoweverManyTheyAre) {
  for (const int threads : {1, 2, 3, 8, 70})
    for (const int64_t items : {0, 1, 2, 5, 63, 64, 65, 1000}) {
      std::vector<std::atomic<int>> done(items);
      std::atomic<int> strangers = 0;
      parallel_for(items, threads, [&](int64_t item, int thread) {
        ++done[item];
        if (thread < 0 || thread >= threads) ++strangers;
      });
      for (int64_t i = 0; i < items; ++i)
        EXPECT_EQ(done[i], 1) << "item " << i << " of " << items << ", threads: " << threads;
      EXPECT_EQ(strangers, 0);
    }
}

TEST(KernelThreads, BeginWithTheSamePartOfEveryRegion) {
  constexpr int kThreads = 2;
  for (const int64_t items : {2, 7, 100}) {
    std::array<std::atomic<int64_t>, kThreads> first = {-1, -1};
    std::atomic<int> begun = 0;
    parallel_for(items, kThreads, [&](int64_t item, int thread) {
      if (first[thread] >= 0) return;
      first[thread] = item;
      ++begun;
      while (begun < omp_get_num_threads()) std::this_thread::yield();  // or one would do all
    });
    EXPECT_EQ(first[0], 0);
    EXPECT_EQ(first[1], items / 2);
  }
}

}  // namespace
}  // namespace revisit::engine
