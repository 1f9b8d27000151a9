#pragma once

#include <cstdint>
#include <vector>

#include "revisit/recognition/feature_file.h"
#include "revisit/recognition/matrix.h"

namespace revisit {

class StackedFeatures {
 public:
  /// Throws UsageError without files, InputError if their dimensions differ.
  explicit StackedFeatures(const FeatureFiles& files);
  int64_t n() const { return n_; }
  int64_t d() const { return d_; }
  /// Columns [first, first + count) of row i. Throws InputError for a value that is not finite.
  void read(int64_t i, int64_t first, int64_t count, float* out) const;

 private:
  FeatureFiles files_;
  int64_t n_ = 0, d_ = 0;
};

void check_stop(const PcaOptions& options);

/// Columns of a panel: few enough for float sums, and for the cache with some thousand rows.
inline constexpr int64_t kPanelColumns = 8192;

/// At most kPanelColumns and `d`. Throws UsageError if `memory` [bytes] is too small.
int64_t panel_columns(int64_t memory, int64_t fixed, int64_t bytes_per_column, int64_t d);

/// Columns [first, first + width) of the requested rows, each column minus its mean.
struct Panel {
  int64_t first = 0, width = 0;
  std::vector<float> mean;    // [width], over the first `m` rows
  std::vector<float> values;  // [rows][width], centered

  void load(const StackedFeatures& features, const std::vector<int64_t>& order, int64_t m,
            int64_t first_column, int64_t columns, int threads);
};

}  // namespace revisit
