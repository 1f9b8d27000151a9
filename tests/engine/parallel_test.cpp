#include <omp.h>
#include <unistd.h>

#include "revisit/engine/parallel_for.h"
#include "testing.h"

namespace revisit::engine {
namespace {

TEST(ParallelFor, DoesEachItemOnceHoweverManyThreadsThereAre) {
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

TEST(ParallelFor, RangesCoverAllItems) {
  for (const int threads : {1, 4})
    for (const int64_t items : {0, 1, 7, 1000}) {
      std::vector<std::atomic<int>> done(items);
      parallel_ranges(items, 7, threads, [&](int64_t begin, int64_t end) {
        EXPECT_LE(end - begin, 7);
        for (int64_t i = begin; i < end; ++i) ++done[i];
      });
      for (const std::atomic<int>& times : done) EXPECT_EQ(times, 1);
    }
}

TEST(ParallelFor, BeginsWithTheSamePartOfEveryRegion) {
  constexpr int kThreads = 2;
  for (const int64_t items : {2, 7, 100}) {
    std::array<std::atomic<int64_t>, kThreads> first = {-1, -1};
    std::atomic<int> begun = 0;
    parallel_for(items, kThreads, [&](int64_t item, int thread) {
      if (first[thread] >= 0) return;
      first[thread] = item;
      ++begun;
      while (begun < omp_get_num_threads()) std::this_thread::yield();  // else one could do all
    });
    EXPECT_EQ(first[0], 0);
    EXPECT_EQ(first[1], items / 2);
  }
}

TEST(ParallelFor, TheErrorOfTheLowestItemComesOut) {
  for (const int threads : {1, 2, 5}) {
    std::atomic<int> done = 0;
    try {
      parallel_for(1000, threads, [&](int64_t item) {
        ++done;
        if (item == 340 || item == 500) throw std::out_of_range(std::to_string(item));
        ::usleep(10);
      });
      FAIL() << "nothing came out";
    } catch (const std::out_of_range& error) {
      EXPECT_STREQ(error.what(), "340");
    }
    EXPECT_LT(done, 1000);
  }
}

/// Does not wait for a missing second thread.
int threads_that_meet() {
  std::array<std::atomic<bool>, 4> here = {};
  std::atomic<int> met = 0;
  parallel_for(4, 2, [&](int64_t, int thread) {
    if (!here[thread].exchange(true)) ++met;
    for (int i = 0; i < 1000 && met < 2; ++i) ::usleep(1000);
  });
  return met;
}

/// A forked child has none of its parent's threads. It must not wait for them, and can create its
/// own.
TEST(Forked, RegionsWorkInParentAndChild) {
  EXPECT_EQ(threads_that_meet(), 2);
  EXPECT_EXIT(
      {
        ::alarm(10);
        ::_exit(threads_that_meet());
      },
      testing::ExitedWithCode(2), "");
  EXPECT_EQ(threads_that_meet(), 2);
}

}  // namespace
}  // namespace revisit::engine
