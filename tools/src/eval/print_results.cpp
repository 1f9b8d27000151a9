#include "eval/print_results.h"

#include <google/protobuf/struct.pb.h>

#include <algorithm>
#include <cmath>
#include <ostream>
#include <sstream>

#include "cli/json.h"
#include "cli/table.h"
#include "revisit/base/error.h"

namespace revisit::cli {
namespace {

std::string interval(const std::array<double, 2>& i) {
  return std::isnan(i[0]) ? "" : number(i[0], 3) + "-" + number(i[1], 3);
}

void print_loops(std::ostream& out, const AcceptedLoops& loops) {
  out << "accepted by default (score >= " << number(loops.threshold, 3) << "): " << loops.correct
      << " correct, " << loops.ignored << " ignored, " << loops.incorrect << " incorrect";
  if (loops.unlabeled > 0) out << ", " << loops.unlabeled << " without ground truth";
  out << "\n";
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

void print_wrapped(std::ostream& out, const std::string& text, size_t indent, size_t width) {
  std::istringstream words(text);
  size_t column = 0;
  for (std::string word; words >> word;) {
    if (column && column + 1 + word.size() > width) {
      out << "\n";
      column = 0;
    }
    out << (column ? " " : std::string(indent, ' ')) << word;
    column += (column ? 1 : indent) + word.size();
  }
  out << "\n";
}

std::string fraction(int64_t part, int64_t whole) {
  return whole ? str(part, "/", whole) : "";
}

/// A row per perturbation.
void print_perturbed(std::ostream& out, const std::vector<TaskResult>& results) {
  Table table({"perturbation", "self", "neighbor", "recall@1", "AP", "ratio", "minimum"});
  for (const TaskResult& r : results)
    table.row({text_of(r.perturbed->perturbation), fraction(r.perturbed->self, r.summary.n_queries),
               fraction(r.perturbed->neighbor, r.summary.n_positives),
               number(r.summary.recall_at_1, 3), number(r.summary.average_precision, 3),
               number(r.perturbed->ratio_median, 2), number(r.perturbed->ratio_min, 2)});
  table.print(out);
  for (const TaskResult& r : results)
    if (r.perturbed->skipped > 0)
      out << text_of(r.perturbed->perturbation) << ": " << r.perturbed->skipped
          << " perturbed scans could not be described; they count as missed\n";
}

void print_summary(std::ostream& out, const std::vector<TaskResult>& results, int resamples) {
  Table table({"task", "database", "queries", "with a correct match", "AP", "F1 max",
               "recall@100%P", "recall@1", "EP"});
  for (const TaskResult& r : results) {
    const PrSummary& s = r.summary;
    table.row({r.task.name, str(r.task.stored.size()), str(s.n_queries), str(s.n_positives),
               number(s.average_precision, 4), number(s.f1_max, 4),
               number(s.max_recall_at_precision_1, 4), number(s.recall_at_1, 4),
               number(s.extended_precision, 4)});
    if (r.intervals)
      table.row({"  95 %", "", "", "", interval(r.intervals->average_precision),
                 interval(r.intervals->f1_max), interval(r.intervals->max_recall_at_precision_1),
                 interval(r.intervals->recall_at_1), interval(r.intervals->extended_precision)});
  }
  table.print(out);
  for (const TaskResult& r : results)
    if (r.task.decides_on_pairs)
      out << r.task.name << ": " << r.summary.n_pairs << " pairs, " << r.summary.n_correct_pairs
          << " of them correct\n";
  for (const TaskResult& r : results)
    if (r.loops) print_loops(out, *r.loops);
  if (resamples == 0 || results.empty()) return;
  out << "95 %: confidence intervals from " << resamples << " block resamples of the queries (";
  for (const TaskResult& r : results)
    out << (&r == results.data() ? "" : ", ") << r.n_blocks << (results.size() > 1 ? " of " : "")
        << (results.size() > 1 ? r.task.name : "");
  out << (results.size() > 1 ? ")\n" : " blocks)\n");
}

void print_matches(std::ostream& out, const TaskResult& result, const Trajectory& trajectory,
                   const std::string& similarity) {
  constexpr size_t kHandful = 20;
  if (result.matches.empty() || result.matches.size() > kHandful) return;
  const auto frame = [&](int64_t scan) {
    return str(trajectory.frames[static_cast<size_t>(scan)]);
  };
  const Distance kind = result.task.rule.distance;
  const auto meters = [&](const Match& m) {
    if (kind == Distance::kPairs) return std::string();
    return number(distance_between(trajectory, m.query, m.ranks[0], kind), 1);
  };
  Table table({"query", "best", similarity, "next", similarity + " of next", "score",
               "meters to best", "correct"});
  for (size_t q = 0; q < result.matches.size(); ++q) {
    const Match& m = result.matches[q];
    const bool has_next = m.ranks.size() > 1;
    table.row({frame(m.query), frame(m.ranks[0]), number(m.similarities[0], 3),
               has_next ? frame(m.ranks[1]) : "", has_next ? number(m.similarities[1], 3) : "",
               number(m.score, 3), meters(m),
               result.labels[q].correct    ? "yes"
               : result.labels[q].ignored  ? "ignored"
               : result.labels[q].positive ? "no (missed)"
                                           : "no (no correct match)"});
  }
  out << "\n" << result.task.name << ":\n";
  table.print(out);
}

}  // namespace

void print_results(std::ostream& out, const FinishedEvaluation& evaluation, int resamples) {
  const std::vector<TaskResult>& tasks = evaluation.result.tasks;
  if (tasks.front().perturbed)
    print_perturbed(out, tasks);
  else
    print_summary(out, tasks, resamples);
  print_skipped(out, evaluation.skipped, evaluation.trajectory.size());
  for (const TaskResult& result : tasks)
    print_matches(out, result, evaluation.trajectory, evaluation.similarity);
  if (!evaluation.trained)
    out << "\nThe network is UNTRAINED (random weights): results do not measure accuracy.\n";
}

void print_skipped(std::ostream& out, const std::vector<std::string>& names, int64_t n_scans) {
  if (names.empty()) return;
  constexpr size_t kFew = 5;
  out << names.size() << " of " << n_scans << " scans could not be described and were skipped: ";
  for (size_t i = 0; i < std::min(names.size(), kFew); ++i) out << (i ? ", " : "") << names[i];
  out << (names.size() > kFew ? ", ...\n" : "\n");
}

void print_protocols_json(std::ostream& out) {
  google::protobuf::ListValue list;
  for (const Protocol& protocol : all_protocols()) {
    auto& fields = *list.add_values()->mutable_struct_value()->mutable_fields();
    fields["name"].set_string_value(protocol.name);
    fields["definition"].set_string_value(protocol.definition);
    fields["source"].set_string_value(protocol.source);
  }
  out << to_json(list) << "\n";
}

void print_protocols(std::ostream& out) {
  for (const Protocol& protocol : all_protocols()) {
    out << protocol.name << "\n";
    print_wrapped(out, protocol.definition + ".", 4, 96);
    print_wrapped(out, "(" + protocol.source + ")", 4, 96);
  }
}

}  // namespace revisit::cli
