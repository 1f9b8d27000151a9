#include "descriptors.h"

#include <algorithm>
#include <numeric>

#include "cli/interrupt.h"
#include "cli/progress.h"

namespace revisit::cli {
namespace {

/// Rows [first, first + count) of a matrix.
pipeline::FloatMatrix rows_of(const pipeline::FloatMatrix& all, int64_t first, int64_t count) {
  pipeline::FloatMatrix part(count, all.d);
  std::copy_n(all.values.begin() + first * all.d, count * all.d, part.values.begin());
  return part;
}

}  // namespace

Descriptors reduce(const FeatureOptions& options, const pipeline::Task& task, const Features& case1,
                   const Features* case2, const std::filesystem::path& model_folder) {
  if (options.components < 0)
    throw UsageError(str("--pca: expected at least 0, found ", options.components));
  if (!(options.memory_gb > 0))
    throw UsageError("--memory: expected a positive number of gigabytes");
  const int64_t n = case1.file.n();
  pipeline::FeatureFiles files{&case1.file};
  if (case2) files.push_back(&case2->file);

  Progress progress("reducing", "columns", !options.no_progress && !options.quiet);
  pipeline::PcaOptions pca;
  pca.components = options.components ? options.components : n;
  pca.memory = static_cast<int64_t>(options.memory_gb * 1e9);
  pca.progress = progress.callback();
  pca.stop = interrupted;
  pca.model_folder = model_folder;

  Descriptors result;
  pipeline::FloatMatrix all;
  if (options.pca_fit == "all" || options.pca_fit == "map") {
    if (options.pca_fit == "map") {
      pca.fit_rows = task.stored;
    } else {
      pca.fit_rows.resize(static_cast<size_t>(n));  // case 1 only, also when case 2 is there
      std::iota(pca.fit_rows.begin(), pca.fit_rows.end(), int64_t{0});
    }
    pipeline::PcaResult fitted = pipeline::fit_pca(files, pca);
    result.pca_fit =
        str(options.pca_fit, ": ", pca.fit_rows.size(), " scans, ", fitted.rank, " components");
    result.note = fitted.note;
    all = std::move(fitted.descriptors);
  } else {
    all = pipeline::PcaModel(options.pca_fit).project(files, pca);
    result.pca_fit = str(options.pca_fit, ": ", all.d, " components");
  }
  result.case1 = rows_of(all, 0, n);
  if (case2) result.case2 = rows_of(all, n, n);
  return result;
}

}  // namespace revisit::cli
