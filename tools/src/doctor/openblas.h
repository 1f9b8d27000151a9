#pragma once

#include <string>

namespace revisit::doctor {

/// The CPU family whose kernels OpenBLAS chose at run time, e.g. "SkylakeX".
std::string openblas_core();

/// OpenBLAS' own line about its version and build.
std::string openblas_configuration();

}  // namespace revisit::doctor
