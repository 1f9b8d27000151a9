#include <algorithm>
#include <array>
#include <iterator>
#include <limits>

#include "revisit/base/error.h"
#include "revisit/base/hash.h"
#include "revisit/evaluation/evaluate.h"

namespace revisit {
namespace {

namespace fs = std::filesystem;

constexpr double kNever = -std::numeric_limits<double>::infinity();

void check_perturbed(const Dataset& drive, const FeatureExtractor& extractor,
                     const PerturbedQueries& perturbed, const EvaluationOptions& options) {
  if (extractor.sees<GrayImage>())
    throw UsageError("the feature ", extractor.name,
                     " is computed from camera images, which cannot be perturbed");
  if (drive.scans.empty()) throw UsageError("perturbed queries: the drive has no scans");
  if (perturbed.perturbations.empty())
    throw UsageError("perturbed queries: expected at least one perturbation, found none");
  if (perturbed.n < 0)
    throw UsageError("perturbed queries: expected at least 0 queries, found ", perturbed.n);
  if (options.radius && !(*options.radius > 0))
    throw UsageError("perturbed queries: expected a radius above 0, found ", *options.radius);
  if (options.query_case == QueryCase::kBoth && options.describe.align != AlignCase::kOne)
    throw UsageError("perturbed queries in both alignment cases need align case1");
}

Task perturbed_task(const Trajectory& trajectory, const EvaluationOptions& options) {
  Task task;
  if (trajectory.listed)
    task.rule = {Distance::kPairs, 0};
  else
    task.rule = {options.distance.value_or(trajectory.horizontal),
                 options.radius.value_or(MatchRule().radius), options.negative_radius.value_or(0)};
  task.definition = "perturbed scans against all unperturbed ones";
  task.exclusion = options.exclusion.value_or(task.exclusion);
  need_distances(trajectory, task.rule.distance, "an evaluation of perturbed scans");
  return task;
}

/// Places are indices into the stored scans.
struct QueryScan {
  int64_t scan = 0;  // row of the drive
  int64_t self = 0;
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

std::vector<QueryScan> query_scans(const Trajectory& trajectory, const Task& task,
                                   const Places& places, int64_t wanted) {
  const std::vector<int64_t> before = earlier_candidates(trajectory, task.exclusion);
  const std::vector<int64_t> after = later_candidates(trajectory, task.exclusion);
  const auto place_of = [&](int64_t row) {
    return std::ranges::lower_bound(places.rows, row) - places.rows.begin();
  };
  std::vector<QueryScan> all;
  for (const int64_t scan : evenly(query_rows(trajectory), wanted)) {
    const auto at = static_cast<size_t>(scan);
    const int64_t self = place_of(scan);
    if (self == std::ssize(places.rows) || places.rows[static_cast<size_t>(self)] != scan)
      continue;  // cannot be described
    // A list contains only earlier places.
    const int64_t later = trajectory.listed ? trajectory.size() : after[at];
    QueryScan query{scan, self, {}, {}, std::vector<bool>(places.rows.size())};
    query.candidates = {CandidateRange{0, place_of(before[at])},
                        CandidateRange{place_of(later), std::ssize(places.rows)}};
    for (const CandidateRange& range : query.candidates)
      for (int64_t place = range.begin; place < range.end; ++place) {
        const int64_t row = places.rows[static_cast<size_t>(place)];
        const PairLabel truth = row < trajectory.size()
                                    ? pair_label(trajectory, task.rule, scan, row)
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

void compare_all(const PlaceIndex& index, const FloatMatrix& descriptors, SearchOptions search,
                 Similarities& highest) {
  constexpr int64_t kAtOnce = 256;  // limits memory: all similarities of this many scans
  const CandidateRange all{0, index.size()};
  search.k = static_cast<int>(index.size());
  search.score = SearchOptions().score;
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

PerturbedFigures figures_of(const std::vector<QueryScan>& scans, const Similarities& similarities,
                            const std::vector<bool>& described) {
  constexpr double kLeast = 1e-3;  // avoids division by 0
  PerturbedFigures figures;
  std::vector<double> ratios;
  for (size_t i = 0; i < scans.size(); ++i) {
    const std::vector<double>& of = similarities[i];
    const auto first = std::ranges::max_element(of) - of.begin();
    figures.self += described[i] && first == scans[i].self;
    figures.skipped += !described[i];
    if (scans[i].near.empty()) continue;
    double near = kNever, other = kNever;
    for (const int64_t place : scans[i].near) near = std::max(near, of[static_cast<size_t>(place)]);
    for (size_t place = 0; place < of.size(); ++place)
      if (scans[i].other[place]) other = std::max(other, of[place]);
    figures.neighbor += described[i] && near > other;
    if (std::ranges::find(scans[i].other, true) == scans[i].other.end()) continue;
    ratios.push_back(described[i] && near > kNever ? near / std::max(other, kLeast) : 0);
  }
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  figures.ratio_median = ratios.empty() ? kNone : median(ratios);
  figures.ratio_min = ratios.empty() ? kNone : std::ranges::min(ratios);
  return figures;
}

/// The unperturbed scans, and the queries.
class PerturbedEvaluation {
 public:
  PerturbedEvaluation(const Dataset& drive, const Trajectory& trajectory,
                      const FeatureExtractor& extractor, const PerturbedQueries& perturbed,
                      const EvaluationOptions& options, const Observer& observer)
      : extractor_(extractor),
        perturbed_(perturbed),
        options_(options),
        observer_(observer),
        task_(perturbed_task(trajectory, options)),
        places_{drive, {}} {
    for (const Dataset& other : perturbed.distractors)
      places_.scans.scans.insert(places_.scans.scans.end(), other.scans.begin(), other.scans.end());
    DatasetFeatures features(places_.scans, extractor, options.describe, options.cache, observer);
    const std::vector<int64_t> skipped = features.skipped();
    for (int64_t row = 0; row < features.n(); ++row)
      if (!std::ranges::binary_search(skipped, row))
        places_.rows.push_back(row);
      else if (row < std::ssize(drive.scans))
        result_.skipped.push_back(row);
    result_.alignments = features.alignments();
    result_.alignments.resize(drive.scans.size());
    scans_ = query_scans(trajectory, task_, places_, perturbed.n);
    if (scans_.empty())
      throw InputError("perturbed queries: none of the query scans can be described");
    queries_ = drive;
    queries_.scans.clear();
    task_.stored = places_.rows;
    for (const QueryScan& one : scans_) {
      queries_.scans.push_back(drive.scans[static_cast<size_t>(one.scan)]);
      task_.queries.push_back({one.scan, one.candidates});
    }
    task_.population = str(scans_.size(), " perturbed scans against all unperturbed ones");
    reduce_stored(features);
    result_.describe_times = features.times();
  }

  EvaluationResult run() {
    const auto cases = options_.query_case == QueryCase::kBoth ? 2 : 1;
    const auto total = std::ssize(scans_) * cases * std::ssize(perturbed_.perturbations);
    const Progress progress = observer_.stage("perturbing", "scans");
    int64_t before = 0;
    for (const Perturbation& perturbation : perturbed_.perturbations) {
      result_.tasks.push_back(
          evaluate(perturbation, [&](int64_t done) { progress(before + done, total); }));
      before += std::ssize(scans_) * cases;
    }
    return std::move(result_);
  }

 private:
  void reduce_stored(DatasetFeatures& features) {
    const fs::path model = options_.cache / ("pca-" + short_name_of(features.key()));
    const bool keeps_model = options_.reduction.components >= 0 && !extractor_.fit_projection;
    stored_ = reduce(options_.reduction, task_, features, nullptr, observer_,
                     keeps_model ? model : fs::path());
    index_.emplace(stored_.case1.d, stored_.comparison);
    for (const int64_t row : places_.rows) index_->add_view(stored_.case1.row(row));
    search_ = {.score = extractor_.similarity_is_probability ? Score::kSimilarity
                        : stored_.comparison.same_place      ? Score::kDistinctMargin
                                                             : Score::kMargin,
               .threads = options_.threads,
               .stop = observer_.stop};
  }

  TaskResult evaluate(const Perturbation& perturbation,
                      const std::function<void(int64_t done)>& progress) {
    TaskResult result;
    for (const QueryScan& one : scans_) result.labels.push_back({kNever, false, !one.near.empty()});
    Similarities highest(scans_.size(), std::vector<double>(places_.rows.size(), kNever));
    std::vector<bool> described(scans_.size(), true);
    std::vector<AlignCase> cases{options_.describe.align};
    if (options_.query_case == QueryCase::kBoth) cases.push_back(AlignCase::kTwo);
    int64_t before = 0;
    for (const AlignCase align : cases) {
      DescribeOptions how = options_.describe;
      how.align = align;
      how.perturbation = perturbation;
      how.seed = perturbed_.seed;
      Observer quiet;  // scans that cannot be described are counted
      quiet.stop = observer_.stop;
      quiet.stage = [&](const char*, const char*) {
        return [&](int64_t done, int64_t) { progress(before + done); };
      };
      DatasetFeatures perturbed(queries_, extractor_, how, options_.cache, quiet);
      const FeatureFile& file = perturbed.file();
      progress(before += std::ssize(scans_));
      for (size_t i = 0; i < scans_.size(); ++i)
        if (alignment_of(file, static_cast<int64_t>(i)).described == 0) described[i] = false;
      const FloatMatrix descriptors = stored_.of_more(file);
      compare_all(*index_, descriptors, search_, highest);
      label_best(*index_, descriptors, scans_, search_, result.labels);
    }
    for (size_t i = 0; i < scans_.size(); ++i)
      if (!described[i]) result.labels[i] = {kNever, false, result.labels[i].positive};
    result.perturbed = figures_of(scans_, highest, described);
    result.perturbed->perturbation = perturbation;
    result.task = task_;
    result.task.name = text_of(perturbation);
    result.curve = precision_recall(result.labels);
    result.summary = summarize(result.labels);
    result.score = search_.score;
    result.query_case = cases.size() == 2 ? "both" : name_of(options_.describe.align);
    result.pca_fit = stored_.pca_fit;
    result.descriptor_dim = stored_.case1.d;
    result.n_skipped = std::ssize(result_.skipped);
    return result;
  }

  const FeatureExtractor& extractor_;
  const PerturbedQueries& perturbed_;
  const EvaluationOptions& options_;
  const Observer& observer_;
  Task task_;
  Places places_;
  std::vector<QueryScan> scans_;
  Dataset queries_;
  Descriptors stored_;
  std::optional<PlaceIndex> index_;
  SearchOptions search_;
  EvaluationResult result_;
};

}  // namespace

EvaluationResult evaluate_perturbed(const Dataset& drive, const Trajectory& trajectory,
                                    const FeatureExtractor& extractor,
                                    const PerturbedQueries& perturbed,
                                    const EvaluationOptions& options, const Observer& observer) {
  check_perturbed(drive, extractor, perturbed, options);
  return PerturbedEvaluation(drive, trajectory, extractor, perturbed, options, observer).run();
}

}  // namespace revisit
