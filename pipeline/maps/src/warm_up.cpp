#include "warm_up.h"

#include <algorithm>
#include <bit>

namespace revisit {
namespace {

std::vector<float> described(const Projection& projection, std::span<const float> feature) {
  std::vector<float> descriptor(static_cast<size_t>(projection.dim));
  projection.describe(feature, descriptor);
  return descriptor;
}

}  // namespace

WarmUp::WarmUp(const FeatureExtractor& extractor, int64_t distinct)
    : extractor_(extractor), wanted_(distinct) {
  features_.d = extractor.dim;
}

void WarmUp::add(std::span<const float> feature) {
  features_.values.insert(features_.values.end(), feature.begin(), feature.end());
  ++features_.n;
  if (over_) return;
  if (is_distinct(feature)) distinct_.push_back(features_.n - 1);
  over_ = std::ssize(distinct_) == wanted_ || features_.n / kMaxEntriesPerDistinct == wanted_;
}

bool WarmUp::is_distinct(std::span<const float> feature) {
  if (distinct_.empty() || !extractor_.comparison.same_place) return true;
  const Projection& provisional = projection();
  const std::vector<float> last = described(provisional, features_.row(distinct_.back())),
                           here = described(provisional, feature);
  return provisional.comparison.similarity_of(here, last) < *extractor_.comparison.same_place;
}

const Projection& WarmUp::projection() {
  const auto n = std::ssize(distinct_);
  const int64_t from = over_ ? n : static_cast<int64_t>(std::bit_floor(static_cast<uint64_t>(n)));
  if (from != fitted_to_) {
    projection_ = extractor_.fit_projection(features_.rows(),
                                            std::span(distinct_).first(static_cast<size_t>(from)));
    fitted_to_ = from;
  }
  return *projection_;
}

}  // namespace revisit
