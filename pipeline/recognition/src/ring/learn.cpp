#include "revisit/recognition/ring/learn.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include "linear_algebra/linear_algebra.h"
#include "ring/columns.h"
#include "ring/projection.h"
#include "ring/spectrum.h"

namespace revisit::pipeline {
namespace {

/// Mean and scatter of the columns of one layer, summed up scan by scan.
struct ColumnSums {
  explicit ColumnSums(int64_t n) : rows(n), sums(n), squares(n * n) {}

  void add(const ColumnMap& map, const float* values, int64_t columns) {
    // Sums of a scan in float, over scans in double.
    std::vector<float> own(static_cast<size_t>(rows * columns)), product(squares.size());
    for (int64_t r = 0; r < rows; ++r)
      std::copy_n(values + r * map.width + map.first, columns, own.begin() + r * columns);
    for (int64_t r = 0; r < rows; ++r)
      for (int64_t k = 0; k < columns; ++k) sums[r] += static_cast<double>(own[r * columns + k]);
    multiply_by_own_transpose(rows, columns, own.data(), columns, product.data(), rows);
    for (size_t i = 0; i < squares.size(); ++i) squares[i] += static_cast<double>(product[i]);
    count += columns;
  }

  LayerColumns directions(const std::string& layer, int numbers) {
    const auto n = static_cast<double>(count);
    LayerColumns result;
    result.layer = layer;
    for (const double sum : sums) result.mean.push_back(static_cast<float>(sum / n));
    std::vector<double> covariance(squares.size());
    for (int64_t i = 0; i < rows; ++i)
      for (int64_t j = i; j < rows; ++j)
        covariance[i * rows + j] = squares[i * rows + j] / n - sums[i] / n * (sums[j] / n);
    const Eigenpairs pairs = largest_eigenpairs(covariance, rows, numbers);
    result.directions = FloatMatrix(numbers, rows);
    for (int i = 0; i < numbers; ++i) {
      const auto first = pairs.vectors.begin() + i * rows, last = first + rows;
      const auto largest = std::max_element(
          first, last, [](double a, double b) { return std::abs(a) < std::abs(b); });
      const double sign = *largest < 0 ? -1 : 1;  // so that equal scans give equal files
      std::transform(first, last, result.directions.row(i).begin(),
                     [sign](double v) { return static_cast<float>(sign * v); });
    }
    return result;
  }

