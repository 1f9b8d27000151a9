#pragma once

#include <string>

namespace revisit::doctor {

/// OpenBLAS' own line about its version and build.
std::string openblas_configuration();

}  // namespace revisit::doctor
