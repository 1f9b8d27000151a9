#include "eval_options.h"

#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <iostream>

#include "cli/shell.h"
#include "eval/plan.h"
#include "loops/recording.h"
#include "revisit/base/error.h"
#include "revisit/base/files.h"
#include "revisit/base/text.h"
#include "revisit/loops/loop_detector.h"
#include "revisit/recognition/match.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

constexpr int kMaxResamples = 1'000'000;
constexpr const char* kStandard = "standard";

void read_all(const std::vector<std::string>& files, const Dataset& dataset, int near,
              ListedPairs::Places& pairs) {
  for (const std::string& file : files)
    for (const auto& [query, places] : read_pairs(file, dataset, near))
      pairs[query].insert(places.begin(), places.end());
}

std::vector<Protocol> all_protocols() {
  std::vector<Protocol> all = protocols();
  all.insert(all.begin(),
             {kDrivingOrder,
              "each scan is a query against the places stored before it, ranked and accepted as in "
              "`revisit loops`; nothing is estimated from later scans",
              "the default; 5 m, horizontal; matches up to twice the radius are ignored"});
  return all;
}

void print_protocols() {
  for (const Protocol& protocol : all_protocols())
    std::cout << protocol.name << "\n    " << wrapped(protocol.definition + ".", 4, 4) << "    "
              << wrapped("(" + protocol.source + ")", 4, 4);
}

/// The rows of a copy.
class EvalRows {
 public:
  explicit EvalRows(const EvalOptions& options) : copy_(options) { copy_.declare(rows_); }
  const Row& row(const std::string& name) const { return rows_.row(name); }
  /// In the order of the rows; "" for absent ones, and for those without effect.
  std::vector<std::pair<std::string, std::string>> settings() const {
    auto settings = rows_.settings();
    const auto is_absent = [this](const std::string& name) { return row(name).text().empty(); };
    for (auto& [name, value] : settings)
      if (!row(name).belongs_to(copy_.feature.feature) ||
          std::ranges::any_of(row(name).needed, is_absent))
        value.clear();
    return settings;
  }

 private:
  EvalOptions copy_;
  Options rows_{"revisit eval"};
};

[[noreturn]] void fail(const fs::path& file, const YAML::Mark& mark, const std::string& reason) {
  throw InputError(file.string(), ":", mark.line + 1, ":", mark.column + 1, ": ", reason);
}

}  // namespace

void TruthOptions::declare(Options& options) {
  poses.declare(options);
  options.group("Pairs:")
      .option("pairs", "FILE[,...]",
              "ground truth without poses: lines `query,place`, by frame or file name "
              "(first/000032 if DATA has folders, which are one recording in the order of their "
              "names); an empty place: no correct match. Other pairs are incorrect. Also near=N: "
              "tolerance in frames around a listed place; complete: no correct match for queries "
              "that are not listed, which else are no queries; ignore=FILE: pairs that are neither "
              "correct nor incorrect",
              &pairs)
      .excludes({"distance", "radius", "negative-radius"});
}

Dataset TruthOptions::open(const FeatureOptions& data, bool needs_poses) const {
  Dataset dataset = open_scans(data, needs_poses && !has_own());
  if (!poses.file.empty()) {
    dataset.scans = poses.scans_of(dataset);
    dataset.camera_axes = *poses.of_camera;
  }
  return dataset;
}

std::optional<ListedPairs> TruthOptions::listed(const FeatureOptions& data) const {
  if (pairs.empty()) return std::nullopt;
  FeatureOptions all = data;
  all.every = 1;
  const Dataset whole =
      is_recording(data.data) ? headers_of(all) : open_dataset(data.data, data.sequence);
  const std::string ignore = "ignore=", near_key = "near=";
  ListedPairs listed;
  int near = 0;
  std::vector<std::string> correct, ignored;
  for (const std::string& part : comma_separated(pairs)) {
    if (part == "complete")
      listed.complete = true;
    else if (part.starts_with(near_key))
      near = parse_value<int>("--pairs near", part.substr(near_key.size()));
    else if (part.starts_with(ignore))
      ignored.push_back(part.substr(ignore.size()));
    else
      correct.push_back(part);
  }
  if (near < 0) throw UsageError("--pairs near: expected at least 0 frames, found ", near);
  if (correct.empty()) throw UsageError("--pairs: expected a file, found '", pairs, "'");
  read_all(correct, whole, near, listed.correct);
  read_all(ignored, whole, near, listed.ignored);
  return listed;
}

std::map<std::string, std::string> settings_of(const EvalOptions& options) {
  std::map<std::string, std::string> settings;
  for (const auto& [name, value] : EvalRows(options).settings())
    if (!value.empty()) settings[name] = value;
  return settings;
}

