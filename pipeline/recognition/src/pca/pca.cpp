#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <numeric>
#include <vector>

#include "feature_panels.h"
#include "revisit/base/error.h"
#include "revisit/base/files.h"
#include "revisit/engine/parallel_for.h"
#include "revisit/proto/npy.h"
#include "revisit/recognition/feature_file.h"
#include "revisit/recognition/matrix.h"

namespace revisit {
namespace {

namespace fs = std::filesystem;

constexpr int64_t kTile = 512;  // rows and columns of one product

int64_t tiles(int64_t rows) {
  return (rows + kTile - 1) / kTile;
}

/// X F^T, where X are all rows and F the fitted ones: [m][m] of the fitted rows (upper triangle)
/// and [n - m][m] of the others. Products of up to kPanelColumns columns are in float, their sums
/// in double. Any number of threads gives the same bits.
struct CrossGram {
  int64_t n, m;
  std::vector<double> fitted, others;

  CrossGram(int64_t rows, int64_t fitted_rows)
      : n(rows), m(fitted_rows), fitted(m * m), others((n - m) * m) {}

  static int64_t bytes(int64_t n, int64_t m, int threads) {
    const int64_t tile = std::min(kTile, n) * std::min(kTile, m);
    return n * m * static_cast<int64_t>(sizeof(double)) +
           threads * tile * static_cast<int64_t>(sizeof(float));
  }

  /// Adds the products of a panel whose first m rows are the fitted ones.
  void add(const Panel& panel, int threads) {
    // Tiles of the fitted rows, upper triangle only; then those of the others.
    const int64_t across = tiles(m), down = across + tiles(n - m);
    const auto add_tile = [&](int64_t row_tile, int64_t column_tile) {
      const bool in_fit = row_tile < across;
      const int64_t row = in_fit ? row_tile * kTile : m + (row_tile - across) * kTile;
      const int64_t rows = std::min(kTile, (in_fit ? m : n) - row);
      const int64_t column = column_tile * kTile, columns = std::min(kTile, m - column);
      const float* const x = panel.values.data();
      std::vector<float> product(rows * columns);
      if (row == column && in_fit)
        multiply_by_own_transpose(rows, panel.width, x + row * panel.width, panel.width,
                                  product.data(), columns);
      else
        multiply_transposed(rows, columns, panel.width, x + row * panel.width, panel.width,
                            x + column * panel.width, panel.width, product.data(), columns);
      double* const sums = in_fit ? fitted.data() + row * m : others.data() + (row - m) * m;
      for (int64_t r = 0; r < rows; ++r)
        for (int64_t c = row == column && in_fit ? r : 0; c < columns; ++c)
          sums[r * m + column + c] += static_cast<double>(product[r * columns + c]);
    };
    parallel_for(down * across, threads, [&](int64_t item) {
      const int64_t row_tile = item / across, column_tile = item % across;
      if (row_tile >= across || row_tile <= column_tile) add_tile(row_tile, column_tile);
    });
  }
};

/// Fitted rows come first, so that a panel has their block without a copy.
std::vector<int64_t> fitted_first(int64_t n, const std::vector<int64_t>& fit_rows) {
  std::vector<int64_t> order = fit_rows;
  std::vector<char> fitted(n, fit_rows.empty());
  for (const int64_t row : fit_rows) {
    if (row < 0 || row >= n) throw UsageError("PCA: fit row ", row, " of ", n, " rows");
    if (fitted[row]) throw UsageError("PCA: fit row ", row, " is given twice");
    fitted[row] = 1;
  }
  if (fit_rows.empty()) {
    order.resize(n);
    std::iota(order.begin(), order.end(), 0);
    return order;
  }
  for (int64_t row = 0; row < n; ++row)
    if (!fitted[row]) order.push_back(row);
  return order;
}

CrossGram cross_gram(const StackedFeatures& features, const std::vector<int64_t>& order, int64_t m,
                     const PcaOptions& options) {
  const int64_t n = features.n(), d = features.d();
  const int64_t eigen_bytes =
      2 * std::min(options.components, m) * m * static_cast<int64_t>(sizeof(double));
  const int64_t width =
      panel_columns(options.memory, CrossGram::bytes(n, m, options.threads) + eigen_bytes,
                    n * static_cast<int64_t>(sizeof(float)) + 16, d);
  CrossGram gram(n, m);
  Panel panel;
  for (int64_t first = 0; first < d; first += width) {
    check_stop(options);
    panel.load(features, order, m, first, std::min(width, d - first), options.threads);
    gram.add(panel, options.threads);
    if (options.progress) options.progress(first + panel.width, d);
  }
  return gram;
}

int64_t numerical_rank(const Eigenpairs& pairs, int64_t m) {
  int64_t rank = 0;
  const int64_t most = std::min(static_cast<int64_t>(pairs.values.size()),
                                m - 1);  // centering removes one dimension
  while (rank < most && pairs.values[rank] > kRankTolerance * pairs.values[0]) ++rank;
  return rank;
}

/// Computes U L^(1/2) for the fitted rows, (X F^T) U L^(-1/2) for the others.
FloatMatrix project_rows(const CrossGram& gram, const Eigenpairs& pairs, int64_t rank,
                         const std::vector<int64_t>& order, int threads) {
  const int64_t n = gram.n, m = gram.m;
  FloatMatrix descriptors(n, rank);
  for (int64_t r = 0; r < m; ++r)
    for (int64_t i = 0; i < rank; ++i)
      descriptors.row(order[r])[i] =
          static_cast<float>(pairs.vectors[i * m + r] * std::sqrt(pairs.values[i]));
  constexpr int64_t kRows = 512;  // per product
  parallel_ranges(n - m, kRows, threads, [&](int64_t begin, int64_t end) {
    std::vector<double> products((end - begin) * rank);
    multiply_transposed(end - begin, rank, m, gram.others.data() + begin * m, m,
                        pairs.vectors.data(), m, products.data(), rank);
    for (int64_t r = begin; r < end; ++r)
      for (int64_t i = 0; i < rank; ++i)
        descriptors.row(order[m + r])[i] =
            static_cast<float>(products[(r - begin) * rank + i] / std::sqrt(pairs.values[i]));
  });
  return descriptors;
}

/// Returns L^(-1/2) U^T, [rank][m].
std::vector<float> basis_weights(const Eigenpairs& pairs, int64_t m, int64_t rank) {
  std::vector<float> weights(rank * m);
  for (int64_t i = 0; i < rank; ++i)
    for (int64_t r = 0; r < m; ++r)
      weights[i * m + r] =
          static_cast<float>(pairs.vectors[i * m + r] / std::sqrt(pairs.values[i]));
  return weights;
}

/// Writes PcaModel's folder in a second pass over the features.
void write_model(const StackedFeatures& features, const std::vector<int64_t>& fitted,
                 const Eigenpairs& pairs, int64_t rank, const PcaOptions& options) {
  constexpr int64_t kSize = sizeof(float);
  const int64_t d = features.d(), m = static_cast<int64_t>(fitted.size());
  const std::vector<float> weights = basis_weights(pairs, m, rank);
  const int64_t width = panel_columns(options.memory, rank * m * kSize, (m + rank) * kSize + 16, d);

  make_folder(options.model_folder);
  const fs::path file = options.model_folder / "basis.npy";
  std::error_code ignored;
  fs::remove(file, ignored);  // an old basis must never be beside a new mean
  const int64_t bytes = rank * d * kSize;
  const fs::space_info space = fs::space(options.model_folder, ignored);
  if (!ignored && static_cast<uintmax_t>(bytes) > space.available)
    throw Error(file.string(), ": needs ", bytes, " bytes, but only ", space.available,
                " are free on that disk");
  std::vector<float> mean(d), values;
  Panel panel;
  write_atomically(file, [&](std::ostream& out) {
    const std::string header = proto::npy_header({rank, d});
    out << header;
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
      for (int64_t row = 0; row < rank; ++row) {
        out.seekp(std::ssize(header) + (row * d + first) * kSize);
        out.write(reinterpret_cast<const char*>(values.data() + row * panel.width),
                  panel.width * kSize);
      }
      if (!out) return;  // write_atomically() reports it
      if (options.progress) options.progress(first + panel.width, d);
    }
    proto::write_npy(options.model_folder / "mean.npy", {d}, mean.data());
  });
}

}  // namespace

