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

pipeline::FloatMatrix all_rows(const pipeline::FeatureFile& file, double memory_gb) {
  const double gigabytes = 4e-9 * static_cast<double>(file.n()) * static_cast<double>(file.d());
  if (gigabytes > memory_gb)
    throw UsageError(str("--memory: ", file.path().string(), " takes ", gigabytes,
                         " GB, more than the ", memory_gb, " allowed"));
  pipeline::FloatMatrix matrix(file.n(), file.d());
  for (int64_t i = 0; i < file.n(); ++i) file.read(i, 0, file.d(), matrix.row(i).data());
  return matrix;
}

}  // namespace

Descriptors reduce(const FeatureOptions& options, int64_t components, const pipeline::Task& task,
                   const Features& case1, const Features* case2,
                   const std::filesystem::path& model_folder) {
  if (!(options.memory_gb > 0))
    throw UsageError("--memory: expected a positive number of gigabytes");
  if (components < 0) {
    Descriptors whole;
    whole.pca_fit = "none";
    whole.case1 = all_rows(case1.file, options.memory_gb);
    if (case2) whole.case2 = all_rows(case2->file, options.memory_gb);
    return whole;
  }
  const int64_t n = case1.file.n();
  pipeline::FeatureFiles files{&case1.file};
  if (case2) files.push_back(&case2->file);

  Progress progress("reducing", "columns", !options.no_progress && !options.quiet);
  pipeline::PcaOptions pca;
  pca.components = components ? components : n;
  pca.memory = static_cast<int64_t>(options.memory_gb * 1e9);
  pca.threads = options.thread_count();
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
