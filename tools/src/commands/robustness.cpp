#include <algorithm>
#include <cmath>
#include <iostream>
#include <set>

#include "cli/json.h"
#include "cli/messages.h"
#include "cli/shell.h"
#include "eval/run_folder.h"
#include "report/page.h"
#include "revisit/base/error.h"
#include "revisit/base/files.h"
#include "robustness/robustness_options.h"
#include "robustness/robustness_report.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

std::string label_of(const FeatureSource& source) {
  if (!source.model) return source.extractor.name;
  return source.model->name + " " + source.extractor.name +
         (source.model->trained ? "" : " (UNTRAINED)");
}

reports::RobustnessRow row_report(const RobustnessRow& row) {
  reports::RobustnessRow out;
  out.set_alteration(text_of(row.perturbation));
  out.set_name(name_of(row.perturbation));
  out.set_asked(static_cast<int>(row.n_queries));
  out.set_own(static_cast<int>(row.own));
  out.set_asked_near(static_cast<int>(row.queries_with_neighbor));
  out.set_near(static_cast<int>(row.near));
  if (!std::isnan(row.ratio_median)) out.set_ratio_median(row.ratio_median);
  if (!std::isnan(row.ratio_min)) out.set_ratio_least(row.ratio_min);
  if (!std::isnan(row.recall_at_1)) out.set_recall_at_1(row.recall_at_1);
  if (!std::isnan(row.average_precision)) out.set_average_precision(row.average_precision);
  out.set_not_described(static_cast<int>(row.not_described));
  return out;
}

struct Question {
  Dataset drive;
  std::optional<ListedPairs> listed;
  std::vector<Dataset> among;
};

void need_others(const std::set<fs::path>& drive, const Dataset& others, const fs::path& folder) {
  for (const ScanRef& scan : others.scans)
    if (drive.contains(fs::weakly_canonical(scan.file)))
      throw UsageError("--distractors ", folder.string(), ": ", scan.file.string(),
                       " is a scan of the drive itself; give scans of other places");
}

Question open_question(const RobustnessRun& o) {
  Question q;
  q.drive = o.truth.open(o.feature, o.evaluation.rule.distance != Distance::kPlace);
  q.listed = o.truth.listed(o.feature);
  std::set<fs::path> drive;
  if (!o.among.empty())
    for (const ScanRef& scan : q.drive.scans) drive.insert(fs::weakly_canonical(scan.file));
  for (const fs::path& folder : o.among) {
    q.among.push_back(open_dataset(folder, ""));
    need_others(drive, q.among.back(), folder);
    if (!o.feature.quiet)
      for (const std::string& warning : q.among.back().warnings) warn(warning);
  }
  return q;
}

reports::RobustnessFeature ask(const RobustnessRun& o, const std::string& name,
                               const Question& question, const std::string& command, int& stored,
                               bool& all_described) {
  FeatureOptions options = o.feature;
  options.feature = name;
  const std::string sensor = resolve_sensor(options, question.drive);
  if (!sensor.empty()) options.observer().note("sensor: " + sensor);
  const fs::path cache = options.cache_folder(o.output);
  const FeatureSource source = open_feature(options, question.drive, cache);
  RobustnessOptions how = o.evaluation;
  how.both_cases = how.both_cases && source.align == AlignCase::kOne;
  how.describe = options.describe(source);
  how.reduction = options.reduction(source);
  how.cache = cache;
  how.listed = question.listed;
  const RobustnessResult result =
      robustness(question.drive, question.among, source.extractor, how, options.observer());
  reports::RobustnessFeature out;
  out.set_label(o.label.empty() ? label_of(source) : o.label);
  out.set_feature(name);
  if (source.model) out.set_trained(source.model->trained);
  out.set_numbers(static_cast<double>(result.numbers));
  out.set_command(command);
  for (const RobustnessRow& row : result.rows) *out.add_rows() = row_report(row);
  stored = static_cast<int>(result.stored);
  all_described = all_described && result.skipped.empty();
  return out;
}

