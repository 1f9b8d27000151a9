#include "feature_panels.h"

#include <algorithm>
#include <bit>

#include "revisit/base/error.h"
#include "revisit/engine/parallel_for.h"

namespace revisit {
namespace {

constexpr int64_t kMinColumns = 64;  // narrower panels are dominated by seeking

/// Tests the exponent bits only, because the compiler vectorizes that.
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
      throw InputError(file->path().string(), ": has features of ", file->d(), " values, ",
                       files[0]->path().string(), " of ", d_);
  }
}

void StackedFeatures::read(int64_t i, int64_t first, int64_t count, float* out) const {
  size_t f = 0;
  while (i >= files_[f]->n()) i -= files_[f++]->n();
  files_[f]->read(i, first, count, out);
  if (all_finite(out, count)) return;
  const float* bad = std::find_if_not(out, out + count, [](float v) { return all_finite(&v, 1); });
  throw InputError(files_[f]->path().string(), ": row ", i, ", column ", first + (bad - out),
                   ": the value is not finite");
}

void check_stop(const PcaOptions& options) {
  if (options.stop && options.stop()) throw Interrupted("PCA stopped");
}

int64_t panel_columns(int64_t memory, int64_t fixed, int64_t bytes_per_column, int64_t d) {
  const int64_t columns = (memory - fixed) / bytes_per_column;
  const int64_t fewest = std::min(d, kMinColumns);
  if (memory < fixed || columns < fewest)
    throw UsageError("PCA: a memory bound of ", memory,
                     " bytes is too small; this many scans need at least ",
                     fixed + fewest * bytes_per_column);
  return std::min({columns, d, kPanelColumns});
}

void Panel::load(const StackedFeatures& features, const std::vector<int64_t>& order, int64_t m,
                 int64_t first_column, int64_t columns, int threads) {
  first = first_column;
  width = columns;
  const auto rows = static_cast<int64_t>(order.size());
  values.resize(rows * width);
  mean.resize(width);
  constexpr int64_t kRows = 64;  // per read task
  parallel_ranges(rows, kRows, threads, [&](int64_t begin, int64_t end) {
    for (int64_t r = begin; r < end; ++r)
      features.read(order[r], first, width, values.data() + r * width);
  });
  constexpr int64_t kColumns = 256;  // per centering task
  parallel_ranges(width, kColumns, threads, [&](int64_t begin, int64_t end) {
    double sums[kColumns] = {};
    for (int64_t r = 0; r < m; ++r)
      for (int64_t c = begin; c < end; ++c)
        sums[c - begin] += static_cast<double>(values[r * width + c]);
    for (int64_t c = begin; c < end; ++c)
      mean[c] = static_cast<float>(sums[c - begin] / static_cast<double>(m));
    for (int64_t r = 0; r < rows; ++r)
      for (int64_t c = begin; c < end; ++c) values[r * width + c] -= mean[c];
  });
}

}  // namespace revisit
