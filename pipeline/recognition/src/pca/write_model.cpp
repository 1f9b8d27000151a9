#include "write_model.h"

#include <algorithm>
#include <cmath>

#include "basis_writer.h"
#include "revisit/base/error.h"
#include "revisit/engine/parallel_for.h"
#include "revisit/proto/npy.h"

namespace revisit {
namespace {

namespace fs = std::filesystem;

/// Returns L^(-1/2) U^T, [rank][m].
std::vector<float> basis_weights(const Eigenpairs& pairs, int64_t m, int64_t rank) {
  std::vector<float> weights(rank * m);
  for (int64_t i = 0; i < rank; ++i)
    for (int64_t r = 0; r < m; ++r)
      weights[i * m + r] =
          static_cast<float>(pairs.vectors[i * m + r] / std::sqrt(pairs.values[i]));
  return weights;
}

}  // namespace

void write_model(const StackedFeatures& features, const std::vector<int64_t>& fitted,
                 const Eigenpairs& pairs, int64_t rank, const PcaOptions& options) {
  constexpr int64_t kSize = sizeof(float);
  const int64_t d = features.d(), m = static_cast<int64_t>(fitted.size());
  const std::vector<float> weights = basis_weights(pairs, m, rank);
  const int64_t width = panel_columns(options.memory, rank * m * kSize, (m + rank) * kSize + 16, d);

  std::error_code error;
  fs::create_directories(options.model_folder, error);
  if (error) throw Error(options.model_folder.string(), ": cannot create: ", error.message());
  fs::remove(options.model_folder / "basis.npy",
             error);  // an old basis must never be beside a new mean
  BasisWriter basis(options.model_folder / "basis.npy", rank, d);
  std::vector<float> mean(d), values;
  Panel panel;
  for (int64_t first = 0; first < d; first += width) {
    check_stop(options);
    panel.load(features, fitted, m, first, std::min(width, d - first), options.threads);
    std::copy(panel.mean.begin(), panel.mean.end(), mean.begin() + first);
    values.resize(rank * panel.width);
    constexpr int64_t kColumns = 1024;  // per product V^T = (L^(-1/2) U^T) F
    parallel_ranges(panel.width, kColumns, options.threads, [&](int64_t begin, int64_t end) {
      multiply(rank, end - begin, m, weights.data(), m, panel.values.data() + begin, panel.width,
               values.data() + begin, panel.width);
    });
    basis.write(first, panel.width, values.data());
    if (options.progress) options.progress(first + panel.width, d);
  }
  proto::write_npy(options.model_folder / "mean.npy", {d}, mean.data());
  basis.finish();
}

}  // namespace revisit
