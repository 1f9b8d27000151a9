#include "eval_options.h"

#include <iostream>

#include "cli/shell.h"
#include "eval/config_file.h"
#include "eval/summary_table.h"
#include "revisit/base/text.h"
#include "revisit/evaluation/protocols.h"
#include "revisit/loops/loop_detector.h"
#include "revisit/recognition/match.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

constexpr int kMaxResamples = 1'000'000;

/// The rows of a copy.
class EvalRows {
 public:
  explicit EvalRows(const EvalOptions& options) : copy_(options) { copy_.declare(rows_); }
  const Row& row(const std::string& name) const { return rows_.row(name); }
  std::vector<std::pair<std::string, std::string>> settings() const {
    auto settings = rows_.settings();
    for (auto& [name, value] : settings)
      if (!row(name).belongs_to(copy_.feature.feature)) value.clear();
    return settings;
  }

 private:
  EvalOptions copy_;
  Options rows_{"revisit eval"};
};

}  // namespace

std::vector<std::pair<std::string, std::string>> settings_of(const EvalOptions& options) {
  return EvalRows(options).settings();
}

std::string command_of(const EvalOptions& o) {
  EvalOptions standard;
  standard.feature.feature = o.feature.feature;
  const EvalRows rows(o);
  const auto settings = rows.settings(), defaults = settings_of(standard);
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

void EvalOptions::declare(Options& options) {
  feature.declare(options);
  options.group("Evaluation:");
  options
      .option("protocol", "NAME[,NAME]|list",
              "stored scans, queries and true matches: " + joined(protocol_names(), ", ") +
                  "; list: their definitions (default online)",
              &protocol)
      .suggest(protocol_names())
      .listed_by([this] { (format == "json" ? print_protocols_json : print_protocols)(std::cout); })
      .common();
  options
      .choice("query-case", {"protocol", "1", "2", "both"},
              "alignment cases of queries; stored scans have case 1 (default protocol: both in "
              "paper-difficult, "
              "else 1)",
              &query_case)
      .excludes({"causal"});
  options.option("score", "margin|distinct-margin|similarity",
                 "score of a match: 2 c1 - ck, or c1, the similarity of the best (default: the "
                 "protocol's; similarity "
                 "for fabmap)",
                 &score);
  options.option("k", "K", "retrieved scans per query (default 4)", &k);
  options.option("distance", "xz|3d|box|place",
                 "distance of a query to its match (default: the protocol's)", &distance);
  options
      .option("radius", "METERS", "maximum distance of a true match (default: the protocol's)",
              &radius)
      .positive()
      .common();
  options.option("negative-radius", "METERS",
                 "minimum distance of a false match; matches in between are ignored (default: the "
                 "protocol's; twice "
                 "the radius with --causal)",
                 &other_beyond);
  options
      .option("exclusion", "KIND=N",
              "temporal neighbors that are not compared: frames=50, seconds=30, meters=50 or "
              "none; unused if the "
              "protocol stores fixed scans (default: the protocol's)",
              &exclusion)
      .common();
  options
      .option("bootstrap", "N",
              "block resamples for 95 % confidence intervals; 0: none (default 1000)", &resamples)
      .between(0, kMaxResamples);
  options.option("block", "KIND=N",
                 "length of a block: meters=100, frames=50, seconds=10, or none, which makes "
                 "intervals too narrow "
                 "(default meters=100 driven, or frames=50 without poses)",
                 &block);
  options.group("Causal:");
  options
      .flag("causal",
            "each scan as a query against the scans before it, ranked and accepted as in "
            "`revisit loops`; nothing "
            "is estimated from later scans",
            &causal)
      .common();
  options
      .option("keyframes", "RULE",
              "stored scans: all, meters=1 or similarity=0.9; all are queries (default all)",
              &keyframes)
      .needs("causal")
      .common();
  options
      .option("warmup", "N",
              "distinct map entries that the map mean or PCA is estimated from (default 128)",
              &warmup)
      .needs("causal");
  options.flag("no-verify", "no registration of accepted loops", &no_verify).needs("causal");
  truth.declare(options);
  options.group("Output:", false);
  options
      .option("output", "DIR",
              "parent of the results DIR/<data>_<sequence>/<time>/ (default results)", &output, 'o')
      .common();
  options.choice("format", {"table", "json"}, "format of standard output (default table)", &format)
      .common();
  options.flag("no-report", "no report.html in the folder of the results", &no_report);
  options.config(read_config_file);
  options.check([this] {
    if (causal) parse_keyframes(keyframes);
    if (causal && protocol != "online")
      throw UsageError("--causal: supports only the protocol online, found --protocol ", protocol);
    if (score) parse_score(*score);
    if (block) parse_exclusion(*block, "block");
    if (other_beyond && !(*other_beyond >= radius.value_or(0)))
      throw UsageError("--negative-radius: expected at least the radius, found ", *other_beyond);
  });
}

}  // namespace revisit::cli
