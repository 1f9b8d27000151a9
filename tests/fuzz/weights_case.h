#pragma once

#include "fuzz.h"

namespace revisit::fuzz {

/// Reads every layer of a weights file, and loads it into a small net with the seeds' layer names.
void read_weights(const std::string& bytes);

}  // namespace revisit::fuzz
