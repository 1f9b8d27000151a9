#pragma once

#include <optional>
#include <set>
#include <string>

#include "revisit/maps/place_recognizer.h"

namespace revisit {

/// Precedence: options, the map's calibration, the feature's. Keeps references to its arguments.
class Acceptance {
 public:
  /// `warn` gets each message once.
  Acceptance(const FeatureExtractor& extractor, const RecognizerOptions& options, MapStore& map,
             const MapStore::Warn& warn);

  Score score() const { return score_; }
  const std::optional<Calibration>& calibration() const { return calibration_; }
  const std::optional<Calibration>& verified_calibration() const { return verified_; }
  const std::optional<double>& threshold() const { return threshold_; }
  /// True if a threshold or calibration() of the map is in use.
  bool is_own() const { return is_own_; }

  void refresh();
  void calibrate(double threshold);
  void calibrate(const Calibration& calibration);
  void decide(int64_t distinct_entries, Loop& loop) const;

 private:
  bool is_mine(const Calibration& one) const;
  void keep(const std::string& content, const std::string& text);
  void keep_value(const char* name, const std::string& bytes);

  const FeatureExtractor& extractor_;
  const RecognizerOptions& options_;
  Score score_;
  MapStore& map_;
  const MapStore::Warn& warn_;
  std::optional<Calibration> calibration_, verified_;
  std::optional<double> threshold_;
  bool is_own_ = false;
  std::set<std::string> warned_;
};

void check_kept(const MapStore& map, const MapStore::Warn& report);

void check_threshold(std::optional<double> threshold);

}  // namespace revisit