reports::Robustness report_of(const RobustnessRun& o, const Options& options,
                              const Question& question) {
  reports::Robustness report;
  report.set_version(REVISIT_VERSION);
  report.set_data(fs::absolute(o.feature.data).string());
  report.set_sequence(question.drive.sequence);
  for (const fs::path& folder : o.among) report.add_among(fs::absolute(folder).string());
  if (question.listed) {
    report.set_distance(name_of(Distance::kPairs));
    for (const Row& row : options.rows())
      if ((row.group == "Poses:" || row.group == "Pairs:") && row.source != Source::kDefault)
        report.add_pairs(str(row.name, "=", row.text()));
  } else {
    report.set_distance(name_of(o.evaluation.rule.distance));
    report.set_radius_m(o.evaluation.rule.radius);
    report.set_other_beyond_m(std::max(o.evaluation.rule.radius, o.evaluation.rule.false_beyond));
  }
  report.set_exclusion(to_string(o.evaluation.exclusion));
  report.set_query_case(o.evaluation.both_cases ? "both" : "1");
  report.set_seed(o.evaluation.seed);
  return report;
}

void print_not_described(const reports::Robustness& report) {
  for (const reports::RobustnessFeature& feature : report.features())
    for (const reports::RobustnessRow& row : feature.rows())
      if (row.not_described() > 0)
        std::cout << row.name() << ", " << feature.label() << ": " << row.not_described()
                  << " perturbed scans could not be described; they count as missed\n";
}

int run_robustness(const RobustnessRun& o, const Options& options) {
  const Question question = open_question(o);
  reports::Robustness report = report_of(o, options, question);
  const std::string command = shell_command("revisit robustness", options.arguments());
  bool all_described = true;
  for (const std::string& name : o.features) {
    int stored = 0;
    *report.add_features() = ask(o, name, question, command, stored, all_described);
    report.set_stored(stored);
  }

  const fs::path run = make_run_folder(o.output, question.drive);
  write_atomically(run / "robustness.csv",
                   [&](std::ostream& out) { robustness_lines(report).print_csv(out); });
  write_json(run / "robustness.json", report);
  link_latest(run);
  PageOptions page;
  page.command =
      shell_command("revisit report", {run.string(), "-o", (run / "report.html").string()});
  if (!o.no_report) write_report({run}, run / "report.html", page);

  if (o.format == "json") {
    report.set_folder(run.string());
    std::cout << to_json(report) << "\n";
  } else if (o.format == "csv") {
    robustness_lines(report).print_csv(std::cout);
  } else {
    robustness_table(report).print(std::cout);
    print_not_described(report);
    std::cout << "\nresults: " << run.string() << "\n";
    if (!o.no_report) std::cout << "report: " << (run / "report.html").string() << "\n";
  }
  return all_described ? kOk : kScansSkipped;
}

}  // namespace

Command robustness_command() {
  return {
      "robustness", "evaluate features on perturbed scans",
      "Evaluates features on perturbed scans: tilted, from another height, partly hidden, with "
      "fewer beams, in rain. Scans of DATA (a drive with poses or --pairs) are perturbed and "
      "compared with all unperturbed scans. `self`: rate of queries whose best match is their "
      "original. `neighbor`: rate whose best match without the original is within --radius. "
      "`ratio`: median similarity of the best such neighbor over that of the best scan of another "
      "place; a `minimum` below 1 means that a scan resembles another place more. Recall@1 and AP "
      "are those of `revisit eval`. If interrupted, run the same command again to resume.",
      "  revisit robustness KITTI --sequence 00 --feature ring,scan-context\n"
      "  revisit robustness drive --distractors elsewhere --perturb pitch=8 --perturb "
      "range=20+rain=0.2\n"
      "  revisit robustness KITTI --sequence 00 --exclusion frames=50 --negative-radius 20\n"
      "  revisit robustness laps --pairs loops.csv --pairs-near 2 --queries 0\n"
      "  revisit robustness drive --ring old.ring --label old -o results/rings\n"
      "  revisit report results/rings -o rings.html     # all features in one table\n",
      with_options<RobustnessRun>(run_robustness)};
}

}  // namespace revisit::cli
