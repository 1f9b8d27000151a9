#include "revisit/evaluation/protocols.h"

#include "revisit/evaluation/descriptors.h"
#include "revisit/evaluation/precision_recall.h"
#include "testing.h"
#include "trajectory.h"

namespace revisit {
namespace {

Trajectory at_frames(std::vector<int> numbers) {
  Trajectory trajectory;
  trajectory.frames = std::move(numbers);
  return trajectory;
}

Trajectory consecutive(int n) {
  std::vector<int> numbers(n);
  std::iota(numbers.begin(), numbers.end(), 0);
  Trajectory trajectory = at_frames(numbers);
  trajectory.n_poses = n;
  return trajectory;
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

TEST(Protocols, EasyStoresEveryThirdScanOfThoseThereAre) {
  // Every 3rd frame of a drive: again a third of these is stored and the rest are queries.
  const Task task = make_tasks("paper-easy", "", at_frames({0, 3, 6, 9, 12, 18})).at(0);
  EXPECT_EQ(task.stored, (std::vector<int64_t>{0, 3}));
  ASSERT_EQ(task.queries.size(), 4u);
  EXPECT_EQ(task.queries[2].scan, 4);
  EXPECT_EQ(make_tasks("paper-easy", "", at_frames({0, 1, 2})).at(0).queries.size(), 2u);
}

TEST(Protocols, KittisFramesAreForKittisDrives) {
  for (const char* protocol : {"paper", "paper-median", "bevplace"}) {
    SCOPED_TRACE(protocol);
    // 1500 scans of another drive named 00.
    expect_error<UsageError>([&] { make_tasks(protocol, "00", consecutive(1500)); },
                             {"KITTI's drive 00", "4541 poses", "has 1500", "online"});
    Trajectory some;
    for (int frame = 0; frame < 4541; frame += 4) some.frames.push_back(frame);
    some.n_poses = 4541;
    EXPECT_FALSE(make_tasks(protocol, "00", some).empty());
  }
  EXPECT_THROW(make_tasks("paper-difficult", "08", consecutive(4070)), UsageError);
  EXPECT_EQ(make_tasks("paper-easy", "00", consecutive(1500)).size(), 1u);
}

TEST(Protocols, OnlineGrowsAndSkipsScansWithoutCandidates) {
  Trajectory trajectory = at_frames({0, 10, 51, 60, 62});
  trajectory.horizontal = Distance::kXz;
  const Task task = make_tasks("online", "", trajectory, parse_exclusion("frames=50")).at(0);
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
  // The middle one of three has no candidate.
  EXPECT_EQ(make_tasks("leave-one-out", "", consecutive(3), parse_exclusion("frames=1"))
                .at(0)
                .queries.size(),
            2u);
}

TEST(Protocols, TheDefinitionSaysTheExclusionThatIsUsed) {
  const auto definition = [](const char* protocol, const char* exclusion) {
    Trajectory drive = consecutive(200);
    drive.times.assign(drive.frames.begin(), drive.frames.end());
    return make_tasks(protocol, "", drive, parse_exclusion(exclusion)).at(0).definition;
  };
  EXPECT_TRUE(definition("leave-one-out", "none")
                  .starts_with("each scan against all scans any time before or after it"));
  EXPECT_TRUE(definition("online", "seconds=7.5")
                  .starts_with("each scan against all scans more than 7.5 s before it"));
  EXPECT_HAS(definition("ssc", "none"), "any time apart are correct");
  for (const char* protocol : {"online", "leave-one-out", "lcdnet1", "lcdnet2", "ssc", "logg3d"})
    EXPECT_HAS(definition(protocol, "frames=21"), "more than 21 frames") << protocol;
}

TEST(Protocols, ScansCanBeLeftOut) {
  Task task = make_tasks("leave-one-out", "", consecutive(6), parse_exclusion("frames=1")).at(0);
  remove_scans(task, {0, 3});
  EXPECT_EQ(task.stored, (std::vector<int64_t>{1, 2, 4, 5}));
  ASSERT_EQ(task.queries.size(), 4u);
  const auto candidates = [&](size_t q) {
    std::vector<int64_t> rows;
    for (const CandidateRange& range : task.queries[q].candidates)
      for (int64_t c = range.begin; c < range.end; ++c)
        rows.push_back(task.stored[static_cast<size_t>(c)]);
    return rows;
  };
  EXPECT_EQ(task.queries[0].scan, 1);
  EXPECT_EQ(candidates(0), (std::vector<int64_t>{4, 5}));
  EXPECT_EQ(task.queries[2].scan, 4);
  EXPECT_EQ(candidates(2), (std::vector<int64_t>{1, 2}));
  Task easy = make_tasks("paper-easy", "", consecutive(4)).at(0);
  EXPECT_THROW(remove_scans(easy, {0, 3}), UsageError) << "nothing is stored any more";
}

TEST(Protocols, PlacesStoreEveryNthScan) {
  // 77 scans of 7 places, as the HKUST rotation set: 26, 13 and 8 stored, at least one a place.
  Trajectory set = consecutive(77);
  for (int i = 0; i < 77; ++i) set.places.push_back("place_" + std::to_string(i / 11));
  for (const auto& [name, stored] :
       {std::pair("places-3", 26u), std::pair("places-6", 13u), std::pair("places-10", 8u)}) {
    const Task task = make_tasks(name, "", set).at(0);
    EXPECT_EQ(task.stored.size(), stored);
    EXPECT_EQ(task.queries.size(), 77 - stored);
    std::vector<Match> matches;  // always scan 0
    for (const TaskQuery& query : task.queries) matches.push_back({query.scan, {0}, {1}, 1, 1});
    const PrSummary s = summarize(label_matches(matches, task, set, task.rule));
    EXPECT_EQ(s.n_positives, s.n_queries);
    const auto right = static_cast<double>(11 - (stored == 26 ? 4 : 2));  // queries of place 0
    EXPECT_DOUBLE_EQ(s.recall_at_1, right / static_cast<double>(s.n_queries));
  }
}

Trajectory frames_along_x(std::vector<int> numbers, const std::vector<double>& xs) {
  Trajectory trajectory = at_frames(std::move(numbers));
  for (const double x : xs) trajectory.positions.emplace_back(x, 0, 0);
  return trajectory;
}

/// Unit vectors: `like[i]` is the cosine of scan i with stored scan 0 if positive, with stored scan
/// 1 if negative; the remaining component is orthogonal to all others.
FloatMatrix descriptors(const std::vector<double>& like) {
  const auto n = static_cast<int64_t>(like.size());
  FloatMatrix m(n, n + 2);
  for (int64_t i = 0; i < n; ++i) {
    const double cosine = like[static_cast<size_t>(i)];
    m.row(i)[cosine > 0 ? 0 : 1] = static_cast<float>(std::abs(cosine));
    m.row(i)[static_cast<size_t>(i + 2)] = static_cast<float>(std::sqrt(1 - cosine * cosine));
  }
  return m;
}

PrSummary evaluate(const FloatMatrix& m, const Task& task, const Trajectory& trajectory) {
  const std::vector<Match> matches = retrieve({m}, task, {.score = parse_score("similarity")});
  return summarize(label_matches(matches, task, trajectory, task.rule), task.rejected_only);
}

TEST(Protocols, Lcdnet1ByHand) {
  // Frames 120 to 150 are queries; only frames 0 and 10 are more than 50 before any of them.
  const Trajectory drive = frames_along_x({0, 10, 120, 130, 140, 150}, {0, 50, 1, 51, 200, 0});
  const Task task = make_tasks("lcdnet1", "", drive).at(0);
  ASSERT_EQ(task.queries.size(), 4u);
  EXPECT_FALSE(task.margin_score);
  // 120 finds 0 (correct), 130 finds 0 (incorrect, 10 is at its place), 140 finds 10 (incorrect,
  // without a correct match), 150 finds 0 (correct).
  const PrSummary s = evaluate(descriptors({1, -1, 0.9, 0.8, -0.7, 0.6}), task, drive);
  EXPECT_EQ(s.n_positives, 3);
  // Threshold  tp fp fn  precision recall
  //       0.9   1  0  2  1         1/3
  //       0.8   1  1  1  1/2       1/2    the incorrect match is no longer a false negative
  //       0.7   1  2  1  1/3       1/2
  //       0.6   2  2  0  1/2       1
  EXPECT_DOUBLE_EQ(s.average_precision, 1.0 / 3 + (1.0 / 2 - 1.0 / 3) / 2 + 1.0 / 2 / 2);
  EXPECT_DOUBLE_EQ(s.f1_max, 4.0 / (4 + 2));
  EXPECT_DOUBLE_EQ(s.recall_at_1, 2.0 / 3);
}

TEST(Protocols, Lcdnet1AsksFromFrame100) {
  const Task task = make_tasks("lcdnet1", "", consecutive(103)).at(0);
  ASSERT_EQ(task.queries.size(), 3u);
  EXPECT_EQ(task.queries[0].scan, 100);
  EXPECT_EQ(task.queries[0].n_candidates(), 50);  // frames 0 to 49
  const Task other =
      make_tasks("lcdnet1", "", consecutive(103), parse_exclusion("frames=99")).at(0);
  EXPECT_EQ(other.queries[0].n_candidates(), 1);
}

TEST(Protocols, Logg3dByHand) {
  // Frames 3 to 8 are queries; the first three are more than 30 s before them.
  Trajectory drive =
      frames_along_x({0, 1, 2, 3, 4, 5, 6, 7, 8}, {0, 10, 100, 9, 1, 100, 15, 11, 200});
  drive.times = {0, 0.5, 0.7, 31, 32, 33, 34, 35, 36};
  const Task task = make_tasks("logg3d", "", drive).at(0);
  ASSERT_EQ(task.queries.size(), 6u);
  // 3 (x = 9) finds 0, 9 m away: ignored, though 1 is near. 4 (1) finds 0: correct. 5 (100) finds
  // 0: incorrect, 2 is near. 6 (15) finds 1, 5 m away: ignored, nothing is near. 7 (11) finds 1:
  // correct. 8 (200) finds 0: incorrect, nothing is near.
  const PrSummary s =
      evaluate(descriptors({1, -1, 0, 0.9, 0.8, 0.7, -0.6, -0.5, 0.4}), task, drive);
  EXPECT_EQ(s.n_positives, 4);
  // Threshold  tp fp fn  precision recall
  //       0.9   0  0  3  -         0
  //       0.8   1  0  2  1         1/3
  //       0.7   1  1  1  1/2       1/2
  //       0.6   1  1  1  1/2       1/2
  //       0.5   2  1  0  2/3       1
  //       0.4   2  2  0  1/2       1
  EXPECT_DOUBLE_EQ(s.average_precision, 1.0 / 3 + (1.0 / 2 - 1.0 / 3) / 2 + 1.0 / 2 * 2 / 3);
  EXPECT_DOUBLE_EQ(s.f1_max, 4.0 / 5);
  EXPECT_NEAR(s.f1_max_threshold, 0.5, 1e-6);  // descriptors are floats
  EXPECT_DOUBLE_EQ(s.recall_at_1, 2.0 / 4);
  drive.times.clear();
  EXPECT_THROW(make_tasks("logg3d", "", drive), UsageError);
  EXPECT_EQ(make_tasks("logg3d", "", drive, parse_exclusion("frames=4")).at(0).queries.size(), 4u);
}

TEST(Protocols, PairTasksTakeTheRightCandidates) {
  const Task lcdnet2 = make_tasks("lcdnet2", "", consecutive(110)).at(0);
  EXPECT_TRUE(lcdnet2.decides_on_pairs);
  EXPECT_FALSE(lcdnet2.margin_score);
  EXPECT_EQ(lcdnet2.queries.front().scan, 100);
  EXPECT_EQ(lcdnet2.queries.front().n_candidates(), 50);
  const Task ssc = make_tasks("ssc", "", consecutive(110)).at(0);
  EXPECT_TRUE(ssc.decides_on_pairs);
  EXPECT_EQ(ssc.queries.front().scan, 1);  // a far pair may be near in time
  EXPECT_EQ(ssc.queries.back().n_candidates(), 109);
  EXPECT_EQ(to_string(ssc.exclusion), "frames=50");
  EXPECT_EQ(ssc.negatives_per_positive, 100);
}

TEST(Protocols, BevplaceHasFixedRanges) {
  const std::tuple<const char*, int, size_t, size_t> table[] = {{"00", 4541, 3000, 1341},
                                                                {"02", 4661, 3400, 1061},
                                                                {"05", 2761, 1000, 1551},
                                                                {"06", 1101, 600, 301},
                                                                {"08", 4071, 1000, 2871}};
  for (const auto& [sequence, n, stored, asked] : table) {
    const Task task = make_tasks("bevplace", sequence, consecutive(n)).at(0);
    EXPECT_EQ(task.stored.size(), stored) << sequence;
    EXPECT_EQ(task.queries.size(), asked) << sequence;
    EXPECT_EQ(task.queries.front().scan, static_cast<int64_t>(stored) + 200) << sequence;
  }
  EXPECT_THROW(make_tasks("bevplace", "07", consecutive(1101)), UsageError);
  Trajectory first = consecutive(3200);
  first.n_poses = 4541;
  EXPECT_THROW(make_tasks("bevplace", "00", first), UsageError);  // no queries

  // 06: 200 and 599 stored, 600 and 799 skipped; 800, 1000 and 1100 are queries.
  Trajectory drive =
      frames_along_x({200, 599, 600, 799, 800, 1000, 1100}, {0, 50, 0, 0, 4.9, 45, 70});
  drive.n_poses = 1101;
  const Task task = make_tasks("bevplace", "06", drive).at(0);
  // 800 finds 200 (4.9 m, correct), 1000 finds 200 (incorrect; 599 is exactly 5 m away, not near),
  // 1100 has no correct match.
  const PrSummary s = evaluate(descriptors({1, -1, 0.1, 0.1, 0.9, 0.8, 0.7}), task, drive);
  EXPECT_EQ(s.n_positives, 1);
  EXPECT_EQ(s.recall_at_1, 1);
}

int64_t positives(const char* protocol, const std::string& sequence, const Trajectory& drive) {
  const Task task = make_tasks(protocol, sequence, drive).at(0);
  std::vector<Match> matches;
  for (const TaskQuery& query : task.queries)
    matches.push_back({query.scan, {task.stored[query.candidates[0].begin]}, {0}, 0, 1});
  return summarize(label_matches(matches, task, drive, task.rule)).n_positives;
}

TEST(Protocols, CountsOfTheOfficialPoses) {
  // Counted with numpy from the published formulas and the official poses.
  REVISIT_NEED_SHARED(kitti, "data/kitti");
  const std::tuple<const char*, int64_t, int64_t> table[] = {
      {"00", 791, 682}, {"05", 492, 447}, {"06", 269, 270}, {"08", 332, 335}};
  for (const auto& [sequence, lcdnet1, bevplace] : table) {
    const Trajectory drive =
        trajectory_of(read_kitti_poses(kitti / "poses" / str(sequence, ".txt")));
    EXPECT_EQ(positives("lcdnet1", sequence, drive), lcdnet1) << sequence;
    EXPECT_EQ(positives("bevplace", sequence, drive), bevplace) << sequence;
  }
  const Trajectory drive = trajectory_of(read_kitti_poses(kitti / "poses/00.txt"),
                                         read_kitti_times(kitti / "sequences/00/times.txt"));
  EXPECT_EQ(positives("logg3d", "00", drive), 776);
}

TEST(Protocols, EveryNameHasADefinition) {
  Trajectory drive = consecutive(4541);
  drive.times.assign(drive.frames.begin(), drive.frames.end());
  ASSERT_EQ(protocols().size(), protocol_names().size());
  const std::string documentation = read_file(test::project_file("docs/reference/EVALUATION.md"));
  for (const Protocol& protocol : protocols()) {
    EXPECT_FALSE(protocol.definition.empty());
    EXPECT_FALSE(protocol.source.empty());
    EXPECT_HAS(documentation, protocol.name);
    if (protocol.name == "paper") continue;
    const bool on_08 = protocol.name == "paper-difficult";
    drive.n_poses = on_08 ? 4071 : 4541;
    const Task task = make_tasks(protocol.name, on_08 ? "08" : "00", drive).at(0);
    EXPECT_EQ(task.name, protocol.name);
    EXPECT_EQ(task.definition, protocol.definition);
    EXPECT_FALSE(task.population.empty());
  }
}

TEST(Protocols, RejectsUnknownProtocolsAndShortDrives) {
  EXPECT_THROW(make_tasks("papr", "00", consecutive(10)), UsageError);
  EXPECT_THROW(make_tasks("online", "00", consecutive(10)),
               UsageError);  // nothing beyond 50 frames
  EXPECT_THROW(make_tasks("paper-median", "08", consecutive(10)), UsageError);  // nothing stored
  EXPECT_THROW(make_tasks("paper-easy", "", at_frames({0})), UsageError);       // nothing asked
  EXPECT_THROW(make_tasks("online", "", {}), UsageError);
}

}  // namespace
}  // namespace revisit
