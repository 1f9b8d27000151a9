#include "robustness/robustness_options.h"

#include <algorithm>

namespace revisit::cli {
namespace {

std::vector<std::string> parse_features(const std::string& list) {
  const std::vector<std::string> names = feature_names();
  std::vector<std::string> features;
  for (const std::string& word : comma_separated(list)) {
    if (std::ranges::find(names, word) == names.end())
      throw UsageError("--feature: unknown feature '", word, "'", nearest_name_hint(word, names),
                       "; known: ", joined(names, ", "));
    if (std::ranges::find(features, word) != features.end())
      throw UsageError("--feature: ", word, " is given twice");
    features.push_back(word);
  }
  if (features.empty()) throw UsageError("--feature: expected a name, found ''");
  return features;
}

std::vector<Perturbation> parse_perturbations(const std::vector<std::string>& texts) {
  std::vector<Perturbation> perturbations;
  for (const std::string& text : texts) {
    perturbations.push_back(parse_perturbation(text));
    const std::string name = text_of(perturbations.back());
    if (std::ranges::count(perturbations, name, text_of) > 1)
      throw UsageError("--perturb: ", name, " is given twice");
  }
  return perturbations.empty() ? standard_perturbations() : perturbations;
}

}  // namespace

void RobustnessRun::declare(Options& options) {
  evaluation.queries = 200;
  feature.declare(options, Scans::kOfDrives, true);
  options.group("Perturbations:");
  options
      .option("perturb", "STEP[+STEP...]",
              "perturbation of scans, repeatable: turn (random yaw) or turn=DEG, roll=DEG, "
              "pitch=DEG, height=M (a "
              "lower sensor), keep=FRACTION (of the points), beams=N (every Nth), sector=DEG "
              "(hidden, at a random "
              "azimuth), truck (beside the sensor), noise=M, range=M, rain=FRACTION (returns "
              "from 0.5 to 10 m), or "
              "none (default: " +
                  joined(standard_perturbations(), " ", text_of) + ")",
              &perturbations_)
      .common();
  options.option("seed", "N", "seed of the perturbations (default 0)", &evaluation.seed);
  options
      .option("queries", "N", "scans that are perturbed, evenly spaced; 0: all (default 200)",
              &evaluation.queries)
      .at_least(0)
      .common();
  options.group("Ground truth:");
  options
      .option("distractors", "DIR",
              "drive or folder of other places by the same sensor, repeatable (default: none)",
              &among)
      .common();
  options
      .option("radius", "METERS", "maximum distance of scans of one place (default 5)",
              &evaluation.rule.radius)
      .positive()
      .common();
  options.option("negative-radius", "METERS",
                 "minimum distance of scans of different places; scans in between are ignored "
                 "(default: the radius)",
                 &evaluation.rule.false_beyond);
  options.option("distance", "xz|3d|box|place", "distance of two scans (default xz, horizontal)",
                 &distance_);
  options
      .option("exclusion", "KIND=N",
              "temporal neighbors that are no match: frames=50, seconds=30, meters=50 or none "
              "(default none: only "
              "the original is excluded; frames=50 with --pairs)",
              &exclusion_)
      .common();
  options.choice("query-case", {"1", "both"},
                 "alignment cases of perturbed scans, for aligned features (default 1)",
                 &query_case_);
  truth.declare(options);
  options.group("Output:", false);
  options
      .option("output", "DIR",
              "parent of the results DIR/<data>_<sequence>/<time>/ (default results)", &output, 'o')
      .common();
  options.option("label", "TEXT", "name of the feature in tables (default: its name)", &label)
      .common();
  options
      .choice("format", {"table", "json", "csv"}, "format of standard output (default table)",
              &format)
      .common();
  options.flag("no-report", "no report.html in the folder of the results", &no_report);
  options.check([this, &options] {
    if (options.given("negative-radius") && evaluation.rule.false_beyond < evaluation.rule.radius)
      throw UsageError("--negative-radius: expected at least the radius, ", evaluation.rule.radius,
                       ", found ", evaluation.rule.false_beyond);
    finish();
  });
}

void RobustnessRun::finish() {
  features = parse_features(feature.feature);
  if (!label.empty() && features.size() > 1)
    throw UsageError("--label: not with several features; run one after the other");
  evaluation.perturbations = parse_perturbations(perturbations_);
  evaluation.rule.distance = parse_distance(distance_);
  if (!exclusion_.empty())
    evaluation.exclusion = parse_exclusion(exclusion_);
  else if (!truth.pairs.empty())
    evaluation.exclusion = Exclusion();
  evaluation.both_cases = query_case_ == "both";
  evaluation.threads = feature.thread_count();
}

}  // namespace revisit::cli
