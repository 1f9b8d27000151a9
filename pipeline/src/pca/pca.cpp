#include "revisit/pipeline/pca.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "basis_writer.h"
#include "feature_panels.h"
#include "linear_algebra/linear_algebra.h"
#include "revisit/proto/error.h"
#include "revisit/proto/npy.h"

namespace revisit::pipeline {
namespace {

constexpr int64_t kBlockRows = 512;      // rows of one float product, before it is added in double
constexpr int64_t kChunkColumns = 8192;  // columns of one float product
constexpr int64_t kFewestColumns = 64;   // narrower panels would spend their time on seeking

/// All rows, the fitted ones first: so a panel holds the fitted block without a copy.
std::vector<int64_t> fitted_first(int64_t n, const std::vector<int64_t>& fit_rows) {
  std::vector<int64_t> order = fit_rows;
  std::vector<char> fitted(n, fit_rows.empty());
  for (const int64_t row : fit_rows) {
    if (row < 0 || row >= n) throw UsageError(str("PCA: fit row ", row, " of ", n, " rows"));
    if (fitted[row]) throw UsageError(str("PCA: fit row ", row, " is given twice"));
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

/// How many columns of `bytes_per_column` fit beside `fixed` bytes.
int64_t panel_columns(int64_t memory, int64_t fixed, int64_t bytes_per_column, int64_t d) {
  const int64_t columns = (memory - fixed) / bytes_per_column;
  const int64_t fewest = std::min(d, kFewestColumns);
  if (memory < fixed || columns < fewest)
    throw UsageError(str("PCA: a memory bound of ", memory,
                         " bytes is too small; this many scans need at least ",
                         fixed + fewest * bytes_per_column));
  return std::min(columns, d);
}

/// X F^T, by blocks of rows: [m][m] of the fitted rows (upper triangle) and [n - m][m] of the
/// others.
struct CrossGram {
  int64_t n, m;
  std::vector<double> fitted, others;

  CrossGram(int64_t rows, int64_t fitted_rows)
      : n(rows), m(fitted_rows), fitted(m * m), others((n - m) * m) {}

  static int64_t bytes(int64_t n, int64_t m) {
    return n * m * static_cast<int64_t>(sizeof(double)) +
           kBlockRows * m * static_cast<int64_t>(sizeof(float));
  }

  /// Adds the products of columns [begin, begin + count) of the panel.
  void add(const Panel& panel, int64_t begin, int64_t count) {
    const float* const x = panel.values.data() + begin;
    const int64_t stride = panel.width;
    for (int64_t row = 0; row < n;) {
      const bool in_fit = row < m;
      const int64_t rows = std::min(kBlockRows, (in_fit ? m : n) - row);
      const int64_t first = in_fit ? row : 0;  // the lower triangle is not needed
      const int64_t columns = m - first;
      product_.resize(rows * columns);
      multiply_transposed(rows, columns, count, x + row * stride, stride, x + first * stride,
                          stride, product_.data(), columns);
      double* const sums = in_fit ? fitted.data() + row * m : others.data() + (row - m) * m;
      for (int64_t r = 0; r < rows; ++r)
        for (int64_t c = 0; c < columns; ++c)
          sums[r * m + first + c] += static_cast<double>(product_[r * columns + c]);
      row += rows;
    }
  }

 private:
  std::vector<float> product_;
};

CrossGram cross_gram(const StackedFeatures& features, const std::vector<int64_t>& order, int64_t m,
                     const PcaOptions& options) {
  const int64_t n = features.n(), d = features.d();
  const int64_t eigen_bytes =
      2 * std::min(options.components, m) * m * static_cast<int64_t>(sizeof(double));
  const int64_t width = panel_columns(options.memory, CrossGram::bytes(n, m) + eigen_bytes,
                                      n * static_cast<int64_t>(sizeof(float)) + 16, d);
  CrossGram gram(n, m);
  Panel panel;
  for (int64_t first = 0; first < d; first += width) {
    panel.load(features, order, m, first, std::min(width, d - first), options);
    for (int64_t begin = 0; begin < panel.width; begin += kChunkColumns) {
      check_stop(options);
      gram.add(panel, begin, std::min(kChunkColumns, panel.width - begin));
      if (options.progress)
        options.progress(first + std::min(begin + kChunkColumns, panel.width), d);
    }
  }
  return gram;
}

/// Gives the memory back (assigning {} would keep it).
void release(std::vector<double>& values) {
  std::vector<double>().swap(values);
}

/// A sign does not matter to a cosine, but the same input should give the same file.
void fix_signs(Eigenpairs& pairs, int64_t m) {
  for (size_t i = 0; i < pairs.values.size(); ++i) {
    const auto begin = pairs.vectors.begin() + static_cast<int64_t>(i) * m;
    const auto largest = std::max_element(
        begin, begin + m, [](double a, double b) { return std::abs(a) < std::abs(b); });
    if (*largest < 0) std::transform(begin, begin + m, begin, std::negate<>());
  }
}

int64_t numerical_rank(const Eigenpairs& pairs, int64_t m) {
  int64_t rank = 0;
  const int64_t most =
      std::min(static_cast<int64_t>(pairs.values.size()), m - 1);  // centring costs one
  while (rank < most && pairs.values[rank] > kRankTolerance * pairs.values[0]) ++rank;
  return rank;
}

/// U L^(1/2) for the fitted rows, (X F^T) U L^(-1/2) for the others.
FloatMatrix project_rows(const CrossGram& gram, const Eigenpairs& pairs, int64_t rank,
                         const std::vector<int64_t>& order) {
  const int64_t n = gram.n, m = gram.m;
  FloatMatrix descriptors(n, rank);
  for (int64_t r = 0; r < m; ++r)
    for (int64_t i = 0; i < rank; ++i)
      descriptors.row(order[r])[i] =
          static_cast<float>(pairs.vectors[i * m + r] * std::sqrt(pairs.values[i]));
  std::vector<double> products(kBlockRows * rank);
  for (int64_t row = m; row < n; row += kBlockRows) {
    const int64_t rows = std::min(kBlockRows, n - row);
    multiply_transposed(rows, rank, m, gram.others.data() + (row - m) * m, m, pairs.vectors.data(),
                        m, products.data(), rank);
    for (int64_t r = 0; r < rows; ++r)
      for (int64_t i = 0; i < rank; ++i)
        descriptors.row(order[row + r])[i] =
            static_cast<float>(products[r * rank + i] / std::sqrt(pairs.values[i]));
  }
  return descriptors;
}

/// V^T = L^(-1/2) U^T F, panel by panel.
void write_model(const StackedFeatures& features, std::vector<int64_t> order, int64_t m,
                 const Eigenpairs& pairs, int64_t rank, const PcaOptions& options) {
  namespace fs = std::filesystem;
  constexpr int64_t kSize = sizeof(float);
  const int64_t d = features.d();
  order.resize(m);
  std::vector<float> weights(rank * m);
  for (int64_t i = 0; i < rank; ++i)
    for (int64_t r = 0; r < m; ++r)
      weights[i * m + r] =
          static_cast<float>(pairs.vectors[i * m + r] / std::sqrt(pairs.values[i]));
  const int64_t width = panel_columns(options.memory, rank * m * kSize, (m + rank) * kSize + 16, d);

  std::error_code error;
  fs::create_directories(options.model_folder, error);
  if (error) throw Error(str(options.model_folder.string(), ": cannot create: ", error.message()));
  fs::remove(options.model_folder / "basis.npy", error);  // never an old basis beside a new mean
  BasisWriter basis(options.model_folder / "basis.npy", rank, d);
  std::vector<float> mean(d), values;
  Panel panel;
  for (int64_t first = 0; first < d; first += width) {
    panel.load(features, order, m, first, std::min(width, d - first), options);
    std::copy(panel.mean.begin(), panel.mean.end(), mean.begin() + first);
    values.resize(rank * panel.width);
    multiply(rank, panel.width, m, weights.data(), m, panel.values.data(), panel.width,
             values.data(), panel.width);
    basis.write(first, panel.width, values.data());
    if (options.progress) options.progress(first + panel.width, d);
  }
  proto::write_npy(options.model_folder / "mean.npy", {d}, mean.data());
  basis.finish();
}

}  // namespace

PcaResult fit_pca(const FeatureFiles& files, const PcaOptions& options) {
  const StackedFeatures features(files);
  if (options.components < 1)
    throw UsageError(str("PCA: expected at least 1 component, found ", options.components));
  const std::vector<int64_t> order = fitted_first(features.n(), options.fit_rows);
  const int64_t m =
      options.fit_rows.empty() ? features.n() : static_cast<int64_t>(options.fit_rows.size());
  if (m < 2) throw UsageError(str("PCA: needs at least 2 features to learn from, found ", m));

  PcaResult result;
  CrossGram gram = cross_gram(features, order, m, options);
  double scatter = 0;
  for (int64_t i = 0; i < m; ++i) scatter += gram.fitted[i * m + i];
  if (!(scatter > 0))
    throw InputError(
        str(files[0]->path().string(), ": the ", m,
            " features to learn from are all the same; there is no direction to keep"));
  Eigenpairs pairs = largest_eigenpairs(gram.fitted, m, std::min(options.components, m));
  release(gram.fitted);
  fix_signs(pairs, m);

  const double degrees = static_cast<double>(m - 1);
  result.rank = numerical_rank(pairs, m);
  result.total_variance = scatter / degrees;
  for (int64_t i = 0; i < result.rank; ++i) result.variances.push_back(pairs.values[i] / degrees);
  result.descriptors = project_rows(gram, pairs, result.rank, order);
  if (result.rank < options.components)
    result.note =
        str("PCA keeps ", result.rank, " of the ", options.components, " components asked for: ", m,
            " features of ", features.d(), " values have no more directions");
  release(gram.others);
  if (!options.model_folder.empty()) write_model(features, order, m, pairs, result.rank, options);
  return result;
}

PcaModel::PcaModel(const std::filesystem::path& folder)
    : folder_(folder), basis_(folder / "basis.npy") {
  proto::NpyArray mean = proto::read_npy(folder / "mean.npy");
  if (mean.shape != std::vector<int64_t>{basis_.d()} || basis_.n() < 1)
    throw InputError(str(folder.string(), ": mean.npy has ", mean.data.size(),
                         " values, basis.npy is ", basis_.n(), " x ", basis_.d(),
                         "; they are not of one model"));
  mean_ = std::move(mean.data);
}

FloatMatrix PcaModel::project(const FeatureFiles& files, const PcaOptions& options) const {
  const StackedFeatures features(files);
  const int64_t n = features.n(), d = features.d();
  if (d != dim())
    throw InputError(str(files[0]->path().string(), ": features of ", d,
                         " values do not fit the PCA model ", folder_.string(), " for ", dim(),
                         " values (another network, layer or image size)"));
  if (options.components < 1)
    throw UsageError(str("PCA: expected at least 1 component, found ", options.components));
  const int64_t k = std::min(options.components, components());
  const StackedFeatures basis({&basis_});  // for its checks
  constexpr int64_t kSize = sizeof(float);
  const int64_t width =
      panel_columns(options.memory, (n * 2 + kBlockRows) * k * kSize, (k + kBlockRows) * kSize, d);

  std::vector<double> sums(n * k);
  std::vector<float> directions(k * width), values(kBlockRows * width), product(kBlockRows * k);
  for (int64_t first = 0; first < d; first += width) {
    const int64_t columns = std::min(width, d - first);
    for (int64_t i = 0; i < k; ++i) basis.read(i, first, columns, directions.data() + i * columns);
    for (int64_t row = 0; row < n; row += kBlockRows) {
      check_stop(options);
      const int64_t rows = std::min(kBlockRows, n - row);
      for (int64_t r = 0; r < rows; ++r) {
        float* const x = values.data() + r * columns;
        features.read(row + r, first, columns, x);
        for (int64_t c = 0; c < columns; ++c) x[c] -= mean_[first + c];
      }
      for (int64_t begin = 0; begin < columns; begin += kChunkColumns) {
        const int64_t count = std::min(kChunkColumns, columns - begin);
        multiply_transposed(rows, k, count, values.data() + begin, columns,
                            directions.data() + begin, columns, product.data(), k);
        for (int64_t i = 0; i < rows * k; ++i) sums[row * k + i] += static_cast<double>(product[i]);
      }
    }
    if (options.progress) options.progress(first + columns, d);
  }
  FloatMatrix descriptors(n, k);
  std::transform(sums.begin(), sums.end(), descriptors.values.begin(),
                 [](double sum) { return static_cast<float>(sum); });
  return descriptors;
}

}  // namespace revisit::pipeline
