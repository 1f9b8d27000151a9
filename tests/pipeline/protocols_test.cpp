#include "revisit/pipeline/protocols.h"

#include <gtest/gtest.h>

#include <numeric>

#include "revisit/proto/error.h"

namespace revisit::pipeline {
namespace {

Trajectory frames(std::vector<int> numbers) {
  Trajectory trajectory;
  trajectory.frames = std::move(numbers);
  return trajectory;
}

Trajectory consecutive(int n) {
  std::vector<int> numbers(n);
  std::iota(numbers.begin(), numbers.end(), 0);
  return frames(numbers);
}

TEST(Protocols, PaperTasksOfEachSequence) {
  const auto names = [](const std::vector<Task>& tasks) {
    std::string all;
    for (const Task& task : tasks) all += task.name + " ";
    return all;
  };
  EXPECT_EQ(names(make_tasks("paper", "00", consecutive(4541))), "paper-easy paper-median ");
  EXPECT_EQ(names(make_tasks("paper", "08", consecutive(4071))),
            "paper-easy paper-median paper-difficult ");
  EXPECT_EQ(names(make_tasks("paper", "02", consecutive(4661))), "paper-easy ");
}

TEST(Protocols, MedianStoresTable1) {
  // (last - first + 1) summed over the ranges of the paper's table.
  const std::tuple<const char*, int, size_t> table[] = {
      {"00", 4541, 200 + 561}, {"05", 2761, 138 + 356}, {"06", 1101, 276}, {"08", 4071, 84 + 221}};
  for (const auto& [sequence, n, stored] : table) {
    const Task task = make_tasks("paper-median", sequence, consecutive(n)).at(0);
    EXPECT_EQ(task.stored.size(), stored) << sequence;
    EXPECT_EQ(task.queries.size(), n - stored) << sequence;
    EXPECT_FALSE(task.both_cases);
    EXPECT_EQ(task.rule.distance, Distance::kBox);
    EXPECT_EQ(task.rule.radius, 3);
  }
  const Task task = make_tasks("paper-median", "05", consecutive(2761)).at(0);
  EXPECT_EQ(task.stored.front(), 12);  // index 13 counts from 1
  EXPECT_EQ(task.stored[137], 149);
  EXPECT_EQ(task.stored[138], 529);
  EXPECT_EQ(task.stored.back(), 884);
  EXPECT_EQ(task.queries[0].scan, 0);
  EXPECT_EQ(task.queries[0].candidates[0].end, 494);
  EXPECT_EQ(task.queries[0].n_candidates(), 494);
}

TEST(Protocols, DifficultAsksInBothCases) {
  const Task task = make_tasks("paper-difficult", "08", consecutive(4071)).at(0);
  EXPECT_TRUE(task.both_cases);
  EXPECT_EQ(task.stored.size(), 305u);
  EXPECT_THROW(make_tasks("paper-difficult", "00", consecutive(4541)), UsageError);
  EXPECT_THROW(make_tasks("paper-median", "02", consecutive(4541)), UsageError);
}

TEST(Protocols, EasyStoresEveryThirdFrameAlsoWithGaps) {
  const Task task = make_tasks("paper-easy", "", frames({0, 1, 2, 6, 7, 9})).at(0);
  EXPECT_EQ(task.stored, (std::vector<int64_t>{0, 3, 5}));  // rows of frames 0, 6, 9
  ASSERT_EQ(task.queries.size(), 3u);
  EXPECT_EQ(task.queries[2].scan, 4);
}

TEST(Protocols, OnlineGrowsAndSkipsScansWithoutCandidates) {
  const Task task =
      make_tasks("online", "", frames({0, 10, 51, 60, 62}), parse_exclusion("frames=50")).at(0);
  ASSERT_EQ(task.queries.size(), 3u);
  EXPECT_EQ(task.queries[0].scan, 2);  // 51 frames after 0
  EXPECT_EQ(task.queries[0].n_candidates(), 1);
  EXPECT_EQ(task.queries[1].n_candidates(), 1);  // 60 - 10 is not more than 50
  EXPECT_EQ(task.queries[2].n_candidates(), 2);
  EXPECT_EQ(task.rule.distance, Distance::kXz);
}

TEST(Protocols, LeaveOneOutLooksBothWays) {
  const Task task =
      make_tasks("leave-one-out", "", consecutive(5), parse_exclusion("frames=1")).at(0);
  ASSERT_EQ(task.queries.size(), 5u);
  EXPECT_EQ(task.queries[2].candidates[0].end, 1);
  EXPECT_EQ(task.queries[2].candidates[1].begin, 4);
  EXPECT_EQ(task.queries[2].n_candidates(), 2);
  EXPECT_EQ(task.queries[0].n_candidates(), 3);
  EXPECT_EQ(make_tasks("leave-one-out", "", consecutive(5), parse_exclusion("none"))
                .at(0)
                .queries[2]
                .n_candidates(),
            4);
}

TEST(Protocols, SaysWhatIsWrong) {
  EXPECT_THROW(make_tasks("papr", "00", consecutive(10)), UsageError);
  EXPECT_THROW(make_tasks("online", "00", consecutive(10)),
               UsageError);  // nothing beyond 50 frames
  EXPECT_THROW(make_tasks("paper-median", "08", consecutive(10)), UsageError);  // nothing stored
  EXPECT_THROW(make_tasks("paper-easy", "", frames({0, 3})), UsageError);       // nothing asked
  EXPECT_THROW(make_tasks("online", "", {}), UsageError);
}

}  // namespace
}  // namespace revisit::pipeline