  int64_t rows, count = 0;
  std::vector<double> sums, squares;  // [rows], [rows][rows], upper triangle
};

/// Adds to `total` the sum over scans of X_f X_f^H, and to `shared` that over pairs of the
/// Hermitian part of X_f(a) X_f(b)^H.
void add_spread(RingStatistics& ring, const RingDrive& drive, const RingPlace& place,
                const float* mean) {
  using Eigen::MatrixXcd;
  const int64_t d = ring.numbers;
  const Spectrum spectrum(ring.sectors);
  // [f] [numbers][row of the file]: 17 x 64 x 8 bytes a scan.
  std::vector<Eigen::MatrixXcf> spectra(kRingFrequencies, Eigen::MatrixXcf::Zero(d, drive.rings.n));
  for (const int64_t scan : drive.scans) {
    const Eigen::MatrixXcf x =
        spectrum.of(drive.rings.row(scan).data() + place.first, mean, ring.numbers);
    for (int f = 0; f < kRingFrequencies; ++f)
      spectra[static_cast<size_t>(f)].col(scan) = x.row(f).transpose();
  }
  for (int f = 0; f < kRingFrequencies; ++f) {
    const MatrixXcd x = spectra[static_cast<size_t>(f)].cast<std::complex<double>>();
    ring.total[static_cast<size_t>(f)] += x * x.adjoint();  // rows that are not learnt from are 0
    if (drive.pairs.empty()) continue;
    const auto n = static_cast<Eigen::Index>(drive.pairs.size());
    MatrixXcd a(d, n), b(d, n);
    for (Eigen::Index i = 0; i < n; ++i) {
      const RingPair& pair = drive.pairs[static_cast<size_t>(i)];
      a.col(i) = x.col(pair.a);
      b.col(i) = x.col(pair.b) * std::polar(1.0, f * pair.turn);
    }
    const MatrixXcd product = a * b.adjoint();
    ring.shared[static_cast<size_t>(f)] += 0.5 * (product + product.adjoint());
  }
}

std::vector<float> mean_of(const Rows& rings, std::span<const int64_t> scans) {
  std::vector<double> sums(static_cast<size_t>(rings.d));
  for (const int64_t scan : scans) {
    const auto row = rings.row(scan);
    for (size_t i = 0; i < sums.size(); ++i) sums[i] += static_cast<double>(row[i]);
  }
  std::vector<float> mean;
  for (const double sum : sums)
    mean.push_back(static_cast<float>(sum / static_cast<double>(scans.size())));
  return mean;
}

}  // namespace

void learn_columns(RingModel& model, const engine::Net& net, const RingRecipe& recipe,
                   const NextScan& next) {
  if (recipe.layers.empty()) throw UsageError("RingRecipe::layers: expected at least one");
  std::vector<std::string> names;
  for (const auto& [name, numbers] : recipe.layers) names.push_back(name);
  const ColumnPlan plan(model, names, recipe.sectors, net, {});
  ColumnPlan::Runner runner(plan);
  std::vector<ColumnSums> sums;
  for (size_t i = 0; i < names.size(); ++i) {
    const auto [name, numbers] = recipe.layers[i];
    const ColumnMap& map = plan.maps()[i];
    if (numbers < 1 || numbers > map.rows)
      throw UsageError(str("RingRecipe::layers: '", name, "' has columns of ", map.rows,
                           " numbers, found ", numbers, " asked for"));
    sums.emplace_back(map.rows);
  }
  for (PointCloud cloud; next(cloud);) {
    runner.forward(cloud);
    for (size_t i = 0; i < sums.size(); ++i)
      sums[i].add(plan.maps()[i], runner.map(i), plan.maps()[i].merged * recipe.sectors);
  }
  if (sums[0].count == 0)
    throw UsageError("learning columns: expected at least 1 scan, found none");
  model.layers.clear();
  model.columns = {.sectors = recipe.sectors};
  for (size_t i = 0; i < sums.size(); ++i) {
    model.layers.push_back(sums[i].directions(names[i], recipe.layers[i].second));
    model.columns.numbers += recipe.layers[i].second;
  }
  model.polar = {.sectors = model.heights.sectors, .numbers = model.heights.rings};
}

void learn_rings(RingModel& model, std::span<const RingDrive> drives) {
  int64_t scans = 0, pairs = 0;
  for (const RingDrive& drive : drives) {
    if (drive.rings.d != model.dim())
      throw InputError(str("learning rings: rings of ", drive.rings.d,
                           " numbers do not match the model's ", model.dim()));
    if (drive.scans.size() < 2)
      throw UsageError(
          str("learning rings: expected at least 2 scans of a drive, found ", drive.scans.size()));
    scans += static_cast<int64_t>(drive.scans.size());
    pairs += static_cast<int64_t>(drive.pairs.size());
  }
  if (scans == 0) throw UsageError("learning rings: expected at least one drive");
  model.scans = scans;
  const auto places = rings_of(model);
  for (RingStatistics* ring : {&model.columns, &model.polar}) {
    const Eigen::MatrixXcd zero = Eigen::MatrixXcd::Zero(ring->numbers, ring->numbers);
    ring->total.assign(kRingFrequencies, zero);
    ring->shared.assign(pairs > 0 ? kRingFrequencies : 0, zero);
    ring->mean.assign(static_cast<size_t>(ring->size()), 0.0F);
  }
  for (const RingDrive& drive : drives) {
    const std::vector<float> mean = mean_of(drive.rings, drive.scans);
    const float share = static_cast<float>(drive.scans.size()) / static_cast<float>(scans);
    for (RingStatistics* ring : {&model.columns, &model.polar}) {
      const RingPlace& place = places[ring == &model.columns ? 0 : 1];
      add_spread(*ring, drive, place, mean.data() + place.first);
      for (size_t i = 0; i < ring->mean.size(); ++i)
        ring->mean[i] += share * mean[static_cast<size_t>(place.first) + i];
    }
  }
  for (RingStatistics* ring : {&model.columns, &model.polar}) {
    for (Eigen::MatrixXcd& total : ring->total) total /= static_cast<double>(scans);
    for (Eigen::MatrixXcd& shared : ring->shared) shared /= static_cast<double>(pairs);
  }
}

void fit_to_map(RingModel& model, const Rows& rings, std::span<const int64_t> scans, double adapt) {
  constexpr double kFewScans = 128;
  if (!(adapt >= 0 && adapt <= 1))
    throw UsageError(str("RingOptions::adapt: expected 0 to 1, found ", adapt));
  if (scans.empty()) throw UsageError("ring mean: expected at least 1 scan, found none");
  const std::vector<float> mean = mean_of(rings, scans);
  const auto places = rings_of(model);
  std::optional<RingModel> map;
  const auto n = static_cast<double>(scans.size());
  if (adapt > 0 && n > std::min(model.columns.numbers, model.polar.numbers)) {
    const RingDrive drive{rings, {scans.begin(), scans.end()}, {}};
    learn_rings(map.emplace(model), {&drive, 1});
  }
  for (RingStatistics RingModel::*ring : {&RingModel::columns, &RingModel::polar}) {
    RingStatistics& own = model.*ring;
    const auto first = mean.begin() + places[ring == &RingModel::columns ? 0 : 1].first;
    own.mean.assign(first, first + own.size());
    if (!map) continue;
    const std::vector<Eigen::MatrixXcd>& theirs = ((*map).*ring).total;
    const double more = std::max(0.0, n - own.numbers);
    const double share = adapt * more / (more + kFewScans);
    const double scale = trace(own.total) / std::max(trace(theirs), 1e-300);
    for (size_t f = 0; f < own.total.size(); ++f)
      own.total[f] = (1 - share) * own.total[f] + share * scale * theirs[f];
  }
}

}  // namespace revisit::pipeline
