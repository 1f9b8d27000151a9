#include <algorithm>
#include <map>
#include <set>
#include <sstream>

#include "cli/table.h"
#include "report/report.h"
#include "revisit/base/text.h"

namespace revisit::cli {
namespace {

std::string cell(const std::string& text) {
  std::string safe;
  for (const char c : text) safe += c == '|' ? "\\|" : c == '\n' ? " " : std::string(1, c);
  return safe;
}

std::string metric(bool there, double value, int digits = 3) {
  return there ? number(value, digits) : "";
}

std::string metric(bool there, double value, const google::protobuf::RepeatedField<double>& ci) {
  std::string text = metric(there, value);
  if (there && ci.size() == 2) text += " [" + number(ci[0], 2) + ", " + number(ci[1], 2) + "]";
  return text;
}

std::vector<std::string> cells_of(const reports::ExperimentRun& run) {
  const reports::Metrics& m = run.metrics();
  return {run.panel(),
          run.label(),
          metric(m.has_average_precision(), m.average_precision(), m.average_precision_ci()),
          metric(m.has_f1_max(), m.f1_max(), m.f1_max_ci()),
          metric(m.has_max_recall_at_precision_1(), m.max_recall_at_precision_1()),
          metric(m.has_recall_at_1(), m.recall_at_1(), m.recall_at_1_ci())};
}

void write_runs(const reports::Experiment& experiment, std::ostream& out) {
  out << "| sequence | curve | AP | F1 max | recall at 100 % precision | recall@1 | command |\n"
      << "|---|---|---|---|---|---|---|\n";
  for (const reports::ExperimentRun& run : experiment.runs())
    if (run.state() == "done")
      out << "| " << joined(cells_of(run), " | ", cell) << " | `" << cell(run.command()) << "` |\n";
  out << "\n";
}

/// Takes each method from its first run.
void write_methods(const reports::Experiment& experiment, std::ostream& out) {
  std::set<std::string> written;
  for (const reports::ExperimentRun& run : experiment.runs()) {
    if (!run.has_method() || run.state() != "done" || !written.insert(run.label()).second) continue;
    const reports::Method& method = run.method();
    if (written.size() == 1)
      out << "| method | dimension | training data | parameters | frames/s here | frames/s in the "
             "paper |\n|---|---|---|---|---|---|\n";
    out << "| " << cell(run.label()) << " | " << run.descriptor_dimension() << " | "
        << (method.needs_training() ? "yes" : "no") << " | " << cell(method.parameters()) << " | "
        << metric(run.has_frames_per_second(), run.frames_per_second(), 1) << " | "
        << metric(method.has_paper_frames_per_second(), method.paper_frames_per_second(), 1)
        << " |\n";
  }
  if (!written.empty()) out << "\n";
}

void write_claims(const reports::Experiment& experiment, std::ostream& out) {
  for (const reports::ExperimentClaim& claim : experiment.claims())
    out << "- " << claim.panel() << ": " << claim.text() << ": "
        << (claim.undecided() ? "undecided (each within the other's 95 % interval)"
            : claim.holds()   ? "holds"
                              : "**does not hold**")
        << " (AP of " << claim.better() << " " << number(claim.better_average_precision(), 3)
        << ", of " << claim.worse() << " " << number(claim.worse_average_precision(), 3) << ")\n";
  if (experiment.claims_size()) out << "\n";
}

void write_skipped(const reports::Experiment& experiment, std::ostream& out) {
  std::map<std::string, std::vector<std::string>> by_reason;
  for (const reports::ExperimentRun& run : experiment.runs())
    if (run.state() != "done") by_reason[run.reason()].push_back(run.panel() + " " + run.label());
  for (const auto& [reason, labels] : by_reason) {
    out << "Not run (" << reason << "): " << joined(labels, "; ") << ".\n\n";
  }
}

}  // namespace

void print_experiment(const reports::Experiment& experiment, std::ostream& out) {
  out << "\n" << experiment.title() << "\n\n";
  for (const std::string& note : experiment.notes()) out << note << "\n";
  Table table({"sequence", "curve", "AP", "F1 max", "recall@100%P", "recall@1"});
  bool any = false;
  for (const reports::ExperimentRun& run : experiment.runs()) {
    if (run.state() != "done") continue;
    table.row(cells_of(run));
    any = true;
  }
  if (any) table.print(out);
  write_claims(experiment, out);
  write_skipped(experiment, out);
}

std::string results_markdown(const reports::Page& page) {
  std::ostringstream out;
  out << kMarkdownMark;
  std::set<std::string> commands;
  for (const reports::Experiment& experiment : page.experiments())
    if (commands.insert(experiment.command()).second) out << "    " << experiment.command() << "\n";
  out << "\nThe command in each row repeats its numbers.\n";
  for (const reports::Experiment& experiment : page.experiments()) {
    out << "\n## " << experiment.title() << "\n\n"
        << experiment.question() << "\n\nThe paper: " << experiment.paper() << "\n\n";
    for (const std::string& note : experiment.notes()) out << "> " << note << "\n>\n";
    if (experiment.notes_size()) out << "\n";
    if (std::ranges::any_of(experiment.runs(), &reports::ExperimentRun::has_run))
      write_runs(experiment, out);
    write_methods(experiment, out);
    write_claims(experiment, out);
    write_skipped(experiment, out);
  }
  return std::move(out).str();
}

}  // namespace revisit::cli
