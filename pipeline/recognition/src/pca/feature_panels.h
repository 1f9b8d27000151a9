#pragma once

#include <cstdint>
#include <vector>

#include "revisit/recognition/pca.h"

namespace revisit::pipeline {

/// Several feature files as one tall matrix.
class StackedFeatures {
 public:
  /// Throws UsageError without files, InputError when their dimensions differ.
  explicit StackedFeatures(const FeatureFiles& files);
  int64_t n() const { return n_; }
  int64_t d() const { return d_; }
  /// Columns [first, first + count) of row i. Throws InputError at a value that is not finite.
  void read(int64_t i, int64_t first, int64_t count, float* out) const;

 private:
  FeatureFiles files_;
  int64_t n_ = 0, d_ = 0;
};

/// Throws Interrupted when the caller wants to stop.
void check_stop(const PcaOptions& options);

/// Columns of a panel: summed in float (precision), and kept in the cache for some thousand rows.
inline constexpr int64_t kPanelColumns = 8192;

/// Width of panels within `memory`, at most kPanelColumns and `d`. Throws UsageError if too small.
int64_t panel_columns(int64_t memory, int64_t fixed, int64_t bytes_per_column, int64_t d);

/// Columns [first, first + width) of the rows asked for, each column minus its mean.
struct Panel {
  int64_t first = 0, width = 0;
  std::vector<float> mean;    // [width], over the first `m` rows
  std::vector<float> values;  // [rows][width], centred

  /// Reads rows `order`; the mean is that of the first `m` of them.
  void load(const StackedFeatures& features, const std::vector<int64_t>& order, int64_t m,
            int64_t first_column, int64_t columns, int threads);
};

}  // namespace revisit::pipeline
