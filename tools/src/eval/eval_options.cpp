#include "eval_options.h"

#include <algorithm>
#include <iterator>
#include <string_view>

#include "cli/shell.h"
#include "eval/config_file.h"
#include "revisit/base/text.h"
#include "revisit/evaluation/protocols.h"
#include "revisit/loops/keyframes.h"
#include "revisit/recognition/match.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

constexpr int kMaxResamples = 1'000'000;

/// Options without a value, of settings "true".
constexpr std::string_view kFlags[] = {"causal", "no-verify", "pairs-complete"};

void check_causal(const EvalOptions& o, const Parser& parser) {
  for (const char* option : {"keyframes", "first-stretch", "no-verify"})
    if (!o.causal && parser.given(option))
      throw UsageError("--", option, " is about --causal, which is not given");
  if (!o.causal) return;
  pipeline::parse_keyframes(o.keyframes);
  if (o.protocol != "online")
    throw UsageError(
        "--causal asks each scan among those before it, as the protocol online; found "
        "--protocol ",
        o.protocol);
  if (o.query_case != "protocol")
    throw UsageError("--causal asks each scan once: leave out --query-case");
}

}  // namespace

std::vector<std::pair<std::string, std::string>> settings_of(const EvalOptions& o) {
  const FeatureOptions& f = o.feature;
  std::vector<std::pair<std::string, std::string>> settings = {{"sequence", f.sequence},
                                                               {"every", str(f.every)}};
  const auto append = [&](const std::vector<std::pair<std::string, std::string>>& more) {
    settings.insert(settings.end(), more.begin(), more.end());
  };
  append(f.image.settings());
  append({{"feature", f.feature},
          {"model", placed(f.model)},
          {"weights", placed(f.weights)},
          {"end", f.end},
          {"graft", f.graft},
          {"mean-bgr", placed(f.mean_bgr)},
          {"input-scale", exact(f.input_scale)},
          {"ring", placed(f.ring)},
          {"ring-numbers", str(f.ring_options.numbers)},
          {"ring-adapt", exact(f.ring_options.adapt)},
          {"images", placed(f.images)},
          {"training-images", placed(f.training_images)},
          {"new-place", f.new_place},
          {"ring-key-candidates", str(f.ring_key_candidates)},
          {"pca", f.pca},
          {"fit-on", f.fit_on == "all" || f.fit_on == "map" ? f.fit_on : placed(f.fit_on)},
          {"memory", exact(f.memory_gb)},
          {"protocol", o.protocol},
          {"align", f.align.value_or("")},
          {"query-case", o.query_case},
          {"score", o.score.value_or("")},
          {"k", str(o.k)},
          {"bootstrap", str(o.resamples)},
          {"distance", o.distance.value_or("")},
          {"exclusion", o.exclusion.value_or("")},
          {"radius", o.radius ? exact(*o.radius) : ""},
          {"other-beyond", o.other_beyond ? exact(*o.other_beyond) : ""},
          {"block", o.block.value_or("")}});
  append(o.truth.settings());
  if (o.causal)
    append({{"causal", "true"},
            {"no-verify", o.no_verify ? "true" : ""},
            {"keyframes", o.keyframes},
            {"first-stretch", str(o.first_stretch)}});
  for (auto& [name, value] : settings)
    if (!f.uses(name)) value.clear();
  return settings;
}

std::string command_of(const EvalOptions& o) {
  EvalOptions standard;
  standard.feature.feature = o.feature.feature;
  standard.causal = o.causal;
  const auto settings = settings_of(o), defaults = settings_of(standard);
  Arguments arguments = {fs::absolute(o.feature.data).string()};
  for (size_t i = 0; i < settings.size(); ++i) {
    const auto& [name, value] = settings[i];
    if (settings[i] == defaults[i] && name != "causal" &&
        !(name == "feature" && o.feature.feature != FeatureOptions().feature))
      continue;
    arguments.push_back("--" + name);
    if (std::ranges::find(kFlags, name) == std::end(kFlags)) arguments.push_back(value);
  }
  return shell_command("revisit eval", arguments);
}

