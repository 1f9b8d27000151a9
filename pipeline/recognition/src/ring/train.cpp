#include <algorithm>
#include <optional>

#include "revisit/recognition/matrix.h"
#include "revisit/recognition/ring/model.h"
#include "ring/extraction.h"
#include "ring/spectrum.h"

namespace revisit {
namespace {

struct ColumnSums {
  explicit ColumnSums(int64_t n) : rows(n), sums(n), squares(n * n) {}

  void add(const ColumnMap& map, const float* values, int64_t columns) {
    // Sums within a scan are in float, across scans in double.
    std::vector<float> block(static_cast<size_t>(rows * columns)), product(squares.size());
    for (int64_t r = 0; r < rows; ++r)
      std::copy_n(values + r * map.width + map.first, columns, block.begin() + r * columns);
    for (int64_t r = 0; r < rows; ++r)
      for (int64_t k = 0; k < columns; ++k) sums[r] += static_cast<double>(block[r * columns + k]);
    multiply_by_own_transpose(rows, columns, block.data(), columns, product.data(), rows);
    for (size_t i = 0; i < squares.size(); ++i) squares[i] += static_cast<double>(product[i]);
    count += columns;
  }

  RingLayer directions(const std::string& layer, int dim) {
    const auto n = static_cast<double>(count);
    RingLayer result;
    result.name = layer;
    for (const double sum : sums) result.mean.push_back(static_cast<float>(sum / n));
    std::vector<double> covariance(squares.size());
    for (int64_t i = 0; i < rows; ++i)
      for (int64_t j = i; j < rows; ++j)
        covariance[i * rows + j] = squares[i * rows + j] / n - sums[i] / n * (sums[j] / n);
    const Eigenpairs pairs = largest_eigenpairs(covariance, rows, dim);
    result.directions = FloatMatrix(dim, rows);
    for (int i = 0; i < dim; ++i) {
      const auto first = pairs.vectors.begin() + i * rows;
      std::transform(first, first + rows, result.directions.row(i).begin(),
                     [](double v) { return static_cast<float>(v); });
    }
    return result;
  }

