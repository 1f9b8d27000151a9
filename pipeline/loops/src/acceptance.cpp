#include "acceptance.h"

#include <algorithm>
#include <cmath>

#include "revisit/base/error.h"
#include "revisit/base/text.h"

namespace revisit {
namespace {

std::string describe(const Calibration& one) {
  return str("k = ", one.k, " and the score ", name_of(one.score));
}

}  // namespace

double default_target_precision(Score score) {
  return score == Score::kVerified ? 0.99 : 0.95;
}

Acceptance::Acceptance(const Map& map, const LoopDetectorOptions& options, bool verifies)
    : map_(map),
      options_(options),
      verifies_(verifies),
      target_precision_(options.target_precision.value_or(default_target_precision(score()))) {
  if (options.threshold && !std::isfinite(*options.threshold))
    throw UsageError("the threshold: expected a number, found ", *options.threshold);
  if (!(target_precision_ > 0 && target_precision_ < 1))
    throw UsageError("precision: expected more than 0 and less than 1, found ", target_precision_);
  refresh();
}

Score Acceptance::score() const {
  return verifies_ ? Score::kVerified : map_.options().score.value_or(Score::kDistinctMargin);
}

bool Acceptance::fits(const Calibration& one) const {
  return one.score == score() && (verifies_ || one.k == map_.options().k);
}

const char* Acceptance::value_name() const {
  return verifies_ ? kVerifiedCalibrationValue : kCalibrationValue;
}

std::optional<Calibration> Acceptance::of_map() {
  if (map_.extractor() == nullptr) return std::nullopt;  // a new map
  const auto ignore = [&](const std::string& what) {
    if (warned_.insert(what).second) options_.warn(what + ": ignored; calibrate the map again");
  };
  std::optional<Calibration> calibration;
  map_.use_store([&](MapStore& store) {
    try {
      if (const auto content = store.value(value_name()))
        calibration = parse_calibration(*content, str(store.name(), ": its ", value_name()));
      else if (verifies_ && !options_.threshold && store.value(kCalibrationValue))
        ignore(store.name() + ": its calibration is for loops without registration");
    } catch (const InputError& error) {
      ignore(error.what());
    }
  });
  if (!calibration || fits(*calibration)) return calibration;
  ignore(str("the map was calibrated for ", describe(*calibration),
             ", not for k = ", map_.options().k, " and ", name_of(score())));
  return std::nullopt;
}

void Acceptance::refresh() {
  calibration_ = of_map();
  if (!calibration_ && verifies_) calibration_ = verified_calibration();
  if (const FeatureExtractor* extractor = map_.extractor(); !calibration_ && extractor != nullptr &&
                                                            extractor->calibration &&
                                                            fits(*extractor->calibration))
    calibration_ = extractor->calibration;
  threshold_ = options_.threshold;
  if (!threshold_ && calibration_) threshold_ = calibration_->threshold_for(target_precision_);
}

void Acceptance::calibrate(const Calibration& calibration) {
  const std::string content = calibration_content(calibration);
  try {
    parse_calibration(content, "calibrate()");
  } catch (const InputError& error) {
    throw UsageError(error.what());
  }
  if (!fits(calibration))
    throw UsageError("the calibration is for ", describe(calibration),
                     ", the detector has k = ", map_.options().k, " and ", name_of(score()));
  map_.use_store([&](MapStore& store) { store.set_value(value_name(), content); });
  refresh();
}

std::string Acceptance::decide(Loop& loop) const {
  // None of the n distinct entries looks like another: the next one does not either with
  // probability n / (n + 1) (Laplace's rule of succession). Registered points identify a place.
  const auto n = static_cast<double>(map_.distinct());
  const double most = verifies_ ? 1 : n / (n + 1);
  if (calibration_) loop.probability = std::min(most, calibration_->probability(loop.score));
  if (!threshold_ || loop.score < *threshold_) return "score";
  if (loop.ambiguous && !verifies_) return "ambiguous";
  return options_.threshold || most >= target_precision_ ? "" : "score";
}

}  // namespace revisit
