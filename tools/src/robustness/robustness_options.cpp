#include "robustness/robustness_options.h"

#include <algorithm>

namespace revisit::cli {
namespace {

std::vector<std::string> parse_features(const std::string& list) {
  const std::vector<std::string> names = feature_names();
  std::vector<std::string> features;
  for (const std::string& word : comma_separated(list)) {
    if (std::ranges::find(names, word) == names.end())
      throw UsageError("--feature: unknown feature '", word, "'", did_you_mean(word, names),
                       "; known: ", joined(names, ", "));
    if (std::ranges::find(features, word) != features.end())
      throw UsageError("--feature: ", word, " is there twice");
    features.push_back(word);
  }
  if (features.empty()) throw UsageError("--feature: expected a name, found ''");
  return features;
}

std::vector<pipeline::Alteration> parse_alterations(const std::vector<std::string>& texts) {
  std::vector<pipeline::Alteration> alterations;
  for (const std::string& text : texts) {
    alterations.push_back(pipeline::parse_alteration(text));
    const std::string name = text_of(alterations.back());
    if (std::ranges::count(alterations, name, pipeline::text_of) > 1)
      throw UsageError("--alter: ", name, " is there twice");
  }
  return alterations.empty() ? pipeline::standard_alterations() : alterations;
}

}  // namespace

RobustnessCommand parse_robustness(const Arguments& arguments) {
  RobustnessCommand o;
  o.feature.feature = "ring";
  std::vector<std::string> alterations;
  std::string distance = "xz", exclusion, query_case = "1";
  double radius = o.asked.rule.radius, other_beyond = 0;
  o.asked.queries = 200;
  Parser parser(
      "revisit robustness", "DATA",
      "How features stand scans that are altered as robots alter them: tilted, seen from another "
      "height, partly hidden, of fewer beams, in rain. Scans of DATA, a drive with poses or "
      "--pairs, are "
      "altered in one way after another and compared with all unaltered ones. `own` are the scans "
      "that find their own original, `near` those that find a scan taken within --radius when "
      "their own original is left out. `ratio` is the similarity of the best such neighbour to "
      "that of the best scan of another place, the median; where `least` is below 1, a scan looks "
      "more like another place. Recall@1 and AP are those of `revisit eval`. Several features "
      "(--feature ring,scan-context) are put side by "
      "side, and so are the results of several commands by `revisit report`. Run the same command "
      "again to continue a stopped run.",
      "  revisit robustness KITTI --sequence 00 --feature ring,scan-context\n"
      "  revisit robustness drive --among elsewhere --alter pitch=8 --alter range=20+rain=0.2\n"
      "  revisit robustness KITTI --sequence 00 --exclusion frames=50 --other-beyond 20\n"
      "  revisit robustness laps --pairs loops.csv --pairs-near 2 --queries 0\n"
      "  revisit robustness drive --ring old.ring --label old -o results/rings\n"
      "  revisit report results/rings -o rings.html     # old and new side by side\n");
  o.feature.declare(parser);
  parser.group("Alterations:");
  parser.option("alter", "STEP[+STEP...]",
                "one way to alter scans, may be repeated: turn (by any yaw) or turn=DEG, roll=DEG, "
                "pitch=DEG, height=M (that the sensor is lower), keep=SHARE (of the points), "
                "beams=N (every Nth), sector=DEG (hidden, at any side), truck (beside), noise=M, "
                "range=M, rain=SHARE (of the returns come from 0.5 to 10 m instead), or none "
                "(default: " +
                    joined(pipeline::standard_alterations(), " ", pipeline::text_of) + ")",
                &alterations);
  parser.option("seed", "N", "of what is random in them (default 0)", &o.asked.seed);
  parser.option("queries", "N",
                "so many scans, evenly through the drive, are altered; 0: all (default 200)",
                &o.asked.queries);
  parser.group("Places:");
  parser.option("among", "DIR",
                "a drive or folder of other places by the same sensor, whose scans may be found, "
                "too; may be repeated",
                &o.among);
  parser.option("radius", "METRES", "a scan nearer than this shows the same place (default 5)",
                &radius);
  parser.option("other-beyond", "METRES",
                "a scan farther than this shows another place; those between are left out "
                "(default: the radius)",
                &other_beyond);
  parser.option("distance", "xz|3d|box|place", "how that is measured (default xz, horizontally)",
                &distance);
  parser.option("exclusion", "KIND=N",
                "neighbours are farther than this from the scan: frames=50, seconds=30, metres=50 "
                "or none (default none: only its own original is left out; with --pairs frames=50)",
                &exclusion);
  parser.choice("query-case", {"1", "both"},
                "the alignment cases that altered scans are described in, where features are "
                "aligned (default 1)",
                &query_case);
  o.truth.declare(parser);
  parser.group("Output:");
  parser.option("output", "DIR", "results go to DIR/<data>_<sequence>/<time>/ (default results)",
                &o.output, 'o');
  parser.option("label", "TEXT", "what the feature is called in tables (default: its name)",
                &o.label);
  parser.choice("format", {"table", "json", "csv"}, "what is printed (default table)", &o.format);
  parser.flag("no-report", "no report.html in the folder of the results", &o.no_report);
  parser.parse(arguments);

  o.truth.check(parser);
  o.features = parse_features(o.feature.feature);
  FeatureOptions::check_given(parser, o.features);
  if (!o.label.empty() && o.features.size() > 1)
    throw UsageError("--label: there are several features; run one after the other");
  o.asked.alterations = parse_alterations(alterations);
  if (o.asked.queries < 0)
    throw UsageError("--queries: expected at least 0, found ", o.asked.queries);
  if (!(radius > 0)) throw UsageError("--radius: expected a positive number, found ", radius);
  if (!(other_beyond >= 0) || (parser.given("other-beyond") && other_beyond < radius))
    throw UsageError("--other-beyond: expected at least the radius, ", radius, ", found ",
                     other_beyond);
  o.asked.rule = {pipeline::parse_distance(distance), radius, other_beyond};
  if (!exclusion.empty())
    o.asked.exclusion = pipeline::parse_exclusion(exclusion);
  else if (!o.truth.pairs.empty())
    o.asked.exclusion = pipeline::Exclusion();
  o.asked.both_cases = query_case == "both";
  o.asked.threads = o.feature.thread_count();
  return o;
}

}  // namespace revisit::cli
