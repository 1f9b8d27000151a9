#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <numeric>

#include "feature_panels.h"
#include "revisit/base/error.h"
#include "revisit/engine/parallel_for.h"
#include "revisit/proto/npy.h"
#include "revisit/recognition/feature_file.h"
#include "revisit/recognition/matrix.h"

namespace revisit {

PcaModel::PcaModel(const std::filesystem::path& folder)
    : folder_(folder), basis_(folder / "basis.npy") {
  proto::Blob mean = proto::read_npy(folder / "mean.npy");
  if (mean.shape != std::vector<int64_t>{basis_.d()} || basis_.n() < 1)
    throw InputError(folder.string(), ": mean.npy has ", mean.data.size(), " values, basis.npy is ",
                     basis_.n(), " x ", basis_.d(), "; they belong to different models");
  const auto bad = std::find_if_not(mean.data.begin(), mean.data.end(),
                                    [](float value) { return std::isfinite(value); });
  if (bad != mean.data.end())
    throw InputError((folder / "mean.npy").string(), ": value ", bad - mean.data.begin(),
                     " is not finite; train the model again");
  mean_ = std::move(mean.data);
}

FloatMatrix PcaModel::project(const FeatureFiles& files, const PcaOptions& options) const {
  const StackedFeatures features(files);
  const int64_t n = features.n(), d = features.d();
  if (d != dim())
    throw InputError(files[0]->path().string(), ": features of ", d,
                     " values do not match the PCA model ", folder_.string(), " for ", dim(),
                     " values (another network, layer or image size)");
  if (options.components < 1)
    throw UsageError("PCA: expected at least 1 component, found ", options.components);
  if (options.threads < 1)
    throw UsageError("PCA: expected at least 1 thread, found ", options.threads);
  const int64_t k = std::min(options.components, components());
  const StackedFeatures basis({&basis_});  // checks that values are finite
  constexpr int64_t kRows = 256;           // per product
  constexpr int64_t kSize = sizeof(float);
  const int64_t width = panel_columns(options.memory, (n * 3 + options.threads * kRows) * k * kSize,
                                      (k + options.threads * kRows) * kSize, d);

  std::vector<double> sums(n * k);
  std::vector<float> directions(k * width);
  for (int64_t first = 0; first < d; first += width) {
    check_stop(options);
    const int64_t columns = std::min(width, d - first);
    parallel_for(k, options.threads, [&](int64_t i) {
      basis.read(i, first, columns, directions.data() + i * columns);
    });
    parallel_ranges(n, kRows, options.threads, [&](int64_t begin, int64_t end) {
      const int64_t rows = end - begin;
      std::vector<float> values(rows * columns), product(rows * k);
      for (int64_t r = 0; r < rows; ++r) {
        float* const x = values.data() + r * columns;
        features.read(begin + r, first, columns, x);
        for (int64_t c = 0; c < columns; ++c) x[c] -= mean_[first + c];
      }
      multiply_transposed(rows, k, columns, values.data(), columns, directions.data(), columns,
                          product.data(), k);
      for (int64_t i = 0; i < rows * k; ++i) sums[begin * k + i] += static_cast<double>(product[i]);
    });
    if (options.progress) options.progress(first + columns, d);
  }
  FloatMatrix descriptors(n, k);
  std::transform(sums.begin(), sums.end(), descriptors.values.begin(),
                 [](double sum) { return static_cast<float>(sum); });
  return descriptors;
}

void PcaModel::project(std::span<const float> feature, std::span<float> descriptor) const {
  std::vector<float> centered(feature.size());
  std::ranges::transform(feature, mean_, centered.begin(), std::minus());
  for (size_t i = 0; i < descriptor.size(); ++i) {
    // Eight partial sums, which the compiler vectorizes.
    const auto direction = basis_.row(static_cast<int64_t>(i));
    std::array<double, 8> sums{};
    for (size_t j = 0; j < centered.size(); ++j)
      sums[j % 8] += static_cast<double>(direction[j]) * static_cast<double>(centered[j]);
    descriptor[i] = static_cast<float>(std::accumulate(sums.begin(), sums.end(), 0.0));
  }
}

}  // namespace revisit