std::string command_of(const EvalOptions& o) {
  EvalOptions standard;
  standard.feature.feature = o.feature.feature;
  const EvalRows rows(o);
  const auto settings = rows.settings(), defaults = EvalRows(standard).settings();
  Arguments arguments = {fs::absolute(o.feature.data).string()};
  for (size_t i = 0; i < settings.size(); ++i) {
    const auto& [name, value] = settings[i];
    if (settings[i] == defaults[i] &&
        !(name == "feature" && o.feature.feature != FeatureOptions().feature))
      continue;
    arguments.push_back("--" + name);
    if (!rows.row(name).is_flag()) arguments.push_back(value);
  }
  return shell_command("revisit eval", arguments);
}

std::vector<Perturbation> parse_perturbations(const std::string& list) {
  if (list == kStandard) return standard_perturbations();
  std::vector<Perturbation> perturbations;
  for (const std::string& text : comma_separated(list)) {
    perturbations.push_back(parse_perturbation(text));
    const std::string name = text_of(perturbations.back());
    if (std::ranges::count(perturbations, name, text_of) > 1)
      throw UsageError("--perturb: ", name, " is given twice");
  }
  return perturbations;
}

void EvalOptions::declare_evaluation(Options& options) {
  std::vector<std::string> names = protocol_names();
  names.insert(names.begin(), kDrivingOrder);
  options.group("Evaluation:")
      .option("protocol", "NAME[,NAME]|list",
              "stored scans, queries and correct matches: " + joined(names, ", ") +
                  "; list: their definitions (default " + kDrivingOrder + ")",
              &protocol)
      .suggest(names)
      .listed_by(print_protocols)
      .common()
      .choice("query-case", {"protocol", "1", "2", "both"},
              "alignment cases of queries; stored scans have case 1 (default protocol: both in "
              "paper-difficult, else 1)",
              &query_case)
      .option("score", "margin|distinct-margin|similarity",
              "score of a match: 2 c1 - ck, or c1, the similarity of the best; in driving order "
              "without registration (default: the protocol's; similarity for fabmap)",
              &score)
      .option("k", "K", "retrieved scans per query (default 4)", &k)
      .option("distance", "xy|xz|3d|box|place",
              "distance of a query to its match (default: the protocol's)", &distance)
      .option("radius", "METERS", "maximum distance of a correct match (default: the protocol's)",
              &radius)
      .positive()
      .common()
      .option("negative-radius", "METERS",
              "minimum distance of an incorrect match; matches in between are ignored (default: "
              "the protocol's; twice the radius in driving order)",
              &negative_radius)
      .option("exclusion", "KIND=N",
              "temporal neighbors that are not compared: meters=30, frames=50, seconds=30 or "
              "none; unused if the protocol stores fixed scans (default: the protocol's)",
              &exclusion)
      .common()
      .option("bootstrap", "N[,KIND=N]",
              "block resamples for 95 % confidence intervals, 0: none; length of a block: "
              "meters=100, frames=50, seconds=10, or none, which makes intervals too narrow "
              "(default 1000,meters=100 driven, or frames=50 without poses)",
              &bootstrap);
}

void EvalOptions::declare_driving_order(Options& options) {
  options.group("Driving order:")
      .option("keyframes", "RULE",
              "stored scans: all, meters=1 or similarity=0.9; all are queries (default all)",
              &keyframes)
      .option("odometry-gate", "BASE,RATE,HEIGHT",
              "the poses reject loops, too, as in `revisit loops` (default none: they only "
              "evaluate)",
              &odometry_gate)
      .option("warmup", "N",
              "distinct map entries that the map mean or PCA is estimated from (default 128)",
              &warmup);
  feature.declare_local_map(options);
}

void EvalOptions::declare_perturbed(Options& options) {
  options.group("Perturbed queries:")
      .option("perturb", "STEP[+STEP...][,...]",
              "queries are perturbed scans, compared with all unperturbed ones, e.g. turn, pitch=5 "
              "or keep=0.2+sector=60; standard: a set of 19; docs/reference/EVALUATION.md has all",
              &perturb)
      .excludes({"protocol", "score", "k", "bootstrap", "keyframes", "warmup", "local-map",
                 "odometry-gate"})
      .common()
      .option("seed", "N", "seed of the perturbations (default 0)", &seed)
      .needs("perturb")
      .option("queries", "N", "scans that are perturbed, evenly spaced; 0: all (default 200)",
              &queries)
      .needs("perturb")
      .at_least(0)
      .option("distractors", "DIR[,DIR]",
              "drives or folders of other places by the same sensor, stored, too (default: none)",
              &distractors)
      .needs("perturb");
}

