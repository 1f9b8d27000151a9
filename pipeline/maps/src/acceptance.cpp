#include "acceptance.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <utility>

#include "revisit/base/error.h"
#include "revisit/base/text.h"

namespace revisit {
namespace {

struct KeptThreshold {
  double value = 0;
  Score score = Score::kMargin;
};

std::string text_of(const KeptThreshold& threshold) {
  return str(exact(threshold.value), " ", name_of(threshold.score));
}

KeptThreshold parse_threshold(const std::string& text) {
  KeptThreshold kept;
  const char* const end = text.data() + text.size();
  const std::from_chars_result read = std::from_chars(text.data(), end, kept.value);
  try {
    if (read.ec == std::errc() && std::isfinite(kept.value) && read.ptr != end) {
      kept.score = parse_score(std::string(read.ptr + 1, end));
      return kept;
    }
  } catch (const UsageError&) {  // another name
  }
  throw InputError("the map's threshold: expected a number and a score, found ", text.size(),
                   " bytes");
}

struct Kept {
  std::optional<KeptThreshold> threshold;
  std::optional<Calibration> calibration, verified;

  Kept(const MapStore& map, const MapStore::Warn& warn) {
    const auto read = [&](const char* name, const auto& parse) {
      try {
        if (const auto bytes = map.value(name); bytes && !bytes->empty()) parse(*bytes);
      } catch (const InputError& error) {
        warn(error.what());
      }
    };
    read(kThresholdValue, [&](const std::string& text) { threshold = parse_threshold(text); });
    read(kCalibrationValue, [&](const std::string& content) {
      calibration = parse_calibration(content, "the map's calibration");
    });
    read(kVerifiedCalibrationValue, [&](const std::string& content) {
      verified = parse_calibration(content, "the map's calibration of registered loops");
    });
  }
};

/// True also for a corrupt value.
bool has_value(const MapStore& map, const char* name) {
  try {
    return map.value(name).has_value();
  } catch (const InputError&) {
    return true;
  }
}

Score score_of(const FeatureExtractor& extractor, const RecognizerOptions& options) {
  if (options.score) return *options.score;
  if (extractor.calibration) return extractor.calibration->score;
  return extractor.comparison.same_place ? Score::kDistinctMargin : Score::kMargin;
}

}  // namespace

void check_kept(const MapStore& map, const MapStore::Warn& report) {
  Kept(map, report);
}

void check_threshold(std::optional<double> threshold) {
  if (threshold && !std::isfinite(*threshold))
    throw UsageError("the threshold: expected a number, found ", *threshold);
}

Acceptance::Acceptance(const FeatureExtractor& extractor, const RecognizerOptions& options,
                       MapStore& map, const MapStore::Warn& warn)
    : extractor_(extractor),
      options_(options),
      score_(score_of(extractor, options)),
      map_(map),
      warn_(warn) {
  refresh();
}

bool Acceptance::is_mine(const Calibration& one) const {
  return one.k == options_.k && one.score == score_;
}

void Acceptance::refresh() {
  const auto ignore = [&](const std::string& what) {
    if (warned_.insert(what).second) warn_(what + ": ignored; calibrate the map again");
  };
  Kept kept(map_, ignore);
  bool skipped = false;
  const auto skip_unless = [&](bool usable, auto& one) {
    if (!one || usable) return;
    one.reset();
    skipped = true;
  };
  skip_unless(kept.verified && kept.verified->score == Score::kVerified, kept.verified);
  skip_unless(kept.calibration && is_mine(*kept.calibration), kept.calibration);
  if (options_.threshold) kept.threshold.reset();
  skip_unless(kept.threshold && kept.threshold->score == score_, kept.threshold);
  if (skipped)
    ignore(str("the map was calibrated for another k or score than ", options_.k, " and ",
               name_of(score_)));
  is_own_ = kept.threshold || kept.calibration;
  verified_ = std::move(kept.verified);
  calibration_ = kept.calibration ? kept.calibration : extractor_.calibration;
  if (calibration_ && !is_mine(*calibration_)) calibration_.reset();
  threshold_ = options_.threshold;
  if (kept.threshold) threshold_ = kept.threshold->value;
  if (!threshold_ && calibration_)
    threshold_ = calibration_->threshold_for(options_.target_precision);
}

/// One of the two is empty, which counts as absent. The threshold is written first: if the second
/// transaction fails, either the new threshold or the old calibration is in use.
void Acceptance::keep(const std::string& content, const std::string& text) {
  for (const auto& [name, bytes] :
       {std::pair(kThresholdValue, &text), std::pair(kCalibrationValue, &content)})
    keep_value(name, *bytes);
  refresh();
}

void Acceptance::keep_value(const char* name, const std::string& bytes) {
  if (!bytes.empty() || has_value(map_, name)) map_.set_value(name, bytes);
}

void Acceptance::calibrate(double threshold) {
  check_threshold(threshold);
  keep({}, text_of({threshold, score_}));
}

void Acceptance::calibrate(const Calibration& calibration) {
  const std::string content = calibration_content(calibration);
  try {
    parse_calibration(content, "calibrate()");
  } catch (const InputError& error) {
    throw UsageError(error.what());
  }
  if (calibration.score == Score::kVerified) {
    keep_value(kVerifiedCalibrationValue, content);
    return refresh();
  }
  if (!is_mine(calibration))
    throw UsageError("the calibration is for k = ", calibration.k, " and the score ",
                     name_of(calibration.score), ", RecognizerOptions has k = ", options_.k,
                     " and ", name_of(score_));
  keep(content, {});
}

void Acceptance::decide(int64_t distinct_entries, Loop& loop) const {
  // None of the n distinct entries looks like another: the next one does not either with
  // probability n / (n + 1) (Laplace's rule of succession).
  const auto n = static_cast<double>(distinct_entries);
  const double most = n / (n + 1);
  if (calibration_) loop.probability = std::min(most, calibration_->probability(loop.score));
  loop.accepted = !loop.ambiguous && threshold_ && loop.score >= *threshold_ &&
                  (options_.threshold || most >= options_.target_precision);
}

}  // namespace revisit
