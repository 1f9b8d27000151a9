#include "feature_panels.h"

#include <algorithm>
#include <bit>

#include "revisit/proto/error.h"

namespace revisit::pipeline {
namespace {

/// Looks at the exponent bits only, which the compiler vectorises.
bool all_finite(const float* values, int64_t count) {
  constexpr uint32_t kExponent = 0x7F800000;
  uint32_t bad = 0;
  for (int64_t i = 0; i < count; ++i)
    bad |= (std::bit_cast<uint32_t>(values[i]) & kExponent) == kExponent;
  return bad == 0;
}

}  // namespace

StackedFeatures::StackedFeatures(const FeatureFiles& files) : files_(files) {
  if (files.empty()) throw UsageError("PCA needs at least one feature file");
  d_ = files[0]->d();
  for (const FeatureFile* file : files) {
    n_ += file->n();
    if (file->d() != d_)
      throw InputError(str(file->path().string(), ": has features of ", file->d(), " values, ",
                           files[0]->path().string(), " of ", d_));
  }
}

void StackedFeatures::read(int64_t i, int64_t first, int64_t count, float* out) const {
  size_t f = 0;
  while (i >= files_[f]->n()) i -= files_[f++]->n();
  files_[f]->read(i, first, count, out);
  if (all_finite(out, count)) return;
  const float* bad = std::find_if_not(out, out + count, [](float v) { return all_finite(&v, 1); });
  throw InputError(str(files_[f]->path().string(), ": row ", i, ", column ", first + (bad - out),
                       ": the value is not finite"));
}

void check_stop(const PcaOptions& options) {
  if (options.stop && options.stop()) throw Interrupted("PCA stopped");
}

void Panel::load(const StackedFeatures& features, const std::vector<int64_t>& order, int64_t m,
                 int64_t first_column, int64_t columns, const PcaOptions& options) {
  first = first_column;
  width = columns;
  values.resize(order.size() * columns);
  std::vector<double> sums(columns);
  for (size_t r = 0; r < order.size(); ++r) {
    if (r % 64 == 0) check_stop(options);
    float* const row = values.data() + r * columns;
    features.read(order[r], first, width, row);
    if (static_cast<int64_t>(r) < m)
      for (int64_t c = 0; c < columns; ++c) sums[c] += static_cast<double>(row[c]);
  }
  mean.resize(columns);
  for (int64_t c = 0; c < columns; ++c)
    mean[c] = static_cast<float>(sums[c] / static_cast<double>(m));
  for (size_t r = 0; r < order.size(); ++r) {
    float* const row = values.data() + r * columns;
    for (int64_t c = 0; c < columns; ++c) row[c] -= mean[c];
  }
}

}  // namespace revisit::pipeline
