#include "describe/in_order.h"

#include "testing.h"

namespace revisit {
namespace {

void pause_for(int64_t microseconds) {
  std::this_thread::sleep_for(std::chrono::microseconds(microseconds));
}

TEST(InOrder, ResultsAreTakenInOrderOfTheirItems) {
  for (const int threads : {1, 2, 5}) {
    std::vector<int64_t> slots(static_cast<size_t>(threads) * 2), taken;
    std::atomic<int64_t> begun = 0;
    in_order(
        3, 200, threads, slots,
        [&](int64_t i, int thread, int64_t& slot) {
          EXPECT_TRUE(thread >= 0 && thread < threads);
          ++begun;
          pause_for(i * 7919 % 97);
          slot = i * i;
        },
        [&](int64_t i, int64_t& slot) {
          EXPECT_EQ(slot, i * i);
          EXPECT_LE(begun, i - 3 + static_cast<int64_t>(slots.size())) << "more than fits is begun";
          taken.push_back(i);
        });
    ASSERT_EQ(taken.size(), 197U);
    for (size_t k = 0; k < taken.size(); ++k) EXPECT_EQ(taken[k], static_cast<int64_t>(k) + 3);
  }
}

TEST(InOrder, NothingToDo) {
  std::vector<int> slots(2);
  const auto never = [](auto&&...) { FAIL(); };
  in_order(5, 5, 2, slots, never, never);
}

TEST(InOrder, WorkersWorkAtTheSameTime) {
  std::vector<int> slots(4);
  std::atomic<int> together = 0;
  in_order(
      0, 2, 2, slots,
      [&](int64_t, int, int&) {
        ++together;
        for (int i = 0; together < 2 && i < 100000; ++i) pause_for(100);
        EXPECT_EQ(together, 2);
      },
      [](int64_t, int&) {});
}

TEST(InOrder, AnErrorComesInItsTurn) {
  for (const int threads : {1, 3}) {
    std::vector<int> slots(6);
    int64_t taken = 0;
    std::string what;
    try {
      in_order(
          0, 50, threads, slots,
          [](int64_t i, int, int&) {
            if (i == 20) pause_for(2000);  // 21 is ready first
            if (i >= 20) throw std::runtime_error(std::to_string(i));
          },
          [&](int64_t, int&) { ++taken; });
    } catch (const std::runtime_error& error) {
      what = error.what();
    }
    EXPECT_EQ(what, "20");
    EXPECT_EQ(taken, 20);
  }
}

TEST(InOrder, TheTakersErrorStopsTheWorkers) {
  std::vector<int> slots(4);
  std::atomic<int> made = 0;
  EXPECT_THROW(in_order(
                   0, 1000, 2, slots, [&](int64_t, int, int&) { ++made; },
                   [](int64_t i, int&) {
                     if (i == 3) throw std::runtime_error("full");
                   }),
               std::runtime_error);
  const int after = made;
  EXPECT_LE(after, 3 + 4 + 1);
  pause_for(3000);
  EXPECT_EQ(made, after) << "a worker is still there";
}

}  // namespace
}  // namespace revisit
