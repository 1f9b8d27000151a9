#include "schedule.h"
#include "testing.h"

namespace revisit::engine {
namespace {

bool alive_together(const Lifetime& a, const Lifetime& b) {
  return a.first <= b.last && b.first <= a.last;
}

TEST(MemoryPlan, ChainNeedsTwoBuffers) {
  const MemoryPlan plan = plan_memory({{100, 0, 1}, {100, 1, 2}, {100, 2, 3}}, 1);
  EXPECT_EQ(plan.total, 200);
  EXPECT_EQ(plan.offsets[0], plan.offsets[2]);
  EXPECT_EQ(plan_memory({{0, 0, 1}}, 64).total, 0);
}

TEST(MemoryPlan, AlignsOffsets) {
  const MemoryPlan plan = plan_memory({{5, 0, 1}, {7, 0, 1}, {3, 0, 1}}, 16);
  for (const int64_t offset : plan.offsets) EXPECT_EQ(offset % 16, 0);
  EXPECT_EQ(plan.total, 48);
}

TEST(MemoryPlan, NeverOverlapsLiveBuffers) {
  std::mt19937 random(7);
  double totals = 0, peaks = 0;
  for (int round = 0; round < 201; ++round) {
    std::vector<Lifetime> buffers;
    int64_t peak = 0;  // lower bound of any plan
    const int count = round < 200 ? 20 : 8000, steps = count / 2;
    for (int i = 0; i < count; ++i) {
      const int first = static_cast<int>(random() % steps);
      buffers.push_back(
          {static_cast<int64_t>(random() % 50), first, first + static_cast<int>(random() % 5)});
    }
    for (int step = 0; step < steps + 5; ++step) {
      int64_t alive = 0;
      for (const Lifetime& b : buffers) alive += b.first <= step && step <= b.last ? b.size : 0;
      peak = std::max(peak, alive);
    }
    const MemoryPlan plan = plan_memory(buffers, 1);
    EXPECT_GE(plan.total, peak);
    totals += static_cast<double>(plan.total), peaks += static_cast<double>(peak);
    for (size_t i = 0; i < buffers.size(); ++i)
      for (size_t j = 0; j < i; ++j) {
        if (!alive_together(buffers[i], buffers[j])) continue;
        EXPECT_TRUE(plan.offsets[i] + buffers[i].size <= plan.offsets[j] ||
                    plan.offsets[j] + buffers[j].size <= plan.offsets[i])
            << "round " << round << ": buffers " << i << " and " << j;
      }
  }
  EXPECT_LE(totals, 1.1 * peaks);
}

}  // namespace
}  // namespace revisit::engine
