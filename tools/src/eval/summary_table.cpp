#include "summary_table.h"

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

std::string interval(const Interval& i) {
  return std::isnan(i.low) ? "" : number(i.low, 3) + "-" + number(i.high, 3);
}

void print_loops(std::ostream& out, const AcceptedLoops& loops) {
  out << "accepted by default (score >= " << number(loops.threshold, 3) << "): " << loops.correct
      << " correct, " << loops.ignored << " ignored, " << loops.incorrect << " incorrect";
  if (loops.unlabeled > 0) out << ", " << loops.unlabeled << " without ground truth";
  out << "\n";
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

}  // namespace

void print_summary(std::ostream& out, const std::vector<TaskResult>& results, int resamples) {
  Table table({"task", "database", "queries", "with a true match", "AP", "F1 max", "recall@100%P",
               "recall@1", "EP"});
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
    if (r.on_pairs())
      out << r.task.name << ": " << r.summary.n_pairs << " pairs, " << r.summary.n_true_pairs
          << " of them true\n";
  for (const TaskResult& r : results)
    if (r.loops) print_loops(out, *r.loops);
  if (resamples == 0 || results.empty()) return;
  out << "95 %: confidence intervals from " << resamples << " block resamples of the queries (";
  for (const TaskResult& r : results)
    out << (&r == results.data() ? "" : ", ") << r.blocks.all << (results.size() > 1 ? " of " : "")
        << (results.size() > 1 ? r.task.name : "");
  out << (results.size() > 1 ? ")\n" : " blocks)\n");
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
  for (const Protocol& protocol : protocols()) {
    auto& fields = *list.add_values()->mutable_struct_value()->mutable_fields();
    fields["name"].set_string_value(protocol.name);
    fields["definition"].set_string_value(protocol.definition);
    fields["source"].set_string_value(protocol.source);
  }
  out << to_json(list) << "\n";
}

void print_protocols(std::ostream& out) {
  for (const Protocol& protocol : protocols()) {
    out << protocol.name << "\n";
    print_wrapped(out, protocol.definition + ".", 4, 96);
    print_wrapped(out, "(" + protocol.source + ")", 4, 96);
  }
}

}  // namespace revisit::cli
