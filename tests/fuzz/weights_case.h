#pragma once

#include "fuzz.h"

namespace revisit::fuzz {

/// Opens the bytes as a weights file, reads every layer, and loads it into a small net with the
/// layer names of the seeds.
void read_weights(const std::string& bytes);

}  // namespace revisit::fuzz
