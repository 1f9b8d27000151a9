#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "revisit/pipeline/pca.h"

namespace revisit::pipeline {

/// Several feature files as one tall matrix.
class StackedFeatures {
 public:
  /// Throws UsageError without files, InputError when their dimensions differ.
  explicit StackedFeatures(const FeatureFiles& files);
  int64_t n() const { return n_; }
  int64_t d() const { return d_; }
  /// Columns [first, first + count) of row i. Throws InputError, with the file and the place, when
  /// a value is not finite.
  void read(int64_t i, int64_t first, int64_t count, float* out) const;

 private:
  FeatureFiles files_;
  int64_t n_ = 0, d_ = 0;
};

/// Throws Interrupted when the caller wants to stop.
void check_stop(const PcaOptions& options);

/// Columns [first, first + width) of the rows asked for, each column minus its mean.
struct Panel {
  int64_t first = 0, width = 0;
  std::vector<float> mean;    // [width], over the first `m` rows
  std::vector<float> values;  // [rows][width], centred

  /// Reads rows `order`; the mean is that of the first `m` of them.
  void load(const StackedFeatures& features, const std::vector<int64_t>& order, int64_t m,
            int64_t first_column, int64_t columns, const PcaOptions& options);
};

}  // namespace revisit::pipeline
