#pragma once

#include <map>
#include <optional>
#include <set>
#include <string>

#include "revisit/maps/place_recognizer.h"

namespace revisit::pipeline {

/// Decides which matches are accepted. Options take precedence over the map's calibration, and that
/// over the feature's. Keeps references to its arguments.
class Acceptance {
 public:
  /// Without a map the calibration is stored in this object. `warn` gets each message once: the
  /// map's calibration or threshold is corrupt or for another score.
  Acceptance(const FeatureExtractor& extractor, const RecognizerOptions& options, MapStore* map,
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
  /// Sets probability and acceptance of a loop retrieved among `distinct_places` distinct places.
  void decide(int64_t distinct_places, Loop& loop) const;

 private:
  bool is_mine(const Calibration& one) const;
  void keep(const std::string& content, const std::string& text);
  void keep_value(const char* name, const std::string& bytes);

  const FeatureExtractor& extractor_;
  const RecognizerOptions& options_;
  Score score_;
  MapStore* map_;
  const MapStore::Warn& warn_;
  std::map<std::string, std::string> values_;  // stands in for the map's values if there is no map
  std::optional<Calibration> calibration_, verified_;
  std::optional<double> threshold_;
  bool is_own_ = false;
  std::set<std::string> said_;
};

/// Passes each corrupt threshold or calibration of the map to `wrong`.
void check_kept(const MapStore& map, const MapStore::Warn& wrong);

void check_threshold(std::optional<double> threshold);

}  // namespace revisit::pipeline
