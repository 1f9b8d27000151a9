#include <dlfcn.h>
#include <pthread.h>
#include <unistd.h>

#include <csignal>
#include <thread>

#include "revisit/engine/parallel_for.h"

#ifdef REVISIT_HAVE_TBB
#include <oneapi/tbb/parallel_for.h>
#endif

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

/// Returns the first item of each thread, or -1 if the second thread did not come within a second.
std::array<int64_t, 2> first_items(int64_t items) {
  std::array<std::atomic<int64_t>, 2> first = {-1, -1};
  parallel_for(items, 2, [&](int64_t item, int thread) {
    int64_t none = -1;
    first[thread].compare_exchange_strong(none, item);
    for (int i = 0; i < 1000 && first[1 - thread] < 0; ++i) ::usleep(1000);
  });
  return {first[0], first[1]};
}

TEST(ParallelFor, BeginsWithTheSamePartOfEveryRegion) {
  for (const int64_t items : {2, 7, 100})
    EXPECT_EQ(first_items(items), (std::array<int64_t, 2>{0, items / 2}));
}

std::atomic<bool> is_halted = false, may_go_on = false;

/// A thread that is in a signal handler is like one that is not scheduled.
TEST(ParallelFor, DoesNotWaitForThreadsThatHaveNotBegun) {
  std::atomic<pthread_t> helper = {};
  parallel_for(2, 2, [&](int64_t, int thread) {
    if (thread == 1) helper = ::pthread_self();
    for (int i = 0; i < 1000 && helper == pthread_t{}; ++i) ::usleep(1000);
  });
  ASSERT_NE(helper, pthread_t{});
  ::signal(SIGUSR1, [](int) {
    is_halted = true;
    while (!may_go_on) ::usleep(100);
  });
  ASSERT_EQ(::pthread_kill(helper, SIGUSR1), 0);
  while (!is_halted) ::usleep(100);
  std::atomic<int> done = 0;
  for (int region = 0; region < 100; ++region)
    parallel_for(10, 2, [&](int64_t, int thread) { done += thread == 0 ? 1 : 0; });
  EXPECT_EQ(done, 1000);
  may_go_on = true;
  EXPECT_EQ(first_items(2)[1], 1);
  ::signal(SIGUSR1, SIG_DFL);
}

/// Sum of the items of regions within a region.
int64_t nested_sum() {
  std::atomic<int64_t> sum = 0;
  parallel_for(10, 2, [&](int64_t outer) {
    parallel_for(10, 3, [&](int64_t inner) { sum += 10 * outer + inner; });
  });
  return sum;
}

TEST(ParallelFor, WorksInThreadsOfAnyKind) {
  constexpr int64_t kSum = 99 * 50;
  constexpr int kCallers = 4;
  std::atomic<int> good = 0;
  const auto call = [&] {
    for (int i = 0; i < 50; ++i) good += nested_sum() == kSum ? 1 : 0;
  };
  {
    std::vector<std::jthread> callers;
    for (int i = 0; i < kCallers; ++i) callers.emplace_back(call);
  }
  EXPECT_EQ(good, 50 * kCallers);
#pragma omp parallel for num_threads(kCallers)
  for (int i = 0; i < kCallers; ++i) call();
  EXPECT_EQ(good, 100 * kCallers);
#ifdef REVISIT_HAVE_TBB
  tbb::parallel_for(0, kCallers, [&](int) { call(); });
  EXPECT_EQ(good, 150 * kCallers);
#endif
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

/// A forked child has none of its parent's threads. It must not wait for them, and can create its
/// own.
TEST(Forked, RegionsWorkInParentAndChild) {
  const std::array<int64_t, 2> both = {0, 2};
  for (int round = 0; round < 3; ++round) {
    EXPECT_EQ(first_items(4), both);
    EXPECT_EXIT(
        {
          ::alarm(10);
          std::exit(first_items(4) == both ? 2 : 1);  // ends the threads of the child
        },
        testing::ExitedWithCode(2), "");
  }
  EXPECT_EQ(first_items(4), both);
}

/// The threads of a thread that has used it must not outlive a library's code.
TEST(Unloaded, ALibraryWithTheEngineLeavesNoThreads) {
  for (int round = 0; round < 3; ++round) {
    std::jthread([] {
      void* const library = ::dlopen(REVISIT_UNLOADED, RTLD_NOW | RTLD_LOCAL);
      ASSERT_TRUE(library) << ::dlerror();
      const auto sum = reinterpret_cast<int64_t (*)()>(::dlsym(library, "sum_on_two_threads"));
      ASSERT_TRUE(sum);
      EXPECT_EQ(sum(), 4950);
      ::dlclose(library);
    });
    EXPECT_EQ(first_items(2)[0], 0);
  }
}

}  // namespace
}  // namespace revisit::engine