PcaResult fit_pca(const FeatureFiles& files, const PcaOptions& options) {
  const StackedFeatures features(files);
  if (options.components < 1)
    throw UsageError("PCA: expected at least 1 component, found ", options.components);
  if (options.threads < 1)
    throw UsageError("PCA: expected at least 1 thread, found ", options.threads);
  const std::vector<int64_t> order = fitted_first(features.n(), options.fit_rows);
  const int64_t m =
      options.fit_rows.empty() ? features.n() : static_cast<int64_t>(options.fit_rows.size());
  if (m < 2) throw UsageError("PCA: expected at least 2 features to fit, found ", m);

  PcaResult result;
  CrossGram gram = cross_gram(features, order, m, options);
  double scatter = 0;
  for (int64_t i = 0; i < m; ++i) scatter += gram.fitted[i * m + i];
  if (!(scatter > 0))
    throw InputError(files[0]->path().string(), ": the ", m,
                     " fitted features are all equal; they have no principal direction");
  const Eigenpairs pairs = largest_eigenpairs(gram.fitted, m, std::min(options.components, m));
  std::vector<double>().swap(gram.fitted);  // frees the memory; assigning {} would not

  const double degrees = static_cast<double>(m - 1);
  result.rank = numerical_rank(pairs, m);
  result.total_variance = scatter / degrees;
  for (int64_t i = 0; i < result.rank; ++i) result.variances.push_back(pairs.values[i] / degrees);
  result.descriptors = project_rows(gram, pairs, result.rank, order, options.threads);
  if (result.rank < options.components)
    result.note =
        str("PCA keeps ", result.rank, " of the ", options.components, " requested components: ", m,
            " features of ", features.d(), " values have no more directions");
  std::vector<double>().swap(gram.others);
  if (!options.model_folder.empty())
    write_model(features, {order.begin(), order.begin() + m}, pairs, result.rank, options);
  return result;
}

}  // namespace revisit
