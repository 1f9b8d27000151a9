#include <iostream>

#include "cli/net_options.h"
#include "cli/table.h"
#include "cli/terminal.h"
#include "net_commands.h"
#include "verify/compare_case.h"

namespace revisit::cli {

namespace {

namespace fs = std::filesystem;

struct VerifyOptions {
  std::vector<fs::path> folders;
  CompareOptions compare;
  bool layers = false;

  void declare(Options& options) {
    options.argument("DIR", &folders);
    options
        .option("tolerance", "E",
                "maximum relative error of an output (default 1e-5; 1e-4 for Winograd kernels; "
                "5e-2 for bf16)",
                &compare.tolerance)
        .positive();
    options.option("threads", "N", "threads of one forward pass (default 1)", &compare.threads);
    declare_accuracy(options, &compare.strict_accuracy);
    declare_precision(options, &compare.precision);
    options.flag("layers", "error of each output of each case", &layers);
    options.flag("reference", "slow reference kernels", &compare.reference_kernels);
  }
};

int verify(VerifyOptions& o) {
  std::vector<GoldenCase> cases;
  for (const fs::path& folder : o.folders)
    for (GoldenCase& golden : find_golden_cases(folder)) cases.push_back(std::move(golden));

  Progress progress("verifying", "cases");
  Table table(
      {"case", "verdict", "compared", "rounding", "worst error", "at", "first that diverges"});
  Table errors({"case", "output", "error"});
  int failed = 0;
  for (size_t i = 0; i < cases.size(); ++i) {
    progress.update(static_cast<int64_t>(i), static_cast<int64_t>(cases.size()));
    if (interrupted()) throw Interrupted("interrupted after ", i, " of ", cases.size(), " cases");
    const CaseVerdict verdict = compare_case(cases[i], o.compare);
    failed += !verdict.passed();
    for (const auto& [layer, error] : verdict.errors)
      errors.row({cases[i].name, layer, str(error)});
    table.row({cases[i].name, verdict.passed() ? "ok" : "FAILED", str(verdict.compared),
               verdict.rounding ? str(verdict.rounding) : "", str(verdict.worst), verdict.worst_at,
               verdict.failure.empty() ? verdict.diverges_at : verdict.failure});
  }
  table.print(std::cout);
  if (o.layers) {
    std::cout << "\n";
    errors.print(std::cout);
  }
  std::cout << "\n"
            << cases.size() - static_cast<size_t>(failed) << " of " << cases.size()
            << " cases agree\n";
  return failed ? kCheckFailed : kOk;
}

}  // namespace

Command net_verify_command() {
  return {"verify", "comparison with outputs of the original",
          "Runs networks and compares with outputs of the original: the largest error (max|a-b| / "
          "max|b|) of each case, and the first output that diverges. A case is a folder with "
          "net.prototxt, weights.caffemodel or weights.caffemodel.h5, in_BLOB.npy for each input, "
          "and out_NAME.npy for any blobs, as after a forward pass, or layers ('/' in names "
          "becomes '_'); it may be anywhere below DIR. Nets that only move values must agree "
          "exactly. If a net amplifies rounding, so that single and double precision kernels "
          "differ by d, an output passes within 2d, at most 1e-4 ('rounding' counts these "
          "outputs).",
          "  revisit net verify my_model/\n"
          "  revisit net verify --tolerance 1e-4 my_model/ other_model/\n"
          "  revisit net verify --precision bf16 --layers my_model/\n",
          with_options<VerifyOptions>(verify)};
}

}  // namespace revisit::cli
