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

RobustnessCommand parse_robustness(const Arguments& arguments) {
  RobustnessCommand o;
  std::vector<std::string> perturbations;
  std::string distance = "xz", exclusion, query_case = "1";
  double radius = o.options.rule.radius, other_beyond = 0;
  o.options.queries = 200;
  Parser parser(
      "revisit robustness", "DATA",
      "Evaluates features on perturbed scans: tilted, from another height, partly hidden, with "
      "fewer beams, in rain. "
      "Scans of DATA (a drive with poses or --pairs) are perturbed and compared with all "
      "unperturbed scans. `self`: "
      "rate of queries whose best match is their original. `neighbor`: rate whose best match "
      "without "
      "the original is "
      "within --radius. `ratio`: median similarity of the best such neighbor over that of the "
      "best scan of another "
      "place; a `minimum` below 1 means that a scan resembles another place more. Recall@1 and AP "
      "are those of "
      "`revisit eval`. If interrupted, run the same command again to resume.",
      "  revisit robustness KITTI --sequence 00 --feature ring,scan-context\n"
      "  revisit robustness drive --distractors elsewhere --perturb pitch=8 --perturb "
      "range=20+rain=0.2\n"
      "  revisit robustness KITTI --sequence 00 --exclusion frames=50 --negative-radius 20\n"
      "  revisit robustness laps --pairs loops.csv --pairs-near 2 --queries 0\n"
      "  revisit robustness drive --ring old.ring --label old -o results/rings\n"
      "  revisit report results/rings -o rings.html     # all features in one table\n");
  o.feature.declare(parser);
  parser.group("Perturbations:");
  parser.option("perturb", "STEP[+STEP...]",
                "perturbation of scans, repeatable: turn (random yaw) or turn=DEG, roll=DEG, "
                "pitch=DEG, height=M (a "
                "lower sensor), keep=FRACTION (of the points), beams=N (every Nth), sector=DEG "
                "(hidden, at a random "
                "azimuth), truck (beside the sensor), noise=M, range=M, rain=FRACTION (returns "
                "from 0.5 to 10 m), or "
                "none (default: " +
                    joined(standard_perturbations(), " ", text_of) + ")",
                &perturbations);
  parser.option("seed", "N", "seed of the perturbations (default 0)", &o.options.seed);
  parser.option("queries", "N", "scans that are perturbed, evenly spaced; 0: all (default 200)",
                &o.options.queries);
  parser.group("Ground truth:");
  parser.option("distractors", "DIR",
                "drive or folder of other places by the same sensor, repeatable (default: none)",
                &o.among);
  parser.option("radius", "METERS", "maximum distance of scans of one place (default 5)", &radius);
  parser.option("negative-radius", "METERS",
                "minimum distance of scans of different places; scans in between are ignored "
                "(default: the radius)",
                &other_beyond);
  parser.option("distance", "xz|3d|box|place", "distance of two scans (default xz, horizontal)",
                &distance);
  parser.option("exclusion", "KIND=N",
                "temporal neighbors that are no match: frames=50, seconds=30, metres=50 or none "
                "(default none: only "
                "the original is excluded; frames=50 with --pairs)",
                &exclusion);
  parser.choice("query-case", {"1", "both"},
                "alignment cases of perturbed scans, for aligned features (default 1)",
                &query_case);
  o.truth.declare(parser);
  parser.group("Output:");
  parser.option("output", "DIR",
                "parent of the results DIR/<data>_<sequence>/<time>/ (default results)", &o.output,
                'o');
  parser.option("label", "TEXT", "name of the feature in tables (default: its name)", &o.label);
  parser.choice("format", {"table", "json", "csv"}, "format of standard output (default table)",
                &o.format);
  parser.flag("no-report", "no report.html in the folder of the results", &o.no_report);
  parser.common({"sequence", "every", "feature", "perturb", "queries", "distractors", "radius",
                 "exclusion", "poses", "pose-frame", "pairs", "output", "label", "format",
                 "threads", "quiet"});
  parser.parse(arguments);

  o.truth.check(parser);
  o.feature.choose_feature(parser);
  o.features = parse_features(o.feature.feature);
  FeatureOptions::check_given(parser, o.features);
  if (!o.label.empty() && o.features.size() > 1)
    throw UsageError("--label: not with several features; run one after the other");
  o.options.perturbations = parse_perturbations(perturbations);
  if (o.options.queries < 0)
    throw UsageError("--queries: expected at least 0, found ", o.options.queries);
  if (!(radius > 0)) throw UsageError("--radius: expected a positive number, found ", radius);
  if (!(other_beyond >= 0) || (parser.given("negative-radius") && other_beyond < radius))
    throw UsageError("--negative-radius: expected at least the radius, ", radius, ", found ",
                     other_beyond);
  o.options.rule = {parse_distance(distance), radius, other_beyond};
  if (!exclusion.empty())
    o.options.exclusion = parse_exclusion(exclusion);
  else if (!o.truth.pairs.empty())
    o.options.exclusion = Exclusion();
  o.options.both_cases = query_case == "both";
  o.options.threads = o.feature.thread_count();
  return o;
}

}  // namespace revisit::cli
