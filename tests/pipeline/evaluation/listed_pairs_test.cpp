#include "revisit/evaluation/ground_truth.h"
#include "revisit/evaluation/precision_recall.h"
#include "revisit/evaluation/protocols.h"
#include "testing.h"

namespace revisit {
namespace {

using Places = ListedPairs::Places;

/// Frames 10, 12, ...
Dataset plain(int n) {
  Dataset dataset;
  dataset.name = "drive";
  for (int i = 0; i < n; ++i) {
    ScanRef& scan = dataset.scans.emplace_back();
    scan.frame = 10 + 2 * i;
    scan.file = "drive/0000" + std::to_string(scan.frame) + ".bin";
  }
  return dataset;
}

/// Two laps of three scans; frame numbers continue.
Dataset laps() {
  Dataset dataset;
  dataset.name = "laps";
  for (const char* lap : {"first", "second"})
    for (int i = 0; i < 3; ++i) {
      ScanRef& scan = dataset.scans.emplace_back();
      scan.frame = static_cast<int>(dataset.scans.size()) - 1;
      scan.file = std::string(lap) + "/00000" + std::to_string(i) + ".bin";
      scan.place = lap;
    }
  return dataset;
}

class ListedPairsFile : public testing::Test {
 protected:
  Places read(const std::string& text, const Dataset& dataset, int near = 0) const {
    write_file(dir_ / "pairs.csv", text);
    return read_pairs(dir_ / "pairs.csv", dataset, near);
  }
  const TempDir dir_;
};

TEST_F(ListedPairsFile, HeadersSeparatorsAndNamesAreTolerated) {
  const Places expected = {{14, {10, 12}}, {16, {}}};
  for (const char* text : {
           "14,10\n14,12\n16,\n",
           "query,place,inliers\n14,10,0.7\n14,12,0.6\n16,,\n",
           "\xEF\xBB\xBFquery_index,match_index\r\n14,10\r\n14,12\r\n16\r\n",
           "distance_m; place; query\n0.5; 10; 14\n0.7; 12; 14\n;; 16\n",
           "# of Monday\n\n  000014 000010.bin # sure\n14 12\n16\n",
           "query\tmatch\n14\t\"10\"\n14\t12\n16\t",
       })
    EXPECT_EQ(read(text, plain(4)), expected) << text;
  EXPECT_EQ(read("second/000001,first/000002.bin\n5,0\n", laps()), (Places{{4, {2}}, {5, {0}}}));
}

TEST_F(ListedPairsFile, NearFramesOfTheSameFolderCount) {
  EXPECT_EQ(read("16,12\n", plain(4), 1), (Places{{16, {12}}}));
  EXPECT_EQ(read("16,12\n", plain(4), 2), (Places{{16, {10, 12, 14}}}));
  EXPECT_EQ(read("second/000002,first/000002\n", laps(), 2), (Places{{5, {0, 1, 2}}}));
}

TEST_F(ListedPairsFile, ErrorsNameLineAndExpectation) {
  for (const auto& [text, message] : std::vector<std::pair<std::string, std::string>>{
           {"14,10\n15,10\n",
            "pairs.csv:2: expected a scan of drive, frame 10 (000010) to 16 "
            "(000016), found '15'"},
           {"query,place\n14,x\n", "pairs.csv:2: expected a scan of drive"},
           {"from,to\n14,10\n", "pairs.csv:1: expected a scan of drive"},
           {"query,inliers\n14,1\n", "pairs.csv:1: expected a column 'place'"},
           {"14,10\n,12\n", "pairs.csv:2: expected a query and its place, found ',12'"},
           {"query,place\n\n# none\n", "pairs.csv: lists no pairs"}})
    expect_error<InputError>([&] { read(text, plain(4)); }, {message});
  EXPECT_THROW(read("14,10\n", plain(4), -1), UsageError);
  Dataset twice = plain(4);
  twice.scans[1].file = "drive/000010.pcd";
  EXPECT_EQ(read("14,000010.pcd\n", twice), (Places{{14, {12}}}));
  expect_error<InputError>([&] { read("14,000010\n", twice); },
                           {"'000010' may be", "000010.bin", "000010.pcd"});
  twice.scans[1].file = "drive/16.bin";  // its frame is 12
  expect_error<InputError>([&] { read("14,16\n", twice); }, {"'16' may be", "000016.bin"});
  EXPECT_THROW(read_pairs(dir_ / "none.csv", plain(4)), InputError);
}

/// A drive of six scans; 4 is listed with 0 and 1, 5 with none; 4 -> 2 is uncertain.
Trajectory listed(bool complete) {
  Trajectory trajectory;
  trajectory.frames = {0, 1, 2, 3, 4, 5};
  trajectory.listed = {{{4, {0, 1}}, {5, {}}}, {{4, {2}}, {3, {0}}}, complete};
  return trajectory;
}

TEST(ListedTruth, ListedIsRightAndTheRestWrong) {
  const Trajectory some = listed(false), all = listed(true);
  const MatchRule rule{Distance::kPairs, 0};
  for (const Trajectory* trajectory : {&some, &all}) {
    const auto of = [&](int64_t query, int64_t match) {
      return pair_label(*trajectory, rule, query, match);
    };
    EXPECT_EQ(of(4, 0), PairLabel::kCorrect);
    EXPECT_EQ(of(4, 1), PairLabel::kCorrect);
    EXPECT_EQ(of(4, 2), PairLabel::kIgnored);
    EXPECT_EQ(of(4, 3), PairLabel::kIncorrect);
    EXPECT_EQ(of(5, 0), PairLabel::kIncorrect) << "it is known to have no place";
    EXPECT_EQ(of(3, 0), PairLabel::kIgnored);
  }
  EXPECT_EQ(pair_label(some, rule, 3, 1), PairLabel::kIgnored) << "nobody knows";
  EXPECT_EQ(pair_label(all, rule, 0, 4), PairLabel::kCorrect) << "a pair holds both ways";
  EXPECT_EQ(pair_label(all, rule, 0, 3), PairLabel::kIgnored);
  EXPECT_EQ(pair_label(all, rule, 3, 1), PairLabel::kIncorrect);
}

TEST(ListedTruth, QueriesNobodyKnowsAreNotAsked) {
  const Exclusion none{Exclusion::Kind::kNone, 0};
  const auto queries = [&](bool complete) {
    std::vector<int64_t> rows;
    const Task task = make_tasks("online", "", listed(complete), none).at(0);
    for (const TaskQuery& query : task.queries) rows.push_back(query.scan);
    return rows;
  };
  EXPECT_EQ(queries(false), (std::vector<int64_t>{4, 5}));
  EXPECT_EQ(queries(true), (std::vector<int64_t>{1, 2, 3, 4, 5}));
}

TEST(ListedTruth, NeighborsAreExcludedAndSomePlaceCanBeFound) {
  const Trajectory some = listed(false);
  const auto make = [&](const char* protocol, const std::optional<Exclusion>& exclusion) {
    return [&some, protocol, exclusion] { make_tasks(protocol, "", some, exclusion); };
  };
  const Exclusion one = parse_exclusion("frames=1"), none = parse_exclusion("none");
  for (const char* protocol : {"paper-easy", "ssc"}) {
    expect_error<UsageError>(make(protocol, {}), {"temporal neighbors of a query", "online"});
    expect_error<UsageError>(make(protocol, one), {"temporal neighbors of a query"});
  }
  EXPECT_NO_THROW(make("online", none)());
  EXPECT_NO_THROW(make("leave-one-out", one)());
  expect_error<UsageError>(make("online", parse_exclusion("frames=4")),
                           {"none of 1 listed queries has a listed place among its candidates"});
}

TEST(ListedTruth, FiguresByHand) {
  // All scans as queries: 4 finds 1 (correct), 5 finds 1 (incorrect), 3 finds 0 (ignored), 1 and 2
  // find 0 (incorrect). One positive is found at the second score, after one incorrect match.
  const Trajectory all = listed(true);
  const Exclusion none{Exclusion::Kind::kNone, 0};
  const Task task = make_tasks("online", "", all, none).at(0);
  const std::vector<Match> matches = {{1, {0}, {}, 0.1},
                                      {2, {0}, {}, 0.2},
                                      {3, {0}, {}, 0.95},
                                      {4, {1}, {}, 0.8},
                                      {5, {1}, {}, 0.9}};
  const PrSummary s = summarize(label_matches(matches, task, all, task.rule));
  EXPECT_EQ(s.n_queries, 5);
  EXPECT_EQ(s.n_positives, 1);
  EXPECT_EQ(s.recall_at_1, 1);
  EXPECT_DOUBLE_EQ(s.average_precision, 0.5);
  EXPECT_EQ(s.max_recall_at_precision_1, 0);
}

}  // namespace
}  // namespace revisit