  int64_t rows, count = 0;
  std::vector<double> sums, squares;  // [rows], [rows][rows], upper triangle
};

/// Computes X_f (METHODS, eq. 1) of scans: [f] [features][row], zero for other rows; 17 x 120 x 8
/// bytes per scan.
std::vector<Eigen::MatrixXcf> spectra_of(const Rows& rings, std::span<const int64_t> scans,
                                         const RingPart& part, const std::vector<float>& mean) {
  const Spectrum spectrum(part.sectors);
  std::vector<Eigen::MatrixXcf> spectra(kRingFrequencies,
                                        Eigen::MatrixXcf::Zero(part.features, rings.n));
  for (const int64_t scan : scans) {
    const Eigen::MatrixXcf x = spectrum.of(rings.row(scan).data(), mean.data(), part);
    for (int f = 0; f < kRingFrequencies; ++f)
      spectra[static_cast<size_t>(f)].col(scan) = x.row(f).transpose();
  }
  return spectra;
}

/// Adds the sum over scans of X_f X_f^H to `total` (METHODS, eq. 2), averaged over augmentations.
/// Adds the Hermitian part of the sum over pairs of X_f(a) Y_f^H to `shared` (eq. 3), averaged over
/// all combinations of augmentations; this equals the product of the averages.
void add_covariance(RingStatistics& ring, const RingDrive& drive, const RingPart& part,
                    const std::vector<float>& mean) {
  using Eigen::MatrixXcd;
  const auto ways = static_cast<double>(1 + drive.augmented.size());
  std::vector<Eigen::MatrixXcf> sums;
  for (size_t way = 0; way < 1 + drive.augmented.size(); ++way) {
    const std::vector<Eigen::MatrixXcf> spectra =
        spectra_of(way == 0 ? drive.rings : drive.augmented[way - 1], drive.scans, part, mean);
    for (size_t f = 0; f < spectra.size(); ++f) {
      const MatrixXcd x = spectra[f].cast<std::complex<double>>();
      add_product_with_adjoint(x.rows(), x.cols(), 1 / ways, x.data(), x.data(),
                               ring.total[f].data());
    }
    if (way == 0) sums.resize(spectra.size(), Eigen::MatrixXcf::Zero(ring.features, drive.rings.n));
    for (size_t f = 0; f < spectra.size(); ++f) sums[f] += spectra[f];
  }
  if (drive.pairs.empty()) return;
  const auto n = static_cast<Eigen::Index>(drive.pairs.size());
  for (size_t f = 0; f < sums.size(); ++f) {
    const MatrixXcd x = sums[f].cast<std::complex<double>>() / ways;
    MatrixXcd a(ring.features, n), b(ring.features, n);
    for (Eigen::Index i = 0; i < n; ++i) {
      const RingPair& pair = drive.pairs[static_cast<size_t>(i)];
      a.col(i) = x.col(pair.a);
      // Y_f: b rotated to the yaw of a.
      b.col(i) = x.col(pair.b) * std::polar(1.0, static_cast<double>(f) * pair.relative_yaw);
    }
    MatrixXcd product = MatrixXcd::Zero(a.rows(), a.rows());
    add_product_with_adjoint(a.rows(), n, 0.5, a.data(), b.data(), product.data());
    ring.shared[f] += product + product.adjoint();
  }
}

/// Weighted mean [features][sectors]; 0 where nothing was seen.
std::vector<float> mean_of(const Rows& rings, std::span<const int64_t> scans,
                           const RingPart& part) {
  std::vector<double> sums(static_cast<size_t>(part.size())), weights(sums.size());
  for (const int64_t scan : scans) {
    const float* const feature = rings.row(scan).data();
    size_t at = 0;
    for (int i = 0; i < part.features; ++i) {
      const float* const w = part.weights_of(feature, i);
      for (int k = 0; k < part.sectors; ++k, ++at) {
        sums[at] += static_cast<double>(w[k]) *
                    static_cast<double>(feature[part.first + static_cast<int64_t>(at)]);
        weights[at] += static_cast<double>(w[k]);
      }
    }
  }
  std::vector<float> mean;
  for (size_t i = 0; i < sums.size(); ++i)
    mean.push_back(weights[i] > 0 ? static_cast<float>(sums[i] / weights[i]) : 0.0F);
  return mean;
}

}  // namespace

void train_cnn_ring(RingModel& model, const engine::Net& net, const LayerDimensions& layers,
                    int sectors, const NextScan& next) {
  if (layers.empty()) throw UsageError("ring layers: expected at least one");
  std::vector<std::string> names;
  for (const auto& [name, dim] : layers) names.push_back(name);
  const CnnRingPlan plan(model, names, sectors, net, {});
  CnnRingPlan::Runner runner(plan);
  std::vector<ColumnSums> sums;
  for (size_t i = 0; i < names.size(); ++i) {
    const auto [name, dim] = layers[i];
    const ColumnMap& map = plan.maps()[i];
    if (dim < 1 || dim > map.rows)
      throw UsageError("ring layers: '", name, "': columns have ", map.rows, " dimensions, but ",
                       dim, " were requested");
    sums.emplace_back(map.rows);
  }
  for (PointCloud cloud; next(cloud);) {
    runner.forward(cloud);
    for (size_t i = 0; i < sums.size(); ++i)
      sums[i].add(plan.maps()[i], runner.map(i), plan.maps()[i].merged * sectors);
  }
  if (sums[0].count == 0) throw UsageError("CNN ring: expected at least 1 scan, found none");
  model.layers.clear();
  model.cnn = {.sectors = sectors};
  for (size_t i = 0; i < sums.size(); ++i) {
    model.layers.push_back(sums[i].directions(names[i], layers[i].second));
    model.cnn.features += layers[i].second;
  }
  model.polar = {.sectors = model.grid.sectors,
                 .features = model.grid.features(),
                 .weights = model.grid.bins(),
                 .mirrored = true};
}

void train_rings(RingModel& model, std::span<const RingDrive> drives) {
  int64_t scans = 0, pairs = 0;
  for (const RingDrive& drive : drives) {
    for (size_t i = 0; i < 1 + drive.augmented.size(); ++i) {
      const Rows& rings = i == 0 ? drive.rings : drive.augmented[i - 1];
      if (rings.d != model.dim() || rings.n != drive.rings.n)
        throw InputError("training rings: found ", rings.n, " features of ", rings.d,
                         " floats, expected ", drive.rings.n, " of ", model.dim());
    }
    if (drive.scans.size() < 2)
      throw UsageError("training rings: expected at least 2 scans per drive, found ",
                       drive.scans.size());
    scans += static_cast<int64_t>(drive.scans.size());
    pairs += static_cast<int64_t>(drive.pairs.size());
  }
  if (scans == 0) throw UsageError("training rings: expected at least one drive, found none");
  model.scans = scans;
  const auto parts = parts_of(model);
  for (RingStatistics* ring : {&model.cnn, &model.polar}) {
    const Eigen::MatrixXcd zero = Eigen::MatrixXcd::Zero(ring->features, ring->features);
    ring->total.assign(kRingFrequencies, zero);
    ring->shared.assign(pairs > 0 ? kRingFrequencies : 0, zero);
    ring->mean.assign(static_cast<size_t>(ring->size()), 0.0F);
  }
  for (const RingDrive& drive : drives) {
    const float fraction = static_cast<float>(drive.scans.size()) / static_cast<float>(scans);
    for (RingStatistics* ring : {&model.cnn, &model.polar}) {
      const RingPart& part = parts[ring == &model.cnn ? 0 : 1];
      const std::vector<float> mean = mean_of(drive.rings, drive.scans, part);
      add_covariance(*ring, drive, part, mean);
      for (size_t i = 0; i < ring->mean.size(); ++i) ring->mean[i] += fraction * mean[i];
    }
  }
  for (RingStatistics* ring : {&model.cnn, &model.polar})
    for (auto [matrices, count] : {std::pair(&ring->total, scans), std::pair(&ring->shared, pairs)})
      for (Eigen::MatrixXcd& matrix : *matrices) {
        matrix /= static_cast<double>(count);
        if (ring->mirrored) matrix.imag().setZero();
      }
}

void fit_to_map(RingModel& model, const Rows& rings, std::span<const int64_t> scans, double blend) {
  constexpr double kFewScans = 128, kFewForMean = 8;
  if (!(blend >= 0 && blend <= 1)) throw UsageError("ring blend: expected 0 to 1, found ", blend);
  if (scans.empty()) throw UsageError("ring mean: expected at least 1 scan, found none");
  const auto parts = parts_of(model);
  std::optional<RingModel> map;
  const auto n = static_cast<double>(scans.size());
  if (blend > 0 && n > std::min(model.cnn.features, model.polar.features)) {
    const RingDrive drive{rings, {scans.begin(), scans.end()}, {}};
    train_rings(map.emplace(model), {&drive, 1});
  }
  for (RingStatistics RingModel::*ring : {&RingModel::cnn, &RingModel::polar}) {
    RingStatistics& statistics = model.*ring;
    const std::vector<float> seen = mean_of(rings, scans, parts[ring == &RingModel::cnn ? 0 : 1]);
    const auto part = static_cast<float>(std::min(1.0, (n - 1) / kFewForMean));
    for (size_t i = 0; i < seen.size(); ++i)
      statistics.mean[i] = part < 1 ? (1 - part) * statistics.mean[i] + part * seen[i] : seen[i];
    if (!map) continue;
    const std::vector<Eigen::MatrixXcd>& map_total = ((*map).*ring).total;
    const double more = std::max(0.0, n - statistics.features);
    const double fraction = blend * more / (more + kFewScans);
    const double scale = trace(statistics.total) / std::max(trace(map_total), 1e-300);
    for (size_t f = 0; f < statistics.total.size(); ++f)
      statistics.total[f] = (1 - fraction) * statistics.total[f] + fraction * scale * map_total[f];
  }
}

}  // namespace revisit
