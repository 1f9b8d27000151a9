#include "revisit/evaluation/robustness.h"

#include <algorithm>
#include <array>
#include <iterator>
#include <limits>

#include "revisit/base/error.h"
#include "revisit/base/hash.h"
#include "revisit/evaluation/precision_recall.h"
#include "revisit/recognition/place_index.h"

namespace revisit {
namespace {

namespace fs = std::filesystem;

constexpr double kNever = -std::numeric_limits<double>::infinity();

void check_robustness(const Dataset& drive, const FeatureExtractor& extractor,
                      const RobustnessOptions& options) {
  if (extractor.sees<GrayImage>())
    throw UsageError("the feature ", extractor.name,
                     " is computed from camera images, which cannot be perturbed");
  if (drive.scans.empty()) throw UsageError("robustness: the drive has no scans");
  if (options.perturbations.empty())
    throw UsageError("robustness: expected at least one perturbation, found none");
  if (options.queries < 0)
    throw UsageError("robustness: expected at least 0 queries, found ", options.queries);
  if (!(options.rule.radius > 0))
    throw UsageError("robustness: expected a radius above 0, found ", options.rule.radius);
  if (options.both_cases && options.describe.align != AlignCase::kOne)
    throw UsageError("robustness: queries in both alignment cases need align case1");
}

/// Places are indices into the stored scans.
struct QueryScan {
  int64_t scan = 0;  // row of the drive
  int64_t own = 0;
  std::array<CandidateRange, 2> candidates;  // all except temporal neighbors
  std::vector<int64_t> near;
  std::vector<bool> other;  // by place
};

struct Places {
  Dataset scans;  // scans of the drive, then of the distractors
  std::vector<int64_t> rows;
};

std::vector<int64_t> evenly(const std::vector<int64_t>& rows, int64_t wanted) {
  const auto all = std::ssize(rows), n = wanted ? std::min(wanted, all) : all;
  std::vector<int64_t> chosen;
  for (int64_t i = 0; i < n; ++i)
    chosen.push_back(rows[static_cast<size_t>((2 * i + 1) * all / (2 * n))]);
  return chosen;
}

std::vector<int64_t> query_rows(const Trajectory& trajectory) {
  std::vector<int64_t> rows;
  for (int64_t row = 0; row < trajectory.size(); ++row)
    if (!trajectory.listed || trajectory.listed->knows(trajectory.frames[static_cast<size_t>(row)]))
      rows.push_back(row);
  return rows;
}

std::vector<QueryScan> query_scans(const Trajectory& trajectory, const TrueMatchRule& rule,
                                   const Places& places, const RobustnessOptions& options) {
  const std::vector<int64_t> before = earlier_candidates(trajectory, options.exclusion);
  const std::vector<int64_t> after = later_candidates(trajectory, options.exclusion);
  const auto place_of = [&](int64_t row) {
    return std::ranges::lower_bound(places.rows, row) - places.rows.begin();
  };
  std::vector<QueryScan> all;
  for (const int64_t scan : evenly(query_rows(trajectory), options.queries)) {
    const auto at = static_cast<size_t>(scan);
    const int64_t own = place_of(scan);
    if (own == std::ssize(places.rows) || places.rows[static_cast<size_t>(own)] != scan)
      continue;  // cannot be described
    // A list contains only earlier places.
    const int64_t later = trajectory.listed ? trajectory.size() : after[at];
    QueryScan query{scan, own, {}, {}, std::vector<bool>(places.rows.size())};
    query.candidates = {CandidateRange{0, place_of(before[at])},
                        CandidateRange{place_of(later), std::ssize(places.rows)}};
    for (const CandidateRange& range : query.candidates)
      for (int64_t place = range.begin; place < range.end; ++place) {
        const int64_t row = places.rows[static_cast<size_t>(place)];
        const PairLabel truth = row < trajectory.size() ? pair_label(trajectory, rule, scan, row)
                                                        : PairLabel::kIncorrect;
        if (truth == PairLabel::kCorrect) query.near.push_back(place);
        query.other[static_cast<size_t>(place)] = truth == PairLabel::kIncorrect;
      }
    all.push_back(std::move(query));
  }
  return all;
}

void label_best(const PlaceIndex& index, const FloatMatrix& descriptors,
                const std::vector<QueryScan>& scans, const SearchOptions& search,
                std::vector<MatchLabel>& labels) {
  std::vector<Query> queries;
  for (size_t i = 0; i < scans.size(); ++i)
    queries.push_back({descriptors.row(static_cast<int64_t>(i)), scans[i].candidates});
  for (const Match& match : index.best_of_many(queries, search)) {
    const auto i = static_cast<size_t>(match.query);
    if (match.ranks.empty() || match.score <= labels[i].score) continue;
    const int64_t best = match.ranks.front();
    labels[i].score = match.score;
    labels[i].correct = std::ranges::find(scans[i].near, best) != scans[i].near.end();
    labels[i].ignored = !labels[i].correct && !scans[i].other[static_cast<size_t>(best)];
  }
}

/// [scan][place]; kNever if a place was not compared.
using Similarities = std::vector<std::vector<double>>;

void compare_all(const PlaceIndex& index, const FloatMatrix& descriptors,
                 const RobustnessOptions& options, const Observer& observer,
                 Similarities& highest) {
  constexpr int64_t kAtOnce = 256;  // limits memory: all similarities of this many scans
  const CandidateRange all{0, index.size()};
  SearchOptions search;
  search.k = static_cast<int>(index.size());
  search.threads = options.threads;
  search.stop = observer.stop;
  for (int64_t first = 0; first < descriptors.n; first += kAtOnce) {
    std::vector<Query> queries;
    for (int64_t i = first; i < std::min(first + kAtOnce, descriptors.n); ++i)
      queries.push_back({descriptors.row(i), {&all, 1}});
    for (const Match& match : index.best_of_many(queries, search)) {
      std::vector<double>& of_scan = highest[static_cast<size_t>(first + match.query)];
      for (size_t rank = 0; rank < match.ranks.size(); ++rank) {
        double& similarity = of_scan[static_cast<size_t>(match.ranks[rank])];
        similarity = std::max(similarity, match.similarities[rank]);
      }
    }
  }
}

double median(std::vector<double> values) {
  std::ranges::sort(values);
  const size_t half = values.size() / 2;
  return values.size() % 2 ? values[half] : (values[half - 1] + values[half]) / 2;
}

RobustnessRow evaluate_perturbed(const std::vector<QueryScan>& scans,
                                 const Similarities& similarities,
                                 const std::vector<bool>& described,
                                 std::vector<MatchLabel> labels) {
  constexpr double kLeast = 1e-3;  // avoids division by 0
  RobustnessRow row;
  std::vector<double> ratios;
  for (size_t i = 0; i < scans.size(); ++i) {
    const std::vector<double>& of = similarities[i];
    const auto first = std::ranges::max_element(of) - of.begin();
    ++row.n_queries;
    row.own += described[i] && first == scans[i].own;
    row.not_described += !described[i];
    if (scans[i].near.empty()) continue;
    ++row.queries_with_neighbor;
    double near = kNever, other = kNever;
    for (const int64_t place : scans[i].near) near = std::max(near, of[static_cast<size_t>(place)]);
    for (size_t place = 0; place < of.size(); ++place)
      if (scans[i].other[place]) other = std::max(other, of[place]);
    row.near += described[i] && near > other;
    if (std::ranges::find(scans[i].other, true) == scans[i].other.end()) continue;
    ratios.push_back(described[i] && near > kNever ? near / std::max(other, kLeast) : 0);
  }
  for (size_t i = 0; i < scans.size(); ++i)
    if (!described[i]) labels[i] = {kNever, false, labels[i].positive};
  const PrSummary summary = summarize(labels);
  row.recall_at_1 = summary.recall_at_1;
  row.average_precision = summary.average_precision;
  row.ratio_median = ratios.empty() ? std::numeric_limits<double>::quiet_NaN() : median(ratios);
  row.ratio_min = ratios.empty() ? row.ratio_median : std::ranges::min(ratios);
  return row;
}

}  // namespace

RobustnessResult robustness(const Dataset& drive, const std::vector<Dataset>& among,
                            const FeatureExtractor& extractor, const RobustnessOptions& options,
                            const Observer& observer) {
  check_robustness(drive, extractor, options);
  Trajectory trajectory = make_trajectory(drive);
  trajectory.listed = options.listed;
  const TrueMatchRule rule = options.listed ? TrueMatchRule{Distance::kPairs, 0} : options.rule;
  need_distances(trajectory, rule.distance, "robustness");

  RobustnessResult result;
  Places places{drive, {}};
  for (const Dataset& other : among)
    places.scans.scans.insert(places.scans.scans.end(), other.scans.begin(), other.scans.end());
  DatasetFeatures features(places.scans, extractor, options.describe, options.cache, observer);
  result.skipped = features.skipped();
  for (int64_t row = 0; row < features.n(); ++row)
    if (!std::ranges::binary_search(result.skipped, row)) places.rows.push_back(row);
  result.stored = static_cast<int64_t>(places.rows.size());
  const std::vector<QueryScan> scans = query_scans(trajectory, rule, places, options);
  if (scans.empty()) throw InputError("robustness: none of the query scans can be described");
  std::vector<MatchLabel> nothing_found;
  for (const QueryScan& one : scans) nothing_found.push_back({kNever, false, !one.near.empty()});

  Task task;
  task.stored = places.rows;
  const fs::path model = options.cache / ("pca-" + short_name_of(features.key()));
  const Descriptors stored =
      reduce(options.reduction, task, features, nullptr, observer,
             options.reduction.components >= 0 && !extractor.fit_projection ? model : fs::path());
  result.numbers = stored.case1.d;
  PlaceIndex index(stored.case1.d, stored.comparison);
  for (const int64_t row : places.rows) index.add_view(stored.case1.row(row));

  Dataset queries = drive;
  queries.scans.clear();
  for (const QueryScan& one : scans)
    queries.scans.push_back(drive.scans[static_cast<size_t>(one.scan)]);
  std::vector<AlignCase> cases{options.describe.align};
  if (options.both_cases) cases.push_back(AlignCase::kTwo);
  const auto n = static_cast<int64_t>(queries.scans.size());
  const auto total = n * static_cast<int64_t>(cases.size() * options.perturbations.size());
  const SearchOptions search{.score = extractor.similarity_is_probability ? Score::kSimilarity
                                      : stored.comparison.same_place      ? Score::kDistinctMargin
                                                                          : Score::kMargin,
                             .threads = options.threads,
                             .stop = observer.stop};
  const Progress progress = observer.stage("altering", "scans");
  int64_t before = 0;
  Observer quiet;  // scans that cannot be described are counted
  quiet.stop = observer.stop;
  quiet.stage = [&](const char*, const char*) {
    return [&](int64_t done, int64_t) { progress(before + done, total); };
  };
  for (const Perturbation& perturbation : options.perturbations) {
    Similarities highest(scans.size(), std::vector<double>(places.rows.size(), kNever));
    std::vector<bool> described(scans.size(), true);
    std::vector<MatchLabel> labels = nothing_found;
    for (const AlignCase align : cases) {
      DescribeOptions how = options.describe;
      how.align = align;
      how.perturbation = perturbation;
      how.seed = options.seed;
      DatasetFeatures perturbed(queries, extractor, how, options.cache, quiet);
      const FeatureFile& file = perturbed.file();
      before += n;
      progress(before, total);
      for (int64_t i = 0; i < n; ++i)
        if (alignment_of(file, i).described == 0) described[static_cast<size_t>(i)] = false;
      const FloatMatrix descriptors = stored.of_more(file);
      compare_all(index, descriptors, options, observer, highest);
      label_best(index, descriptors, scans, search, labels);
    }
    result.rows.push_back(evaluate_perturbed(scans, highest, described, std::move(labels)));
    result.rows.back().perturbation = perturbation;
  }
  return result;
}

}  // namespace revisit
