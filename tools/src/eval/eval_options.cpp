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

constexpr std::string_view kFlags[] = {"causal", "no-verify", "pairs-complete"};

void check_causal(const EvalOptions& o, const Parser& parser) {
  for (const char* option : {"keyframes", "warmup", "no-verify"})
    if (!o.causal && parser.given(option)) throw UsageError("--", option, ": needs --causal");
  if (!o.causal) return;
  parse_keyframes(o.keyframes);
  if (o.protocol != "online")
    throw UsageError("--causal: supports only the protocol online, found --protocol ", o.protocol);
  if (o.query_case != "protocol")
    throw UsageError("--query-case: not with --causal, which queries each scan once");
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
          {"ring-dim", str(f.ring_options.dim)},
          {"ring-blend", exact(f.ring_options.blend)},
          {"images", placed(f.images)},
          {"training-images", placed(f.training_images)},
          {"new-place", f.new_place},
          {"candidates", str(f.ring_key_candidates)},
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
          {"negative-radius", o.other_beyond ? exact(*o.other_beyond) : ""},
          {"block", o.block.value_or("")}});
  append(o.truth.settings());
  if (o.causal)
    append({{"causal", "true"},
            {"no-verify", o.no_verify ? "true" : ""},
            {"keyframes", o.keyframes},
            {"warmup", str(o.warmup)}});
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
  Parser parser(
      "revisit eval", "DATA",
      "Evaluates place recognition against ground truth: describes every scan, retrieves matches, "
      "and "
      "reports precision and recall. DATA is a KITTI odometry folder (`revisit simulate` writes "
      "such), or "
      "any recording with --poses or --pairs. If interrupted, run the same command again to "
      "resume.",
      "  revisit eval KITTI --sequence 00                              # ring descriptors\n"
      "  revisit eval KITTI --sequence 00 --causal --keyframes metres=1   # as `revisit loops` "
      "runs\n"
      "  revisit eval KITTI --sequence 05 --radius 4 --exclusion seconds=30\n"
      "  revisit eval KITTI --sequence 00 --model bvlc_alexnet --end conv3 --graft pool5 "
      "--protocol paper\n"
      "  revisit eval KITTI --sequence 00 --feature scan-context --threads 1\n"
      "  revisit eval laps --causal --pairs loops.csv --pairs-near 2\n");
  o.feature.declare(parser);
  parser.group("Evaluation:");
  parser
      .option("protocol", "NAME[,NAME]|list",
              "stored scans, queries and true matches: " + joined(protocol_names(), ", ") +
                  "; list: their definitions (default online)",
              &o.protocol)
      .suggest(protocol_names());
  parser.choice("query-case", {"protocol", "1", "2", "both"},
                "alignment cases of queries; stored scans have case 1 (default protocol: both in "
                "paper-difficult, "
                "else 1)",
                &o.query_case);
  parser.option("score", "margin|distinct-margin|similarity",
                "score of a match: 2 c1 - ck, or c1, the similarity of the best (default: the "
                "protocol's; similarity "
                "for fabmap)",
                &o.score);
  parser.option("k", "K", "retrieved scans per query (default 4)", &o.k);
  parser.option("distance", "xz|3d|box|place",
                "distance of a query to its match (default: the protocol's)", &o.distance);
  parser.option("radius", "METERS", "maximum distance of a true match (default: the protocol's)",
                &o.radius);
  parser.option("negative-radius", "METERS",
                "minimum distance of a false match; matches in between are ignored (default: the "
                "protocol's; twice "
                "the radius with --causal)",
                &o.other_beyond);
  parser.option("exclusion", "KIND=N",
                "temporal neighbors that are not compared: frames=50, seconds=30, metres=50 or "
                "none; unused if the "
                "protocol stores fixed scans (default: the protocol's)",
                &o.exclusion);
  parser.option("bootstrap", "N",
                "block resamples for 95 % confidence intervals; 0: none (default 1000)",
                &o.resamples);
  parser.option("block", "KIND=N",
                "length of a block: metres=100, frames=50, seconds=10, or none, which makes "
                "intervals too narrow "
                "(default metres=100 driven, or frames=50 without poses)",
                &o.block);
  parser.group("Causal:");
  parser.flag("causal",
              "each scan as a query against the scans before it, ranked and accepted as in "
              "`revisit loops`; nothing "
              "is estimated from later scans",
              &o.causal);
  parser.option("keyframes", "RULE",
                "stored scans: all, metres=1 or similarity=0.9; all are queries (default all)",
                &o.keyframes);
  parser.option("warmup", "N",
                "distinct map entries that the map mean or PCA is estimated from (default 128)",
                &o.warmup);
  parser.flag("no-verify", "no registration of accepted loops", &o.no_verify);
  o.truth.declare(parser);
  parser.group("Output:");
  parser.option("output", "DIR",
                "parent of the results DIR/<data>_<sequence>/<time>/ (default results)", &o.output,
                'o');
  parser.choice("format", {"table", "json"}, "format of standard output (default table)",
                &o.format);
  parser.flag("no-report", "no report.html in the folder of the results", &o.no_report);
  parser.config(read_config_file);
  parser.common({"sequence", "every",     "feature", "model",     "end",   "graft",      "protocol",
                 "radius",   "exclusion", "causal",  "keyframes", "poses", "pose-frame", "pairs",
                 "sensor",   "output",    "format",  "threads",   "cache", "quiet"});
  parser.parse(arguments);
  o.feature.check_given(parser);
  o.truth.check(parser);
  check_causal(o, parser);
  if (o.score) parse_score(*o.score);
  if (o.block) parse_exclusion(*o.block, "block");
  if (o.other_beyond && !(*o.other_beyond >= o.radius.value_or(0)))
    throw UsageError("--negative-radius: expected at least the radius, found ", *o.other_beyond);
  if (o.radius && !(*o.radius > 0))
    throw UsageError("--radius: expected a positive number, found ", *o.radius);
  if (o.resamples < 0 || o.resamples > kMaxResamples)
    throw UsageError("--bootstrap: expected 0 to ", kMaxResamples, " resamples, found ",
                     o.resamples);
  return o;
}

}  // namespace revisit::cli
