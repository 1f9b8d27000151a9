#pragma once

#include <optional>
#include <set>
#include <string>

#include "revisit/loops/loop_detector.h"

namespace revisit {

/// Decides by score which matches are loops. The calibration is that of the map, else
/// verified_calibration() if loops are registered, else that of the feature. Keeps references to
/// its arguments.
class Acceptance {
 public:
  /// Throws UsageError for invalid options.
  Acceptance(const Map& map, const LoopDetectorOptions& options, bool verifies);

  Score score() const;
  const std::optional<Calibration>& calibration() const { return calibration_; }
  /// Absent if no score reaches the target precision.
  const std::optional<double>& threshold() const { return threshold_; }

  /// Reads the calibration of the map again.
  void refresh();
  void calibrate(const Calibration& calibration);
  /// Sets Loop::probability. Returns "" if the loop is accepted, else the rejection.
  std::string decide(Loop& loop) const;

 private:
  std::optional<Calibration> of_map();
  bool fits(const Calibration& one) const;
  const char* value_name() const;

  const Map& map_;
  const LoopDetectorOptions& options_;
  const bool verifies_;
  const double target_precision_;
  std::optional<Calibration> calibration_;
  std::optional<double> threshold_;
  std::set<std::string> warned_;
};

}  // namespace revisit
