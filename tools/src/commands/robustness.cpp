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

Question open_question(const RobustnessCommand& o) {
  Question q;
  q.drive = o.truth.open(o.feature, {.poses = o.options.rule.distance != Distance::kPlace});
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

reports::RobustnessFeature ask(const RobustnessCommand& o, const std::string& name,
                               const Question& question, const std::string& command, int& stored,
                               bool& all_described) {
  FeatureOptions options = o.feature;
  options.feature = name;
  const std::string sensor = resolve_sensor(options, question.drive);
  if (!sensor.empty()) options.observer().note("sensor: " + sensor);
  const fs::path cache = options.cache_folder(o.output);
  const FeatureSource source = open_feature(options, question.drive, cache);
  RobustnessOptions how = o.options;
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

reports::Robustness report_of(const RobustnessCommand& o, const Question& question) {
  reports::Robustness report;
  report.set_version(REVISIT_VERSION);
  report.set_data(fs::absolute(o.feature.data).string());
  report.set_sequence(question.drive.sequence);
  for (const fs::path& folder : o.among) report.add_among(fs::absolute(folder).string());
  if (question.listed) {
    report.set_distance(name_of(Distance::kPairs));
    for (const auto& [name, value] : o.truth.settings())
      if (!value.empty()) report.add_pairs(str(name, "=", value));
  } else {
    report.set_distance(name_of(o.options.rule.distance));
    report.set_radius_m(o.options.rule.radius);
    report.set_other_beyond_m(std::max(o.options.rule.radius, o.options.rule.false_beyond));
  }
  report.set_exclusion(to_string(o.options.exclusion));
  report.set_query_case(o.options.both_cases ? "both" : "1");
  report.set_seed(o.options.seed);
  return report;
}

void print_not_described(const reports::Robustness& report) {
  for (const reports::RobustnessFeature& feature : report.features())
    for (const reports::RobustnessRow& row : feature.rows())
      if (row.not_described() > 0)
        std::cout << row.name() << ", " << feature.label() << ": " << row.not_described()
                  << " perturbed scans could not be described; they count as missed\n";
}

}  // namespace

int robustness_command(const Arguments& arguments) {
  if (lists_sensors(arguments)) return kOk;
  const RobustnessCommand o = parse_robustness(arguments);
  const Question question = open_question(o);
  reports::Robustness report = report_of(o, question);
  const std::string command = shell_command("revisit robustness", arguments);
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

}  // namespace revisit::cli
