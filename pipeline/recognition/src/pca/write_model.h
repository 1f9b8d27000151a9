#pragma once

#include <cstdint>
#include <vector>

#include "feature_panels.h"
#include "revisit/recognition/linear_algebra.h"

namespace revisit {

void write_model(const StackedFeatures& features, const std::vector<int64_t>& fitted,
                 const Eigenpairs& pairs, int64_t rank, const PcaOptions& options);

}  // namespace revisit