EvalOptions parse_eval_options(const Arguments& arguments) {
  EvalOptions o;
  Parser parser("revisit eval", "DATA",
                "Place recognition with ground truth: describe every scan, retrieve, and measure "
                "precision and recall. DATA is a KITTI odometry folder (or one that `revisit "
                "simulate` wrote), or any recording with --poses or --pairs. Run the same command "
                "again to continue a stopped run.",
                "  revisit eval KITTI --sequence 00 --model bvlc_alexnet --end conv3 "
                "--graft pool5\n"
                "  revisit eval KITTI --sequence 00 --protocol paper\n"
                "  revisit eval KITTI --sequence 05 --radius 4 --exclusion seconds=30\n"
                "  revisit eval KITTI --sequence 00 --feature data   # the range image itself\n"
                "  revisit eval KITTI --sequence 00 --feature scan-context --threads 1\n"
                "  revisit eval KITTI --sequence 00 --feature ring --causal --keyframes metres=1\n"
                "  revisit eval laps --feature ring --causal --pairs loops.csv --pairs-near 2\n");
  o.feature.declare(parser);
  parser.group("Evaluation:");
  parser
      .option("protocol", "NAME[,NAME]|list",
              "which scans are stored and asked, and what is true: " +
                  joined(pipeline::protocol_names(), ", ") +
                  " (default online). 'list' prints their definitions",
              &o.protocol)
      .suggest(pipeline::protocol_names());
  parser.choice("query-case", {"protocol", "1", "2", "both"},
                "the alignment cases queries are described in; stored scans always use case 1 "
                "(default protocol: both in paper-difficult, else 1)",
                &o.query_case);
  parser.option("score", "margin|distinct-margin|similarity",
                "s = 2 c1 - ck, or c1 alone, the similarity of the best (default: the protocol's; "
                "similarity for fabmap, whose similarity is a probability)",
                &o.score);
  parser.option("k", "K", "retrieved scans per query (default 4)", &o.k);
  parser.option("distance", "xz|3d|box|place",
                "how the distance to a true match is measured (default: the protocol's)",
                &o.distance);
  parser.option("radius", "METRES", "a match nearer than this is true (default: the protocol's)",
                &o.radius);
  parser.option("other-beyond", "METRES",
                "a match farther than this is wrong; those between are not counted (default: the "
                "protocol's; twice the radius with --causal)",
                &o.other_beyond);
  parser.option("exclusion", "KIND=N",
                "frames=50, seconds=30, metres=50 or none (default: the protocol's; not used where "
                "fixed scans are stored)",
                &o.exclusion);
  parser.option("bootstrap", "N",
                "95 % confidence intervals from N resamples of blocks of queries; 0: none (default "
                "1000)",
                &o.resamples);
  parser.option("block", "KIND=N",
                "length of a block: metres=100 (driven; default with poses), frames=50 (default "
                "without), seconds=10, or none, which makes intervals too narrow",
                &o.block);
  parser.group("Causal:");
  parser.flag("causal",
              "ask each scan among those before it as `revisit loops` does: nothing is learnt from "
              "later scans, and loops are ranked and accepted as there",
              &o.causal);
  parser.option("keyframes", "RULE",
                "which scans are stored: all (default), metres=1 or similarity=0.9; all are asked",
                &o.keyframes);
  parser.option("first-stretch", "N",
                "rings and PCA: learnt from so many distinct places (default 128)",
                &o.first_stretch);
  parser.flag("no-verify", "do not register loops that the score accepts", &o.no_verify);
  o.truth.declare(parser);
  parser.group("Output:");
  parser.option("output", "DIR", "results go to DIR/<data>_<sequence>/<time>/ (default results)",
                &o.output, 'o');
  parser.choice("format", {"table", "json"}, "what is printed (default table)", &o.format);
  parser.flag("no-report", "no report.html in the folder of the results", &o.no_report);
  parser.config(read_config_file);
  parser.parse(arguments);
  o.feature.check_given(parser);
  o.truth.check(parser);
  check_causal(o, parser);
  if (o.score) pipeline::parse_score(*o.score);
  if (o.block) pipeline::parse_exclusion(*o.block, "block");
  if (o.other_beyond && !(*o.other_beyond >= o.radius.value_or(0)))
    throw UsageError("--other-beyond: expected at least the radius, found ", *o.other_beyond);
  if (o.radius && !(*o.radius > 0))
    throw UsageError("--radius: expected a positive number, found ", *o.radius);
  if (o.resamples < 0 || o.resamples > kMaxResamples)
    throw UsageError("--bootstrap: expected 0 to ", kMaxResamples, " resamples, found ",
                     o.resamples);
  return o;
}

}  // namespace revisit::cli
