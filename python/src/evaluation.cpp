#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/map.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/set.h>
#include <nanobind/stl/variant.h>
#include <nanobind/stl/vector.h>

#include "arrays.h"
#include "module.h"
#include "revisit/evaluation/descriptors.h"
#include "revisit/evaluation/evaluate.h"
#include "unlocked.h"

namespace revisit::python {
namespace {

using namespace nb::literals;

/// True: only rejected positives are false negatives.
bool parse_missed(const std::string& text) {
  if (text == "not-found") return false;
  if (text == "rejected") return true;
  throw UsageError("missed: expected 'not-found' or 'rejected', found '", text, "'");
}

using Columns = nb::typed<nb::dict, nb::str, nb::ndarray<nb::numpy>>;

Columns columns_of(const std::vector<PrPoint>& curve) {
  nb::dict columns;
  const auto column = [&](const char* name, auto PrPoint::*field) {
    std::vector<std::decay_t<decltype(curve.front().*field)>> values;
    for (const PrPoint& point : curve) values.push_back(point.*field);
    columns[name] = array_of(std::move(values));
  };
  column("threshold", &PrPoint::threshold);
  column("tp", &PrPoint::tp);
  column("fp", &PrPoint::fp);
  column("fn", &PrPoint::fn);
  column("tn", &PrPoint::tn);
  column("precision", &PrPoint::precision);
  column("recall", &PrPoint::recall);
  column("f1", &PrPoint::f1);
  return nb::borrow<Columns>(columns);
}

Descriptors descriptors_from(nb::handle array) {
  const auto floats = contiguous_floats(array, "descriptors");
  if (floats.ndim() != 2)
    throw value_error(
        str("descriptors: expected [scans][dimensions], found ", description_of(array)));
  Descriptors descriptors;
  descriptors.case1 =
      FloatMatrix(static_cast<int64_t>(floats.shape(0)), static_cast<int64_t>(floats.shape(1)));
  std::copy_n(floats.data(), floats.size(), descriptors.case1.values.begin());
  return descriptors;
}

using Positions = nb::typed<nb::handle, nb::ndarray<nb::numpy, double>>;

/// make_trajectory() checks the result.
Trajectory trajectory_of(const std::vector<int>& frames, nb::handle positions,
                         const std::vector<double>& times, const std::vector<std::string>& places,
                         std::optional<int64_t> n_poses, bool camera_axes) {
  refuse_masked(positions, "positions");
  GivenArray<double, nb::shape<-1, 3>, nb::c_contig> at;
  if (!positions.is_none() && !nb::try_cast(positions, at, false))
    throw type_error(str("positions: expected a float64 array [scans][3] in C order, found ",
                         description_of(positions)));
  const auto fits = [&](const char* what, size_t found) {
    if (found != frames.size())
      throw value_error(str(what, ": expected ", frames.size(), ", one per frame, found ", found));
  };
  if (!positions.is_none()) fits("positions", at.shape(0));
  if (!times.empty()) fits("times", times.size());
  if (!places.empty()) fits("places", places.size());
  Dataset dataset;
  dataset.camera_axes = camera_axes;
  for (size_t i = 0; i < frames.size(); ++i) {
    ScanRef& scan = dataset.scans.emplace_back();
    scan.frame = frames[i];
    if (!positions.is_none()) {
      scan.pose = Pose::Identity();
      scan.pose->translation() << at(i, 0), at(i, 1), at(i, 2);
    }
    if (!times.empty()) scan.time = times[i];
    if (!places.empty()) scan.place = places[i];
  }
  dataset.n_poses = n_poses.value_or(positions.is_none() ? 0 : static_cast<int64_t>(frames.size()));
  return make_trajectory(dataset);
}

/// The block of each query, or the number of consecutive queries per block.
using GivenBlocks = std::variant<int64_t, std::vector<int64_t>>;

std::vector<int64_t> blocks_from(const GivenBlocks& given, size_t queries) {
  if (const auto* const blocks = std::get_if<std::vector<int64_t>>(&given)) return *blocks;
  const int64_t length = std::get<int64_t>(given);
  if (length < 1) throw UsageError("blocks: expected at least 1 query, found ", length);
  std::vector<int64_t> blocks;
  for (size_t i = 0; i < queries; ++i) blocks.push_back(static_cast<int64_t>(i) / length);
  return blocks;
}

std::optional<Exclusion> block_length(const std::optional<std::string>& text) {
  return text ? std::optional(parse_exclusion(*text, "block")) : std::nullopt;
}

void bind_labels(nb::module_& module) {
  nb::class_<MatchLabel>(module, "MatchLabel",
                         "Score and ground-truth label of one query's best match.")
      .def(nb::init<double, bool, bool, bool>(), "score"_a, "correct"_a, "positive"_a,
           "ignored"_a = false, "See the properties.")
      .def_ro("score", &MatchLabel::score, "Score of the best match.")
      .def_ro("correct", &MatchLabel::correct, "The best match is correct.")
      .def_ro("positive", &MatchLabel::positive, "The query has a correct match in the database.")
      .def_ro("ignored", &MatchLabel::ignored, "The best match counts as neither.");
  nb::class_<PrSummary>(module, "PrSummary", "Summary metrics; NaN without positive queries.")
      .def_ro("n_queries", &PrSummary::n_queries, "Queries with at least one decision.")
      .def_ro("n_positives", &PrSummary::n_positives,
              "Queries with a correct match in the database.")
      .def_ro("n_pairs", &PrSummary::n_pairs, "Pairs of a task that decides on pairs; else 0.")
      .def_ro("n_correct_pairs", &PrSummary::n_correct_pairs, "Pairs of n_pairs that are correct.")
      .def_ro("f1_max", &PrSummary::f1_max, "Maximum of F1 over the thresholds, 0 to 1.")
      .def_ro("f1_max_threshold", &PrSummary::f1_max_threshold,
              "Highest threshold that reaches f1_max.")
      .def_ro("average_precision", &PrSummary::average_precision,
              "Sum of (R_i - R_{i-1}) P_i, without interpolation.")
      .def_ro("recall_at_1", &PrSummary::recall_at_1,
              "Fraction of positives whose best match is correct; NaN for pairs.")
      .def_ro("max_recall_at_precision_1", &PrSummary::max_recall_at_precision_1,
              "Maximum recall at precision 1; 0 if the highest score is incorrect.")
      .def_ro("extended_precision", &PrSummary::extended_precision,
              "Mean of the precision at the highest threshold and the recall at precision 1.");
  nb::class_<PrIntervals> intervals(module, "PrIntervals",
                                    "Confidence intervals of a PrSummary, as (low, high).");
  const auto interval = [&](const char* name, std::array<double, 2> PrIntervals::*field) {
    intervals.def_prop_ro(
        name,
        [field](const PrIntervals& self) { return std::pair((self.*field)[0], (self.*field)[1]); },
        "Bounds of PrSummary's metric; NaN if not computed.");
  };
  interval("f1_max", &PrIntervals::f1_max);
  interval("average_precision", &PrIntervals::average_precision);
  interval("recall_at_1", &PrIntervals::recall_at_1);
  interval("max_recall_at_precision_1", &PrIntervals::max_recall_at_precision_1);
  interval("extended_precision", &PrIntervals::extended_precision);
  module.def(
      "precision_recall",
      [](const std::vector<MatchLabel>& labels, const std::string& missed) {
        return columns_of(precision_recall(labels, parse_missed(missed)));
      },
      "labels"_a, "missed"_a = "not-found",
      "Returns the curve as columns: threshold, tp, fp, fn, tn, precision, recall, f1. One point "
      "per distinct score, highest first.\n\n"
      "missed: definition of false negatives: 'not-found' (all positives without a true positive) "
      "or 'rejected' (rejected positives). Raises UsageError for another, Error for a score of "
      "NaN.");
  module.def(
      "summarize",
      [](const std::vector<MatchLabel>& labels, const std::string& missed) {
        return summarize(labels, parse_missed(missed));
      },
      "labels"_a, "missed"_a = "not-found",
      "Returns the metrics of the curve; see precision_recall().");
  module.def(
      "bootstrap",
      [](const std::vector<MatchLabel>& labels, const std::string& missed,
         const GivenBlocks& blocks, int resamples, double confidence, uint64_t seed, int threads) {
        Listener listener;
        return listener.run([&] {
          return bootstrap(labels, parse_missed(missed),
                           {.blocks = blocks_from(blocks, labels.size()),
                            .resamples = resamples,
                            .confidence = confidence,
                            .seed = seed,
                            .threads = threads,
                            .stop = [&] { return listener.stop(); }});
        });
      },
      "labels"_a, "missed"_a = "not-found", nb::kw_only(),
      "blocks"_a = GivenBlocks(static_cast<int64_t>(kBlockOfFrames.amount)),
      "resamples"_a = BootstrapOptions().resamples, "confidence"_a = BootstrapOptions().confidence,
      "seed"_a = BootstrapOptions().seed, "threads"_a = 1,
      "Percentile bootstrap over blocks of consecutive queries (Carlstein 1986; Kuensch 1989). NaN "
      "with a single block.\n\n"
      "blocks: block index of each query, from blocks_of(), or the number of consecutive queries "
      "per block. Raises UsageError for blocks that do not match the labels.");
}

void bind_pairs(nb::module_& module) {
  nb::class_<ListedPairs>(module, "ListedPairs",
                          "Ground truth as pairs: frame of a query -> frames of its places.")
      .def(nb::init<ListedPairs::Places, ListedPairs::Places, bool>(), "correct"_a,
           "ignored"_a = ListedPairs::Places(), "complete"_a = false,
           "correct: correct matches; a query with an empty set has none.\n"
           "ignored: matches that count as neither correct nor incorrect.\n"
           "complete: if True, unlisted queries have no match; else they are not evaluated.")
      .def_ro("correct", &ListedPairs::correct,
              "Frame of a query -> frames of its correct matches.")
      .def_ro("ignored", &ListedPairs::ignored, "Frame of a query -> frames that count as neither.")
      .def_ro("complete", &ListedPairs::complete, "Unlisted queries have no match.");
  module.def("read_pairs", &read_pairs, "file"_a, "dataset"_a, "near"_a = 0,
             "Reads ListedPairs from a table of queries and places, named by frame or file.\n\n"
             "near: frames within this distance of a place are correct, too.\n"
             "Raises InputError with file and line.");
}

void bind_tasks(nb::module_& module) {
  nb::class_<Trajectory>(module, "Trajectory", "Position and time of each scan.")
      .def(
          "__init__",
          [](Trajectory* self, const std::vector<int>& frames, Positions positions,
             const std::vector<double>& times, const std::vector<std::string>& places,
             std::optional<int64_t> n_poses, bool camera_axes) {
            new (self)
                Trajectory(trajectory_of(frames, positions, times, places, n_poses, camera_axes));
          },
          "frames"_a, "positions"_a.none() = nb::none(), nb::kw_only(),
          "times"_a = std::vector<double>(), "places"_a = std::vector<std::string>(),
          "n_poses"_a = nb::none(), "camera_axes"_a = false,
          "frames: ascending.\n"
          "positions: float64 [scans][3] [m], z up.\n"
          "times: [s].\n"
          "places: names, as ground truth instead of positions.\n"
          "n_poses: number of poses of the full drive; it identifies KITTI's drives.\n"
          "camera_axes: positions have KITTI's axes instead: x right, y down, z forward.\n"
          "Raises InputError for frames that do not ascend or positions that are not finite.")
      .def("__len__", &Trajectory::size)
      .def_ro("frames", &Trajectory::frames, "Frame of each scan, ascending.")
      .def_ro("times", &Trajectory::times, "Time of each scan [s]; empty if unknown.")
      .def_ro("places", &Trajectory::places, "Name of the place of each scan; empty without names.")
      .def_rw("listed", &Trajectory::listed,
              "ListedPairs that replace positions as ground truth, or None.");
  module.def(
      "make_trajectory", nb::overload_cast<const Dataset&>(&make_trajectory), "dataset"_a,
      "Returns the trajectory of a data set. Raises InputError for positions that are not finite.");
  nb::class_<Protocol>(module, "Protocol", "A named evaluation.")
      .def_ro("name", &Protocol::name, "Name for make_tasks().")
      .def_ro("definition", &Protocol::definition,
              "Which scans are compared, and which matches are correct.")
      .def_ro("source", &Protocol::source, "Publication.");
  module.def("protocols", &protocols, nb::rv_policy::copy,
             "Returns the protocols that make_tasks() accepts.");
  nb::class_<Task>(module, "Task", "Database scans, query scans and the rule for correct matches.")
      .def_ro("name", &Task::name, "Name, e.g. 'paper-easy'.")
      .def_ro("definition", &Task::definition, "Rule for correct matches, for display.")
      .def_ro("population", &Task::population, "Database and queries, for display.")
      .def_ro("database", &Task::stored, "Rows of the data set that may be matched.")
      .def_prop_ro(
          "queries",
          [](const Task& task) {
            std::vector<int64_t> rows;
            for (const TaskQuery& query : task.queries) rows.push_back(query.scan);
            return rows;
          },
          "Rows of the data set that are queries.")
      .def(
          "candidates",
          [](const Task& task, size_t query) {
            if (query >= task.queries.size()) throw nb::index_error("no such query");
            std::vector<int64_t> rows;
            for (const CandidateRange& range : task.queries[query].candidates)
              for (int64_t i = range.begin; i < range.end; ++i)
                rows.push_back(task.stored[static_cast<size_t>(i)]);
            return rows;
          },
          "query"_a,
          "Rows that the query with this index in `queries` may match. Raises IndexError.")
      .def_prop_rw(
          "radius", [](const Task& task) { return task.rule.radius; },
          [](Task& task, double radius) { task.rule.radius = radius; },
          "A match nearer than this is correct [m].")
      .def_prop_rw(
          "distance", [](const Task& task) { return name_of(task.rule.distance); },
          [](Task& task, const std::string& text) { task.rule.distance = parse_distance(text); },
          "'xy', 'xz', '3d', 'box', 'place' or 'pairs'.")
      .def_prop_ro(
          "exclusion", [](const Task& task) { return to_string(task.exclusion); },
          "Temporal neighbors that are not compared, as make_tasks() takes it.")
      .def_prop_ro(
          "decides_on_pairs", [](const Task& task) { return task.decides_on_pairs; },
          "The task accepts pairs of scans instead of the best match per query; use "
          "evaluate_pairs().")
      .def_prop_ro(
          "missed", [](const Task& task) { return task.rejected_only ? "rejected" : "not-found"; },
          "Definition of false negatives, as precision_recall() takes it.")
      .def_prop_ro(
          "score",
          [](const Task& task) {
            return name_of(task.margin_score ? Score::kMargin : Score::kSimilarity);
          },
          "Score of the protocol: 'margin' or 'similarity'.");
  module.def(
      "make_tasks",
      [](const std::string& protocol, const std::string& sequence, const Trajectory& trajectory,
         const std::optional<std::string>& exclusion) {
        return make_tasks(protocol, sequence, trajectory,
                          exclusion ? std::optional(parse_exclusion(*exclusion)) : std::nullopt);
      },
      "protocol"_a, "sequence"_a, "trajectory"_a, "exclusion"_a = nb::none(),
      "Returns the tasks of a protocol on a sequence.\n\n"
      "exclusion: 'frames=50', 'seconds=30', 'meters=50' or 'none', instead of the protocol's.\n"
      "Raises UsageError if the protocol does not apply to the data set.");
  module.def(
      "blocks_of",
      [](const Task& task, const Trajectory& trajectory, const std::optional<std::string>& length) {
        return blocks_of(task, trajectory, block_length(length));
      },
      "task"_a, "trajectory"_a, "length"_a = nb::none(),
      "Returns the block of each query, for bootstrap().\n\n"
      "length: 'meters=100' of the path (default with positions), 'frames=50' (default without), "
      "'seconds=10', or 'none' for one query per block. With named places, each is one block. "
      "Raises UsageError without the times or poses that `length` needs.");
}

void bind_matching(nb::module_& module) {
  nb::class_<Match>(module, "Match", "Ranked matches of one query.")
      .def(
          "__init__",
          [](Match* self, int64_t query, std::vector<int64_t> ranks, double score) {
            new (self) Match{query, std::move(ranks), {}, score};
          },
          "query"_a, "ranks"_a, "score"_a, "ranks: rows, best first.")
      .def_ro("query", &Match::query, "Row of the data set.")
      .def_ro("ranks", &Match::ranks, "Rows, best first.")
      .def_ro("similarities", &Match::similarities,
              "Similarities of `ranks`, descending; empty for matches of your own.")
      .def_ro("score", &Match::score, "Score that thresholds are compared with.");
  module.def(
      "retrieve",
      [](GivenFloats array, const Task& task, int k, const std::optional<std::string>& score,
         int threads) {
        const Descriptors descriptors = descriptors_from(array);
        const Score chosen =
            score ? parse_score(*score) : (task.margin_score ? Score::kMargin : Score::kSimilarity);
        Listener listener;
        return listener.run([&] {
          return retrieve(descriptors, task,
                          {k, chosen, threads, {}, [&] { return listener.stop(); }});
        });
      },
      "descriptors"_a, "task"_a, nb::kw_only(), "k"_a = SearchOptions().k, "score"_a = nb::none(),
      "threads"_a = 1,
      "Returns a Match per query: the k database scans most similar to it, by cosine.\n\n"
      "descriptors: float32 [scans of the data set][dimensions].\n"
      "score: 'margin' (2 c1 - ck) or 'similarity' (c1); None: the protocol's.\n"
      "Raises ValueError for another number of rows, Error for values that are not finite.");
  module.def(
      "label_matches",
      [](const std::vector<Match>& matches, const Task& task, const Trajectory& trajectory) {
        return label_matches(matches, task, trajectory, task.rule);
      },
      "matches"_a, "task"_a, "trajectory"_a,
      "Compares matches, in the order of task.queries, with the ground truth: one MatchLabel "
      "each. Raises Error for matches of another task.");
  nb::class_<TaskResult>(module, "PairResult", "Result of evaluate_pairs().")
      .def_ro("summary", &TaskResult::summary, "Metrics over the pairs.")
      .def_ro("intervals", &TaskResult::intervals, "95 % intervals; None without resamples.")
      .def_prop_ro(
          "curve", [](const TaskResult& result) { return columns_of(result.curve); },
          "Same columns as precision_recall(), thinned to about 1000 points.");
  module.def(
      "evaluate_pairs",
      [](GivenFloats array, const Task& task, const Trajectory& trajectory, int resamples,
         const std::optional<std::string>& block, int threads) {
        const Descriptors descriptors = descriptors_from(array);
        Listener listener;
        return listener.run([&] {
          BootstrapOptions options{
              .resamples = resamples, .threads = threads, .stop = [&] { return listener.stop(); }};
          if (resamples > 0) options.blocks = blocks_of(task, trajectory, block_length(block));
          return evaluate_pairs(task, trajectory, descriptors, options);
        });
      },
      "descriptors"_a, "task"_a, "trajectory"_a, nb::kw_only(), "resamples"_a = 0,
      "block"_a = nb::none(), "threads"_a = 1,
      "Evaluates a task that accepts or rejects each pair of a query and a candidate.\n\n"
      "descriptors: float32 [scans of the data set][dimensions].\n"
      "resamples: of the bootstrap; 0: no intervals. block: length of its blocks, see "
      "blocks_of().\n"
      "Raises UsageError for a task that decides per query, or more than 2^27 pairs.");
}

}  // namespace

void bind_evaluation(nb::module_& module) {
  bind_labels(module);
  bind_pairs(module);
  bind_tasks(module);
  bind_matching(module);
}

}  // namespace revisit::python
