#pragma once

#include <map>
#include <optional>
#include <set>
#include <string>

#include "revisit/maps/place_recognizer.h"

namespace revisit::pipeline {

/// Which matches are accepted: what the options say comes before what the map was calibrated to,
/// and that before what the feature was. Refers to what it is made of.
class Acceptance {
 public:
  /// Without a map the calibration is kept here. `damaged` is told once of what the map keeps
  /// and cannot be used: it is damaged, or for another score.
  Acceptance(const FeatureExtractor& extractor, const RecognizerOptions& options, MapStore* map,
             const MapStore::Damaged& damaged);

  Score score() const { return score_; }
  const std::optional<Calibration>& calibration() const { return calibration_; }
  const std::optional<Calibration>& verified_calibration() const { return verified_; }
  const std::optional<double>& threshold() const { return threshold_; }
  /// Whether the map keeps a threshold or a calibration() that has the say.
  bool is_own() const { return is_own_; }

  /// Reads again what the map keeps.
  void refresh();
  /// PlaceRecognizer::calibrate().
  void calibrate(double threshold);
  void calibrate(const Calibration& calibration);
  /// Fills what it says of a loop among so many distinct places.
  void judge(int64_t distinct_places, Loop& loop) const;

 private:
  bool is_mine(const Calibration& one) const;
  void keep(const std::string& content, const std::string& text);
  void keep_value(const char* name, const std::string& bytes);

  const FeatureExtractor& extractor_;
  const RecognizerOptions& options_;
  Score score_;
  MapStore* map_;
  const MapStore::Damaged& damaged_;
  std::map<std::string, std::string> values_;  // what a map would keep, where there is none
  std::optional<Calibration> calibration_, verified_;
  std::optional<double> threshold_;
  bool is_own_ = false;
  std::set<std::string> said_;
};

/// Tells `wrong` what of this a map keeps and cannot be used by any recogniser.
void check_kept(const MapStore& map, const MapStore::Damaged& wrong);

/// Throws UsageError for a threshold that is not finite.
void check_threshold(std::optional<double> threshold);

}  // namespace revisit::pipeline
