#include "revisit/loops/keyframes.h"

#include <charconv>
#include <cmath>

#include "revisit/base/error.h"

namespace revisit {

KeyframeRule parse_keyframes(const std::string& text) {
  if (text == "all") return {};
  const size_t equals = std::min(text.find('='), text.size());
  const std::string kind = text.substr(0, equals);
  const bool is_similarity = kind == "similarity";
  KeyframeRule rule{is_similarity ? KeyframeRule::Kind::kSimilarity : KeyframeRule::Kind::kMeters};
  const char* const end = text.data() + text.size();
  const auto [stop, error] =
      std::from_chars(text.data() + std::min(equals + 1, text.size()), end, rule.amount);
  if ((!is_similarity && kind != "meters") || error != std::errc() || stop != end ||
      !std::isfinite(rule.amount) || rule.amount <= 0 || (is_similarity && rule.amount > 1))
    throw UsageError("keyframes: expected all, meters=L or similarity=S (above 0, at most 1), ",
                     "found '", text, "'");
  return rule;
}

bool Keyframes::is_one(const PlaceRecognizer& recognizer, const Description& scan,
                       const std::optional<Eigen::Isometry3d>& pose) const {
  if (rule_.kind == KeyframeRule::Kind::kAll) return true;
  if (rule_.kind == KeyframeRule::Kind::kMeters && !pose)
    throw UsageError("keyframes: meters=L needs poses, which the scans lack; use similarity=S");
  if (!last_) return true;
  if (rule_.kind == KeyframeRule::Kind::kSimilarity)
    return recognizer.similarity(scan, *last_) < rule_.amount;
  return !pose_ || (pose->translation() - pose_->translation()).norm() >= rule_.amount;
}

void Keyframes::add(int64_t position, const std::optional<Eigen::Isometry3d>& pose) {
  last_ = position;
  pose_ = pose;
}

}  // namespace revisit