void EvalOptions::declare_output(Options& options) {
  options.group("Output:", false)
      .option("plan", "NAME[,NAME]|FILE|list",
              "runs of experiments on the sequences of DATA: paper (all of the paper's), one of "
              "them, or a plan file; --model is then a folder of networks; list: their names",
              &plan)
      .listed_by([] { print_plans(std::cout); })
      .excludes({"perturb", "ground-truth", "descriptors"})
      .common()
      .option("ground-truth", "FILE",
              "only the ground truth: query, match and distance of each correct pair, for --pairs",
              &ground_truth)
      .excludes({"perturb", "descriptors"})
      .option("descriptors", "DIR",
              "only the descriptors of all scans: descriptors.npy [scans][K], scans.csv, run.json "
              "and pca (for --fit-on)",
              &descriptors)
      .excludes({"perturb"})
      .option("output", "DIR",
              "parent of the results DIR/<data>_<sequence>/<time>/ (default results)", &output, 'o')
      .common()
      .format({"table", "json"}, &format)
      .common()
      .flag("no-report", "no report.html in the folder of the results", &no_report);
}

void EvalOptions::declare(Options& options) {
  feature.declare(options);
  declare_evaluation(options);
  declare_driving_order(options);
  declare_perturbed(options);
  truth.declare(options);
  declare_output(options);
  options.config(read_config_file).check([this, &options] { check(options); });
}

int EvalOptions::resamples() const {
  const int n = parse_value<int>("--bootstrap", bootstrap.substr(0, bootstrap.find(',')));
  if (n < 0 || n > kMaxResamples)
    throw UsageError("--bootstrap: expected 0 to ", kMaxResamples, " resamples, found ", n);
  return n;
}

std::string EvalOptions::block() const {
  const size_t comma = bootstrap.find(',');
  return comma == std::string::npos ? "" : bootstrap.substr(comma + 1);
}

void EvalOptions::check(const Options& options) const {
  const bool drives = in_driving_order() && plan.empty() && ground_truth.empty();
  for (const char* option : {"keyframes", "warmup", "local-map", "odometry-gate"})
    if (!drives && options.given(option))
      throw UsageError("--", option, ": belongs to the protocol ", kDrivingOrder);
  if (in_driving_order() && options.given("query-case"))
    throw UsageError("--query-case: not in driving order, which queries each scan once");
  if (std::ranges::count(comma_separated(protocol), kDrivingOrder) && protocol != kDrivingOrder)
    throw UsageError("--protocol: driving-order is evaluated alone, found ", protocol);
  if (!perturb.empty()) parse_perturbations(perturb);
  if (!perturb.empty() && query_case == "2")
    throw UsageError("--query-case 2: perturbed queries have case 1 or both");
  check_keyframes(keyframes);
  parse_odometry_gate(odometry_gate);
  if (score) parse_score(*score);
  resamples();
  if (!block().empty()) parse_exclusion(block(), "block");
  if (negative_radius && !(*negative_radius >= radius.value_or(0)))
    throw UsageError("--negative-radius: expected at least the radius, found ", *negative_radius);
  if (plan.empty()) return;
  for (const Row& row : options.rows())
    if (row.is_setting && row.name != "every" && row.name != "model" && row.name != "geometry" &&
        options.given(row.name))
      throw UsageError(row.spelled(), ": not with --plan, whose runs have their own options");
}

EvalOptions parse_eval_options(const Arguments& arguments) {
  EvalOptions eval;
  Options options("revisit eval");
  eval.declare(options);
  options.parse(arguments);
  return eval;
}

std::vector<std::pair<std::string, std::string>> read_config_file(const fs::path& file) {
  YAML::Node root;
  try {
    root = YAML::Load(read_content(file));
  } catch (const YAML::ParserException& error) {
    fail(file, error.mark, error.msg);
  }
  std::vector<std::pair<std::string, std::string>> values;
  if (root.IsNull()) return values;
  if (!root.IsMap()) fail(file, root.Mark(), "expected a map of option names and values");
  if (root["configuration"].IsMap()) root = root["configuration"];  // of run.json
  for (const auto& entry : root) {
    if (!entry.first.IsScalar()) fail(file, entry.first.Mark(), "expected an option's name");
    const std::string& name = entry.first.Scalar();
    const YAML::Node& value = entry.second;
    if (value.IsScalar()) {
      values.emplace_back(name, value.Scalar());
    } else if (value.IsSequence()) {
      for (const YAML::Node& item : value) {
        if (!item.IsScalar()) fail(file, item.Mark(), "expected a value for '" + name + "'");
        values.emplace_back(name, item.Scalar());
      }
    } else if (!value.IsNull()) {
      fail(file, value.Mark(), "expected a value or a list of values for '" + name + "'");
    }
  }
  return values;
}

}  // namespace revisit::cli
