#pragma once

#include "revisit/engine/tensor.h"

namespace revisit {

/// Suffix of FeatureExtractor::key.
inline const char* precision_key(engine::Precision precision) {
  return precision == engine::Precision::kBf16 ? "\nbf16" : "";
}

}  // namespace revisit
